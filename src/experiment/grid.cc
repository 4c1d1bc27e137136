// From the blocks of an experiment's file to its settings.

#include <algorithm>
#include <set>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/experiment/experiment.h"

namespace raylift {
namespace {

const std::string kP3pName(ToString(Method::kP3p));
const std::string kE5p1Name(ToString(Method::kE5p1));

class GridExpansion {
 public:
  explicit GridExpansion(const Experiment& experiment) : experiment_(experiment) {}

  std::vector<Setting> Expand() {
    for (size_t b = 0; b < experiment_.blocks.size(); ++b) {
      place_ = fmt::format("grid {}", b + 1);
      Setting setting;
      Descend(experiment_.blocks[b], 0, setting);
    }
    return std::move(settings_);
  }

 private:
  void Descend(const GridBlock& block, size_t depth, Setting& setting) {
    if (depth == kNumAxes) {
      Add(setting);
      return;
    }
    const Axis axis = AllValues<Axis>()[depth];
    for (const std::string& value : ValuesOf(block, axis, setting)) {
      setting[axis] = value;
      Descend(block, depth + 1, setting);
    }
    setting[axis].clear();
  }

  std::vector<std::string> ValuesOf(const GridBlock& block, Axis axis,
                                    const Setting& setting) const {
    if (!Matters(axis, setting)) return {""};
    const auto given = block.axes.values.find(axis);
    if (given == block.axes.values.end()) return Defaults(axis, setting);
    if (axis == Axis::kGeometry) {
      const ExperimentScene& scene = experiment_.SceneOf(setting);
      for (const std::string& name : given->second) {
        if (scene.FindGeometry(name) == nullptr && !scene.file_is_missing) {
          throw InputError(
              experiment_.file, place_,
              fmt::format("geometry: the scene {} has none called \"{}\"", scene.name, name));
        }
      }
    }
    return given->second;
  }

  // The method comes after what it is given, and takes back there what it does not need.
  static bool Matters(Axis axis, const Setting& setting) {
    const std::string& method = setting[Axis::kMethod];
    if (axis == Axis::kScore || axis == Axis::kLo) return method == ToString(Method::kAdaptive);
    if (axis == Axis::kAlpha) return method == ToString(Method::kSelect);
    return true;
  }

  std::vector<std::string> Defaults(Axis axis, const Setting& setting) const {
    std::vector<std::string> values;
    switch (axis) {
      case Axis::kScene:
        for (const ExperimentScene& scene : experiment_.scenes) values.push_back(scene.name);
        return values;
      case Axis::kGeometry:
        for (const auto& geometry : experiment_.SceneOf(setting).geometry) {
          values.push_back(geometry.name);
        }
        return values.empty() ? std::vector<std::string>{""} : values;
      case Axis::kEvery:
        return {"1"};
      case Axis::kAlign:
      case Axis::kFilter:
        return {"off"};
      case Axis::kMethod:
        return {kP3pName, kE5p1Name, "adaptive"};
      case Axis::kScore:
        return {"sum_msac"};
      case Axis::kLo:
        return {"hybrid"};
      case Axis::kAlpha:
        return {"0.8"};
    }
    return {};
  }

  void Add(Setting setting) {
    if (setting[Axis::kMethod] == kE5p1Name) setting = E5p1Of(setting);
    if (setting[Axis::kMethod] != kE5p1Name && setting[Axis::kGeometry].empty() &&
        !experiment_.SceneOf(setting).file_is_missing) {
      throw InputError(experiment_.file, place_,
                       fmt::format("the method {} needs geometry, the scene {} has none",
                                   setting[Axis::kMethod], setting[Axis::kScene]));
    }
    if (seen_.insert(setting).second) settings_.push_back(std::move(setting));
  }

  const Experiment& experiment_;
  std::string place_;
  std::vector<Setting> settings_;
  std::set<Setting> seen_;
};

}  // namespace

const ExperimentGeometry* ExperimentScene::FindGeometry(const std::string& geometry_name) const {
  const auto found = std::find_if(
      geometry.begin(), geometry.end(),
      [&](const ExperimentGeometry& candidate) { return candidate.name == geometry_name; });
  return found == geometry.end() ? nullptr : &*found;
}

const ExperimentScene& Experiment::SceneOf(const Setting& setting) const {
  const auto found = std::find_if(scenes.begin(), scenes.end(), [&](const ExperimentScene& scene) {
    return scene.name == setting[Axis::kScene];
  });
  RAYLIFT_CHECK(found != scenes.end());
  return *found;
}

const NamedFilter& Experiment::FilterNamed(const std::string& name) const {
  const auto found = std::find_if(filters.begin(), filters.end(),
                                  [&](const NamedFilter& filter) { return filter.name == name; });
  RAYLIFT_CHECK(found != filters.end());
  return *found;
}

std::vector<Setting> ExpandGrid(const Experiment& experiment) {
  return GridExpansion(experiment).Expand();
}

Setting P3pOf(const Setting& setting) {
  Setting p3p = setting;
  p3p[Axis::kMethod] = kP3pName;
  for (const Axis axis : {Axis::kScore, Axis::kLo, Axis::kAlpha}) p3p[axis].clear();
  return p3p;
}

Setting E5p1Of(const Setting& setting) {
  Setting e5p1;
  e5p1[Axis::kScene] = setting[Axis::kScene];
  e5p1[Axis::kEvery] = setting[Axis::kEvery];
  e5p1[Axis::kMethod] = kE5p1Name;
  return e5p1;
}

bool IsChosen(const Setting& setting, const Experiment& experiment) {
  if (setting[Axis::kMethod] == kOracle) return true;
  // With localized queries among the references, each method has references of its own.
  return setting[Axis::kMethod] == ToString(Method::kSelect) &&
         !experiment.SceneOf(setting).continuous &&
         experiment.FilterNamed(setting[Axis::kFilter]).mode != FilterMode::kAuto;
}

std::vector<Setting> SettingsToEstimate(const std::vector<Setting>& settings,
                                        const Experiment& experiment) {
  std::vector<Setting> estimated;
  std::set<Setting> seen;
  const auto add = [&](const Setting& setting) {
    if (seen.insert(setting).second) estimated.push_back(setting);
  };
  for (const Setting& setting : settings) {
    if (IsChosen(setting, experiment)) {
      add(P3pOf(setting));
      add(E5p1Of(setting));
    } else {
      add(setting);
    }
  }
  return estimated;
}

}  // namespace raylift
