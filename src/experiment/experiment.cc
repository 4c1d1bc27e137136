#include "raylift/experiment/experiment.h"

#include <algorithm>
#include <variant>

#include "raylift/base/error.h"

namespace raylift {

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

const NamedFilter& Experiment::FilterNamed(const std::string& name) const {
  const auto found = std::find_if(filters.begin(), filters.end(),
                                  [&](const NamedFilter& filter) { return filter.name == name; });
  RAYLIFT_CHECK(found != filters.end());
  return *found;
}

const NamedFilter& Experiment::FilterOf(const Setting& setting) const {
  return FilterNamed(std::get<std::string>(setting[Axis::kFilter]));
}

const ExperimentGeometry* Experiment::GeometryOf(const Setting& setting) const {
  const auto* name = setting.Find<std::string>(Axis::kGeometry);
  return name == nullptr ? nullptr : SceneOf(setting).FindGeometry(*name);
}

}  // namespace raylift
