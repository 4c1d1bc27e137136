// Locates the surface point that a pixel of a localized photograph shows, in the world, with its
// covariance.

#pragma once

#include <optional>

#include <Eigen/Core>

#include "raylift/estimation/pose_estimator.h"
#include "raylift/geometry/camera.h"
#include "raylift/renderers/ray_caster.h"

namespace raylift {

struct LocatedPixel {
  Eigen::Vector3d point_in_world;
  Eigen::Vector3d normal_in_world;
  // The covariance by pose and surface together; nullopt where the pose's is not known.
  std::optional<Eigen::Matrix3d> covariance;
};

// Returns the surface point that a pixel shows; nullopt where the pixel has no ray or its ray
// leaves the surface: sky.
//
// With the ray X = C + t d and the surface's plane of normal n there, an error of the pose moves
// the point within the plane by (I - d n' / (n' d)) (dC + t dd); an error of the surface, a share
// of its depth as the query's matches show it (MatchNoise), moves it along the ray.
std::optional<LocatedPixel> LocatePixel(const RayCaster& surface, const PoseEstimate& estimate,
                                        const Camera& camera, const Eigen::Vector2d& pixel);

}  // namespace raylift
