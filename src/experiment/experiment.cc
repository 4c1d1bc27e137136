#include "raylift/experiment/experiment.h"

#include <algorithm>
#include <set>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

struct ToText {
  std::string operator()(std::monostate) const { return {}; }
  std::string operator()(const std::string& name) const { return name; }
  std::string operator()(size_t count) const { return std::to_string(count); }
  std::string operator()(double number) const { return FormatDouble(number); }
  std::string operator()(Oracle) const { return std::string(kOracleName); }
  template <NamedEnum Enum>
  std::string operator()(Enum value) const {
    return std::string(ToString(value));
  }
};

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
    for (const AxisValue& value : ValuesOf(block, axis, setting)) {
      setting[axis] = value;
      Descend(block, depth + 1, setting);
    }
    setting[axis] = {};
  }

  std::vector<AxisValue> ValuesOf(const GridBlock& block, Axis axis, const Setting& setting) const {
    if (!IsOfSetting(axis, setting)) return {AxisValue()};
    const auto given = block.axes.values.find(axis);
    if (given == block.axes.values.end()) return Defaults(axis, setting);
    if (axis == Axis::kGeometry) {
      const ExperimentScene& scene = experiment_.SceneOf(setting);
      for (const AxisValue& value : given->second) {
        const std::string& name = std::get<std::string>(value);
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
  static bool IsOfSetting(Axis axis, const Setting& setting) {
    if (axis == Axis::kScore || axis == Axis::kLo) return setting.Is(Method::kAdaptive);
    if (axis == Axis::kAlpha) return setting.Is(Method::kSelect);
    return true;
  }

  std::vector<AxisValue> Defaults(Axis axis, const Setting& setting) const {
    const EstimatorOptions defaults;
    std::vector<AxisValue> values;
    switch (axis) {
      case Axis::kScene:
        for (const ExperimentScene& scene : experiment_.scenes) values.emplace_back(scene.name);
        return values;
      case Axis::kGeometry:
        for (const auto& geometry : experiment_.SceneOf(setting).geometry) {
          values.emplace_back(geometry.name);
        }
        return values.empty() ? std::vector{AxisValue()} : values;
      case Axis::kEvery:
        return {size_t{1}};
      case Axis::kAlign:
        return {AlignMode::kOff};
      case Axis::kFilter:
        return {std::string(ToString(FilterMode::kOff))};
      case Axis::kMethod:
        return {Method::kP3p, Method::kE5p1, Method::kAdaptive};
      case Axis::kScore:
        return {defaults.score};
      case Axis::kLo:
        return {defaults.local_optimization};
      case Axis::kAlpha:
        return {defaults.alpha};
    }
    return {};
  }

  void Add(Setting setting) {
    if (setting.Is(Method::kE5p1)) setting = E5p1Of(setting);
    if (!setting.Is(Method::kE5p1) && !Matters(setting[Axis::kGeometry]) &&
        !experiment_.SceneOf(setting).file_is_missing) {
      throw InputError(experiment_.file, place_,
                       fmt::format("the method {} needs geometry, the scene {} has none",
                                   TextOf(setting[Axis::kMethod]), setting.Scene()));
    }
    if (seen_.insert(setting).second) settings_.push_back(std::move(setting));
  }

  const Experiment& experiment_;
  std::string place_;
  std::vector<Setting> settings_;
  std::set<Setting> seen_;
};

}  // namespace

std::string TextOf(const AxisValue& value) { return std::visit(ToText(), value); }

std::string Setting::Name() const {
  std::string name;
  for (const Axis axis : AllValues<Axis>()) {
    const AxisValue& value = (*this)[axis];
    if (!Matters(value)) continue;
    if (!name.empty()) name += ' ';
    name += ToString(axis);
    name += '=';
    name += TextOf(value);
  }
  return name;
}

bool Selection::Matches(const Setting& setting) const {
  return std::all_of(values.begin(), values.end(), [&](const auto& entry) {
    const AxisValue& value = setting[entry.first];
    return !Matters(value) ||
           std::find(entry.second.begin(), entry.second.end(), value) != entry.second.end();
  });
}

const ExperimentGeometry* ExperimentScene::FindGeometry(const std::string& geometry_name) const {
  const auto found = std::find_if(
      geometry.begin(), geometry.end(),
      [&](const ExperimentGeometry& candidate) { return candidate.name == geometry_name; });
  return found == geometry.end() ? nullptr : &*found;
}

const ExperimentScene& Experiment::SceneOf(const Setting& setting) const {
  const auto found = std::find_if(scenes.begin(), scenes.end(), [&](const ExperimentScene& scene) {
    return scene.name == setting.Scene();
  });
  RAYLIFT_CHECK(found != scenes.end());
  return *found;
}

const NamedFilter& Experiment::FilterOf(const Setting& setting) const {
  const auto& name = std::get<std::string>(setting[Axis::kFilter]);
  const auto found = std::find_if(filters.begin(), filters.end(),
                                  [&](const NamedFilter& filter) { return filter.name == name; });
  RAYLIFT_CHECK(found != filters.end());
  return *found;
}

const ExperimentGeometry* Experiment::GeometryOf(const Setting& setting) const {
  const auto* name = setting.Find<std::string>(Axis::kGeometry);
  return name == nullptr ? nullptr : SceneOf(setting).FindGeometry(*name);
}

std::vector<Setting> ExpandGrid(const Experiment& experiment) {
  return GridExpansion(experiment).Expand();
}

Setting P3pOf(const Setting& setting) {
  Setting p3p = setting;
  p3p[Axis::kMethod] = Method::kP3p;
  for (const Axis axis : {Axis::kScore, Axis::kLo, Axis::kAlpha}) p3p[axis] = {};
  return p3p;
}

Setting E5p1Of(const Setting& setting) {
  Setting e5p1;
  e5p1[Axis::kScene] = setting[Axis::kScene];
  e5p1[Axis::kEvery] = setting[Axis::kEvery];
  e5p1[Axis::kMethod] = Method::kE5p1;
  return e5p1;
}

bool IsChosen(const Setting& setting, const Experiment& experiment) {
  if (setting.IsOracle()) return true;
  // With localized queries among the references, each method has references of its own.
  return setting.Is(Method::kSelect) && !experiment.SceneOf(setting).continuous &&
         experiment.FilterOf(setting).mode != FilterMode::kAuto;
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
