// The two errors that rate a pose, in pixels, with derivatives: the reference implementations in
// double precision. The estimators' SIMD kernels are tested against these.
//
// Poses change on the left, in the camera's tangent frame: a step (w, v) turns cam_from_world into
// (exp(w) R, exp(w) t + v) with w in radians and v in scene units; a point p = R X + t moves by
// w x p + v to first order.

#pragma once

#include <optional>

#include <Eigen/Core>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {

// Returns the step (w, v) that turns one pose into another: to = exp(w, v) from, w of at most pi.
Eigen::Matrix<double, 6, 1> StepBetween(const Rigid3& from, const Rigid3& to);

struct ReprojectionResidual {
  Eigen::Vector2d error_px;              // projected minus observed
  Eigen::Matrix<double, 2, 6> jacobian;  // d error / d (w, v)
};

// Returns nullopt if the point cannot be projected (behind the camera, outside the lens model's
// domain).
std::optional<ReprojectionResidual> ReprojectionError(const Camera& camera,
                                                      const Rigid3& cam_from_world,
                                                      const Eigen::Vector3d& point_in_world,
                                                      const Eigen::Vector2d& observed_px);

struct SampsonResidual {
  double error_px;                       // signed
  Eigen::Matrix<double, 1, 6> jacobian;  // d error / d (w, v) of the query's pose
};

// Returns the Sampson error (Hartley and Zisserman, eq. 11.9) of a match between a query and a
// reference, that is the epipolar constraint q' E r over the length of its gradient with respect to
// the four pixel coordinates. Taking the gradient through the true camera models makes it a
// distance in pixels for any lens, and weighs the two images by their own focal lengths. nullopt if
// a pixel has no ray or both gradients vanish (the two camera centers coincide).
std::optional<SampsonResidual> SampsonError(const Camera& query_camera,
                                            const Rigid3& query_from_world,
                                            const Eigen::Vector2d& query_px,
                                            const Camera& reference_camera,
                                            const Rigid3& reference_from_world,
                                            const Eigen::Vector2d& reference_px);

// A pixel's neighborhood, linearized: for a point p on the ray through a nearby pixel,
//   (ImgFromCam(p) - pixel) ~ (image_from_ray * p).head<2>() / (image_from_ray * p).z(),
// exact for a pinhole camera and to first order for every other. The third row is positive in front
// of the camera. The inverse's first two columns are d ray / d pixel, its third is the ray.
struct PixelFrame {
  Eigen::Matrix3d image_from_ray;
  Eigen::Matrix3d ray_from_image;
};
std::optional<PixelFrame> MakePixelFrame(const Camera& camera, const Eigen::Vector2d& pixel);

}  // namespace raylift
