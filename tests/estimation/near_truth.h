// What the tests of scoring and refinement share: a prepared problem and a pose near its true one.

#pragma once

#include <numbers>
#include <string>
#include <utility>

#include "estimation/problem/normalized_problem.h"
#include "support/matchers.h"
#include "support/synthetic_problem.h"

namespace raylift {

inline constexpr double kPointThresholdPx = 4;
inline constexpr double kPairThresholdPx = 2;

struct NearTruth {
  SyntheticProblem synthetic;
  NormalizedProblem prepared;
  Rigid3 pose;  // cam_from_world
  CamFromLocal local;
  CamFromLocal local_truth;

  NearTruth(SyntheticProblem problem, const Rigid3& query_from_world, Rng& rng)
      : synthetic(std::move(problem)),
        prepared(synthetic.problem, kPointThresholdPx, kPairThresholdPx, rng),
        pose(query_from_world),
        local(prepared.ToLocal(query_from_world)),
        local_truth(prepared.ToLocal(synthetic.query_from_world)) {}

  ::testing::AssertionResult IsTrue(const CamFromLocal& cam_from_local, double deg,
                                    double units) const {
    return IsNearPose(prepared.ToWorld(cam_from_local), synthetic.query_from_world, deg, units);
  }
};

inline NearTruth MakeNearTruth(Rng& rng, const SyntheticOptions& options, double turn_deg = 0.1,
                               double shift = 0.01) {
  SyntheticProblem problem = MakeSyntheticProblem("near truth", options, rng);
  const auto direction = [&rng] {
    return Eigen::Vector3d{rng.Normal(), rng.Normal(), rng.Normal()}.normalized();
  };
  const Eigen::Vector3d axis = direction();
  const Eigen::Vector3d way = direction();
  const Rigid3 change{RotationFromVector(turn_deg * std::numbers::pi / 180 * axis), shift * way};
  const Rigid3 pose = change * problem.query_from_world;
  return NearTruth(std::move(problem), pose, rng);
}

}  // namespace raylift
