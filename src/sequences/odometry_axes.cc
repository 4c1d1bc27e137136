#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "base/statistics.h"
#include "geometry/signed_permutations.h"
#include "sequences/odometry.h"
#include <Eigen/Geometry>
#include <Eigen/LU>

namespace raylift {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// The fewest directions that tell, and the largest median angle between those of odometry and of
// frames: chance lets half of ten agree within 30 degrees with one of 48 readings in one case of a
// hundred.
constexpr size_t kLeastDirections = 10;
constexpr double kMostDeg = 30;

// A step that is this many sigmas long has a direction.
constexpr double kLeastSigmas = 5;

// The camera's translation and rotation vector over a step, in the axes of the earlier frame.
struct Step {
  Vector3d way;
  Vector3d turn;
};

Step StepOf(const Rigid3& later, const Rigid3& earlier) {
  const Rigid3 step = later * earlier.Inverse();
  const Eigen::AngleAxisd turn(step.rotation);
  return {step.OriginInSource(), turn.angle() * turn.axis()};
}

double DegBetween(const Vector3d& a, const Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) * 180 / std::numbers::pi;
}

// A direction by the frames' own poses, and by odometry as read and inverted.
struct Direction {
  Vector3d by_frames;
  std::array<Vector3d, 2> by_odometry;
};

std::vector<Direction> DirectionsOf(std::span<const WalkEvidence> frames) {
  std::vector<Direction> directions;
  const WalkEvidence* before = nullptr;
  for (const WalkEvidence& frame : frames) {
    if (frame.singles.empty() || !(frame.singles.front().confidence > 0.5)) continue;
    if (before != nullptr) {
      const SinglePose &later = frame.singles.front(), &earlier = before->singles.front();
      const Step said = StepOf(later.cam_from_world, earlier.cam_from_world);
      const Step read = StepOf(frame.cam_from_odometry, before->cam_from_odometry);
      const Step inverted =
          StepOf(frame.cam_from_odometry.Inverse(), before->cam_from_odometry.Inverse());
      const auto variances = (later.covariance + earlier.covariance).diagonal().eval();
      const auto add = [&](const Vector3d& by_frames, double variance, const Vector3d& as_read,
                           const Vector3d& as_inverted) {
        if (by_frames.squaredNorm() > kLeastSigmas * kLeastSigmas * variance &&
            !as_read.isZero(0) && !as_inverted.isZero(0)) {
          directions.push_back({by_frames, {as_read, as_inverted}});
        }
      };
      add(said.turn, variances.head<3>().sum(), read.turn, inverted.turn);
      add(said.way, variances.tail<3>().sum(), read.way, inverted.way);
    }
    before = &frame;
  }
  return directions;
}

double MedianDeg(std::span<const Direction> directions, const OdometryReading& reading) {
  std::vector<double> angles;
  for (const Direction& direction : directions) {
    angles.push_back(
        DegBetween(direction.by_frames,
                   reading.cam_from_body * direction.by_odometry[reading.inverted ? 1 : 0]));
  }
  return UpperMedianOr(std::move(angles), 0);
}

}  // namespace

std::optional<BetterReading> FindBetterReading(std::span<const WalkEvidence> frames) {
  const std::vector<Direction> directions = DirectionsOf(frames);
  if (directions.size() < kLeastDirections) return std::nullopt;
  const double as_read = MedianDeg(directions, {});
  OdometryReading best;
  double least = as_read, second = HUGE_VAL;
  for (const bool inverted : {false, true}) {
    for (const Matrix3d& rotation : SignedPermutations()) {
      if (rotation.determinant() < 0 || (rotation.isIdentity() && !inverted)) continue;
      const OdometryReading reading{rotation, inverted};
      const double median = MedianDeg(directions, reading);
      if (median < least) {
        second = least;
        least = median;
        best = reading;
      } else {
        second = std::min(second, median);
      }
    }
  }
  // A reading counts only where its median angle is at most half of the other's.
  if (least > kMostDeg || least >= 0.5 * as_read) return std::nullopt;
  BetterReading better{std::nullopt, least, as_read};
  if (least <= 0.5 * second) better.reading = best;
  return better;
}

}  // namespace raylift
