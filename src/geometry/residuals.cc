#include "raylift/geometry/residuals.h"

#include <array>
#include <cmath>
#include <numbers>

#include <Eigen/Geometry>
#include <Eigen/LU>

namespace raylift {

Eigen::Matrix<double, 6, 1> StepBetween(const Rigid3& from, const Rigid3& to) {
  const Eigen::AngleAxisd turn(to.rotation * from.rotation.conjugate());
  const double angle = std::remainder(turn.angle(), 2 * std::numbers::pi);
  Eigen::Matrix<double, 6, 1> step;
  step << angle * turn.axis(), to.translation - turn * from.translation;
  return step;
}

std::optional<ReprojectionResidual> ReprojectionError(const Camera& camera,
                                                      const Rigid3& cam_from_world,
                                                      const Eigen::Vector3d& point_in_world,
                                                      const Eigen::Vector2d& observed_px) {
  const Eigen::Vector3d point_in_cam = cam_from_world * point_in_world;
  const auto projection = camera.ImgFromCamWithJacobian(point_in_cam);
  if (!projection) return std::nullopt;
  ReprojectionResidual residual;
  residual.error_px = projection->pixel - observed_px;
  residual.jacobian << -projection->jacobian * Skew(point_in_cam), projection->jacobian;
  return residual;
}

std::optional<SampsonResidual> SampsonError(const Camera& query_camera,
                                            const Rigid3& query_from_world,
                                            const Eigen::Vector2d& query_px,
                                            const Camera& reference_camera,
                                            const Rigid3& reference_from_world,
                                            const Eigen::Vector2d& reference_px) {
  const auto query_frame = MakePixelFrame(query_camera, query_px);
  const auto reference_frame = MakePixelFrame(reference_camera, reference_px);
  if (!query_frame || !reference_frame) return std::nullopt;
  const Eigen::Matrix3d R = (query_from_world.rotation * reference_from_world.rotation.conjugate())
                                .normalized()
                                .toRotationMatrix();
  const Eigen::Vector3d rotated_translation = R * reference_from_world.translation;
  const Eigen::Vector3d t = query_from_world.translation - rotated_translation;
  // Shorter baselines are rounding errors of the two translations.
  const double size = query_from_world.translation.norm() + rotated_translation.norm();
  if (!(t.norm() > 1e-14 * size)) return std::nullopt;

  // In pixels around the match, the constraint is (x, y, 1) G (x', y', 1)^T: its value is G(2, 2),
  // the other entries of the last row and column are its gradient.
  const Eigen::Matrix3d left = query_frame->ray_from_image.transpose();
  const Eigen::Matrix3d& right = reference_frame->ray_from_image;
  const auto gradient_of = [](const Eigen::Matrix3d& G) {
    return Eigen::Vector4d(G(0, 2), G(1, 2), G(2, 0), G(2, 1));
  };
  const Eigen::Matrix3d E = Skew(t) * R;
  const Eigen::Matrix3d G = left * E * right;
  const Eigen::Vector4d gradient = gradient_of(G);
  const double length = gradient.norm();
  if (!(length > 0)) return std::nullopt;
  SampsonResidual residual;
  residual.error_px = G(2, 2) / length;
  for (int i = 0; i < 3; ++i) {
    const Eigen::Matrix3d turn = Skew(Eigen::Vector3d::Unit(i));
    const std::array<Eigen::Matrix3d, 2> steps = {left * turn * E * right, left * turn * R * right};
    for (int kind = 0; kind < 2; ++kind) {
      const Eigen::Matrix3d& step = steps[static_cast<size_t>(kind)];
      const double length_step = gradient.dot(gradient_of(step)) / length;
      residual.jacobian(3 * kind + i) = (step(2, 2) - residual.error_px * length_step) / length;
    }
  }
  if (!std::isfinite(residual.error_px) || !residual.jacobian.allFinite()) return std::nullopt;
  return residual;
}

namespace {

// Computes the frame in closed form; the plane z = 1 makes it exact.
PixelFrame MakePinholeFrame(const Camera& camera, const Eigen::Vector2d& slope) {
  const Eigen::Vector2d focal(camera.focal_x_px(), camera.focal_y_px());
  PixelFrame frame;
  frame.image_from_ray << focal.x(), 0, -focal.x() * slope.x(),  //
      0, focal.y(), -focal.y() * slope.y(),                      //
      0, 0, 1;
  frame.ray_from_image << 1 / focal.x(), 0, slope.x(),  //
      0, 1 / focal.y(), slope.y(),                      //
      0, 0, 1;
  return frame;
}

}  // namespace

std::optional<PixelFrame> MakePixelFrame(const Camera& camera, const Eigen::Vector2d& pixel) {
  static const double kMaxSlope = std::tan(80 * std::numbers::pi / 180);
  if (camera.model() == CameraModel::kPinhole || camera.model() == CameraModel::kSimplePinhole) {
    const Eigen::Vector2d focal(camera.focal_x_px(), camera.focal_y_px());
    const Eigen::Vector2d slope = (pixel - camera.principal_point_px()).cwiseQuotient(focal);
    if (slope.squaredNorm() < kMaxSlope * kMaxSlope) return MakePinholeFrame(camera, slope);
  }
  const auto ray = camera.RayInCam(pixel);
  if (!ray) return std::nullopt;
  // The plane z = 1 makes a pinhole exact; far from the axis it would degenerate, and a panorama
  // has none.
  static const double kMinCosine = std::cos(80 * std::numbers::pi / 180);
  const bool near_axis = ray->z() > kMinCosine && !camera.is_panorama();
  const Eigen::Vector3d normal = near_axis ? Eigen::Vector3d::UnitZ() : *ray;
  const Eigen::Vector3d scaled_ray = near_axis ? Eigen::Vector3d(*ray / ray->z()) : *ray;
  const auto projection = camera.ImgFromCamWithJacobian(scaled_ray);
  if (!projection) return std::nullopt;
  PixelFrame frame;
  frame.image_from_ray << projection->jacobian, normal.transpose();
  frame.ray_from_image = frame.image_from_ray.inverse();
  frame.ray_from_image.col(2) = scaled_ray;
  if (!frame.ray_from_image.allFinite()) return std::nullopt;
  return frame;
}

}  // namespace raylift
