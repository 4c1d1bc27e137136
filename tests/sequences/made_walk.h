// Walks with known truth, for tests: odometry and frames' own poses, both with noise.

#pragma once

#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "base/constants.h"
#include "base/rng.h"
#include "geometry/pose_step.h"
#include "support/meshes.h"

#include "raylift/localization/localizer.h"
#include "raylift/sequences/smoothing.h"

namespace raylift {

struct WalkSettings {
  size_t frames = 60;
  double single_deg = 0.2, single_position = 0.02;  // of the frames' own poses
  double step_deg = 0.1, step_position = 0.005;     // of the odometry
  double scale = 1;                                 // odometry's units per scene unit
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
};

struct MadeWalk {
  std::vector<Rigid3> truth;
  std::vector<WalkEvidence> frames;

  double Error(const SmoothedWalk& walk, size_t i) const {
    return (walk.frames.at(i).cam_from_world.OriginInSource() - truth.at(i).OriginInSource())
        .norm();
  }
};

inline Vector6d Noise(Rng& rng, double deg, double position) {
  Vector6d noise;
  for (double& x : noise) x = rng.Normal();
  noise.head<3>() *= kRadPerDeg * deg;
  noise.tail<3>() *= position;
  return noise;
}

// Two rounds on a circle of radius 3, looking outwards.
inline MadeWalk MakeWalk(Rng& rng, const WalkSettings& settings) {
  MadeWalk walk;
  const Matrix6d covariance = [&] {
    Vector6d variances;
    variances << Eigen::Vector3d::Constant(std::pow(kRadPerDeg * settings.single_deg, 2)),
        Eigen::Vector3d::Constant(std::pow(settings.single_position, 2));
    return Matrix6d(variances.asDiagonal());
  }();
  Rigid3 odometry;
  for (size_t i = 0; i < settings.frames; ++i) {
    const double angle = 4 * std::numbers::pi * static_cast<double>(i) / 60;
    const Eigen::Vector3d outwards(std::cos(angle), std::sin(angle), 0.1 * std::sin(3 * angle));
    walk.truth.push_back(LookAt(settings.origin + 3 * outwards, settings.origin + 6 * outwards));
    if (i > 0) {
      Rigid3 step = Moved(walk.truth[i] * walk.truth[i - 1].Inverse(),
                          Noise(rng, settings.step_deg, settings.step_position));
      step.translation *= settings.scale;
      odometry = step * odometry;
    }
    const Rigid3 single =
        Moved(walk.truth[i], Noise(rng, settings.single_deg, settings.single_position));
    walk.frames.push_back({odometry, {{single, covariance, 0.99}}});
  }
  return walk;
}

// Returns the result of a photograph by itself, as a frame has it.
inline LocalizedQuery ResultOf(const WalkEvidence& frame, const std::string& name) {
  LocalizedQuery query;
  query.name = name;
  query.reason = frame.singles.empty() ? "too few matches" : "";
  if (frame.singles.empty()) return query;
  query.estimate.cam_from_world = frame.singles.front().cam_from_world;
  query.estimate.covariance = frame.singles.front().covariance;
  query.estimate.confidence = frame.singles.front().confidence;
  query.estimate.verdict = PoseVerdict::kLocalized;
  return query;
}

inline void TakeAway(MadeWalk& walk, size_t begin, size_t end) {
  for (size_t i = begin; i < end; ++i) walk.frames[i].singles.clear();
}

}  // namespace raylift
