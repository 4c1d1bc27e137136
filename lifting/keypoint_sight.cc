#include "keypoint_sight.h"

#include <Eigen/Geometry>

namespace raylift {

std::optional<KeypointSight> SeeFromOther(const PosedImage& map, const Eigen::Vector2d& pixel,
                                          const PosedImage& other) {
  const auto ray = map.camera.RayInCam(pixel);
  const double depth = ray ? map.camera.DepthOf(*ray) : 0;
  if (!(depth > 0)) return std::nullopt;
  const Rigid3 other_from_map = other.cam_from_world * map.cam_from_world.Inverse();
  return KeypointSight{{.origin = other_from_map.translation,
                        .direction = other_from_map.rotation * (*ray / depth)}};
}

std::optional<TriangulatedDepth> TriangulateDepth(const KeypointSight& sight,
                                                  const Camera& other_camera,
                                                  const Eigen::Vector2d& other_px) {
  const auto other_ray = other_camera.RayInCam(other_px);
  if (!other_ray) return std::nullopt;
  const auto approach =
      Approach(sight.line_in_other, {.origin = Eigen::Vector3d::Zero(), .direction = *other_ray});
  if (!approach || !(approach->ray_t_a > 0)) return std::nullopt;
  const double z = approach->ray_t_a;
  const auto projection = other_camera.ImgFromCamWithJacobian(sight.PointInOther(z));
  if (!projection) return std::nullopt;
  return TriangulatedDepth{
      .z = z,
      .projected_px = projection->pixel,
      .gain_px = (projection->jacobian * sight.line_in_other.direction).norm() * z};
}

}  // namespace raylift
