// What is known of a query's pose before its matches are looked at: a position from GNSS, the
// direction of gravity from an accelerometer; and what is not known of its camera.

#pragma once

#include <optional>

#include <Eigen/Core>

namespace raylift {

struct PositionPrior {
  Eigen::Vector3d position;  // of the camera's center, world frame
  // Standard deviation along each axis of the world, scene units; 0: exact.
  Eigen::Vector3d sigma = Eigen::Vector3d::Zero();
};

struct GravityPrior {
  Eigen::Vector3d down_in_cam;    // any length but 0
  Eigen::Vector3d down_in_world;  // any length but 0
  double sigma_deg = 1;  // standard deviation of the angle about each axis across; 0: exact
};

inline constexpr double kMaxFocalRange = 10;

struct PosePriors {
  std::optional<PositionPrior> position = std::nullopt;
  std::optional<GravityPrior> gravity = std::nullopt;
  // The focal length is the given camera's up to this factor either way, of 1 (it is known) to
  // kMaxFocalRange. Where an estimator is asked to refine it, too, the wider range counts.
  double focal_range = 1;

  bool empty() const { return !position && !gravity && focal_range == 1; }
};

}  // namespace raylift
