#include "service/scene_place.h"

#include <algorithm>
#include <limits>

#include "base/json_text.h"
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"

namespace raylift {

// The frame is parsed anew, as PROJ's objects that others hold may be at work.
ScenePlace::ScenePlace(const WorldFrame& world, const ReferenceSet& references)
    : earth_(WorldFrame::Parse(world.text)),
      wgs84_("EPSG:4979"),
      to_crs_(wgs84_, earth_.world().crs) {
  for (const PosedImage& image : references.images) {
    const Eigen::Vector3d center = image.cam_from_world.OriginInSource();
    if (references_in_crs_.empty()) earth_.At(center);
    references_in_crs_.push_back(center + earth_.world().origin);
  }
}

std::optional<ScenePlace::Camera> ScenePlace::CameraOf(const PoseEstimate& estimate) const {
  const std::lock_guard lock(mutex_);
  try {
    const Rigid3& cam_from_world = *estimate.cam_from_world;
    const auto place = earth_.At(cam_from_world.OriginInSource());
    Camera camera{.geopose = JsonText(GeoPoseOf(cam_from_world, place))};
    if (const auto covariance_m2 = CenterCovarianceEnu(estimate, place)) {
      camera.sigma_m = covariance_m2->diagonal().cwiseMax(0).cwiseSqrt();
    }
    return camera;
  } catch (const InputError&) {
    return std::nullopt;
  }
}

std::optional<ScenePlace::Place> ScenePlace::PlaceAt(const Eigen::Vector3d& geographic) const {
  try {
    wgs84_.Check(geographic);
    const Eigen::Vector3d in_crs = to_crs_(geographic);
    earth_.world().crs.Check(in_crs);
    return Place{in_crs, LocalFrameAt(earth_.world().crs, in_crs).crs_from_enu};
  } catch (const InputError&) {
    return std::nullopt;
  }
}

std::optional<double> ScenePlace::DistanceMeters(const RoughPosition& position) const {
  const std::lock_guard lock(mutex_);
  const auto place = PlaceAt(position.geographic);
  if (!place) return std::nullopt;
  const Eigen::Matrix3d enu_from_crs = place->crs_from_enu.inverse();
  double nearest = std::numeric_limits<double>::infinity();
  for (const Eigen::Vector3d& reference : references_in_crs_) {
    nearest = std::min(nearest, (enu_from_crs * (reference - place->in_crs)).head<2>().norm());
  }
  return nearest;
}

std::optional<PositionPrior> ScenePlace::PriorOf(const RoughPosition& position) const {
  if (!position.sigma_m) return std::nullopt;
  const std::lock_guard lock(mutex_);
  const auto place = PlaceAt(position.geographic);
  if (!place) return std::nullopt;
  return PositionPrior{
      .position = place->in_crs - earth_.world().origin,
      .sigma = (place->crs_from_enu * position.sigma_m->asDiagonal()).rowwise().norm()};
}

std::optional<std::string> ScenePlace::Warning() const {
  const std::lock_guard lock(mutex_);
  const auto warning = earth_.Warning();
  return warning ? warning : earth_.HeightsWarning();
}

}  // namespace raylift
