// What is known of a pose beforehand: its cost, and what it does to estimates.

#include <algorithm>
#include <cmath>
#include <numbers>

#include "estimation/problem/priors.h"
#include "estimation/refinement/pose_minimizer.h"
#include "estimation/standard_options.h"
#include "support/coherent_problem.h"
#include "support/matchers.h"

#include "raylift/base/error.h"

namespace raylift {
namespace {

using Eigen::Vector3d;

#ifdef __SANITIZE_ADDRESS__
constexpr int kPriorProblems = 4;
#else
constexpr int kPriorProblems = 25;
#endif

Vector3d DrawDirection(Rng& rng) {
  const double x = rng.Normal();
  const double y = rng.Normal();
  return Vector3d(x, y, rng.Normal()).normalized();
}

PosePriors RightPriors(const Rigid3& truth, double sigma, double sigma_deg) {
  const Vector3d down(0.1, -0.2, -2);
  return {.position = PositionPrior{truth.OriginInSource(), Vector3d::Constant(sigma)},
          .gravity = GravityPrior{truth.rotation * down, down, sigma_deg},
          .heading = HeadingPrior{.right_in_world = truth.rotation.conjugate() * Vector3d::UnitX(),
                                  .down_in_world = down,
                                  .sigma_deg = sigma_deg},
          .orientation = OrientationPrior{truth.rotation, sigma_deg}};
}

// That of a surface with this normal, so far ahead of the camera.
RangePrior RangeOf(const Rigid3& truth, double range, double sigma, const Vector3d& normal) {
  const Vector3d ahead = truth.rotation.conjugate() * Vector3d::UnitZ();
  return {.range = range,
          .sigma = sigma,
          .plane = RangePrior::Plane{truth.OriginInSource() + range * ahead, normal}};
}

TEST(PosePriors, GradientIsHalfOfTheCostsSlope) {
  Rng rng = TestRng();
  for (int i = 0; i < 50; ++i) {
    const Rigid3 truth = RandomRigid3(rng, 2);
    PosePriors known = RightPriors(truth, 0.3, 5);
    known.range = RangeOf(truth, 4, 0.3, DrawDirection(rng));
    const NormalizedPriors priors(known, Vector3d(0.1, 0.2, 0.3), 1.5, {});
    CamFromLocal pose{truth.rotation.toRotationMatrix(),
                      (truth.translation + truth.rotation * Vector3d(0.1, 0.2, 0.3)) / 1.5};
    Vector6d off;
    for (double& x : off) x = 0.1 * rng.Normal();
    pose = Moved(pose, off);
    const auto at = [&](const CamFromLocal& where) {
      NormalEquations equations;
      priors.AddTo(where, 0.7, equations);
      return equations;
    };
    const NormalEquations equations = at(pose);
    for (int k = 0; k < 6; ++k) {
      const Vector6d step = 1e-6 * Vector6d::Unit(k);
      const double slope = (at(Moved(pose, step)).cost - at(Moved(pose, -step)).cost) / 2e-6;
      EXPECT_NEAR(equations.gradient[k], 0.5 * slope, 1e-5 * (1 + std::abs(slope)));
    }
    EXPECT_NEAR(equations.cost, 0.7 * 2.5 * 2.5 * priors.Cost(pose), 1e-9);
    EXPECT_LT(priors.Cost(pose), priors.WorstCost());
  }
}

TEST(PosePriors, ACostIsBoundedAndNoneIsNone) {
  const NormalizedPriors none;
  const CamFromLocal pose{Eigen::Matrix3d::Identity(), Vector3d(1e6, 0, 0)};
  EXPECT_TRUE(none.empty());
  EXPECT_EQ(none.Cost(pose), 0);
  EXPECT_EQ(none.WorstCost(), 0);
  const NormalizedPriors priors(RightPriors(Rigid3(), 1, 2), Vector3d::Zero(), 1, {});
  EXPECT_LE(priors.Cost(pose), priors.WorstCost());
  EXPECT_LT(priors.WorstCost(), 40);  // matches
  EXPECT_NEAR(priors.ProbabilityOfPosition(pose), 0, 1e-12);
  EXPECT_GT(priors.ProbabilityOfGravity(pose), 0.95);
}

TEST(PosePriors, WhatIsNotFiniteIsNamed) {
  const auto prepare = [](const PosePriors& priors) {
    return [priors] { NormalizedPriors(priors, Vector3d::Zero(), 1, {}); };
  };
  const Vector3d nan = Vector3d::Constant(std::nan(""));
  EXPECT_TRUE(FailsWithInputError(prepare({.position = PositionPrior{nan, Vector3d::Ones()}}),
                                  {"position prior"}));
  EXPECT_TRUE(
      FailsWithInputError(prepare({.position = PositionPrior{Vector3d::Zero(), -Vector3d::Ones()}}),
                          {"position prior"}));
  EXPECT_TRUE(FailsWithInputError(
      prepare({.gravity = GravityPrior{Vector3d::Zero(), Vector3d::UnitZ(), 1}}),
      {"gravity prior, down_in_cam"}));
  EXPECT_TRUE(FailsWithInputError(prepare({.gravity = GravityPrior{Vector3d::UnitZ(), nan, 1}}),
                                  {"gravity prior, down_in_world"}));
  EXPECT_TRUE(
      FailsWithInputError(prepare({.heading = HeadingPrior{.right_in_world = Vector3d::UnitZ(),
                                                           .down_in_world = Vector3d::UnitZ()}}),
                          {"heading prior, right_in_world"}));
  EXPECT_TRUE(FailsWithInputError(
      prepare({.orientation = OrientationPrior{Eigen::Quaterniond(2, 0, 0, 0), 1}}),
      {"orientation prior: expected a unit quaternion"}));
  EXPECT_TRUE(FailsWithInputError(prepare({.range = RangeOf(Rigid3(), -1, 1, Vector3d::UnitZ())}),
                                  {"range prior"}));
  EXPECT_TRUE(FailsWithInputError(prepare({.range = RangeOf(Rigid3(), 1, 1, Vector3d::Zero())}),
                                  {"range prior, normal"}));
}

// East is right of a camera that looks north; one that looks east is off by a right angle.
TEST(PosePriors, AHeadingTurnsAboutTheVertical) {
  const NormalizedPriors priors({.heading = HeadingPrior{.right_in_world = Vector3d::UnitX(),
                                                         .down_in_world = -Vector3d::UnitZ(),
                                                         .sigma_deg = 10}},
                                Vector3d::Zero(), 1, {});
  const auto cost = [&](const Vector3d& right, const Vector3d& down) {
    Eigen::Matrix3d rotation;
    rotation << right.transpose(), down.transpose(), right.cross(down).transpose();
    return priors.Cost({rotation, Vector3d::Zero()});
  };
  const Vector3d east = Vector3d::UnitX(), north = Vector3d::UnitY(), up = Vector3d::UnitZ();
  EXPECT_NEAR(cost(east, -up), 0, 1e-12);
  EXPECT_NEAR(cost(east, -north), 0, 1e-12) << "straight down, north at the top";
  EXPECT_GT(cost(-north, -up), 0.9 * priors.WorstCost()) << "looks east";
  EXPECT_GT(cost(-east, -up), 0.9 * priors.WorstCost()) << "looks south";
  // Rolled by a right angle: right points down, and the heading says nothing. That is better than
  // a wrong one, and no way to make up for it.
  EXPECT_GT(cost(-up, -east), 0.2 * priors.WorstCost());
  EXPECT_LT(cost(-up, -east), cost(-north, -up));
  NormalEquations equations;
  Eigen::Matrix3d rolled;
  rolled << -up.transpose(), -east.transpose(), up.cross(east).transpose();
  priors.AddTo({rolled, Vector3d::Zero()}, 1, equations);
  EXPECT_NEAR(equations.cost * kSquaredSigma, cost(-up, -east), 1e-12);
}

// Ten standard deviations are too many for a pose that is certain, and few for one that is not.
TEST(PosePriors, PullsAtPosesThatMayYetComeThere) {
  const PosePriors known{.position = PositionPrior{{1, 0, 0}, Vector3d::Constant(0.1)}};
  const NormalizedPriors priors(known, Vector3d::Zero(), 1, {});
  const CamFromLocal pose{Eigen::Matrix3d::Identity(), Vector3d::Zero()};
  const auto information = [&](double variance) {
    Matrix6d covariance = Matrix6d::Zero();
    covariance.diagonal().tail<3>().setConstant(variance);
    NormalEquations equations;
    priors.AddTo(pose, covariance, equations);
    return equations.hessian(3, 3);
  };
  EXPECT_LT(information(0), 1e-6);
  EXPECT_NEAR(information(1), 100, 3);
}

// Few right matches among many wrong ones.
CoherentOptions FewCoherentMatches() {
  return {.num_keypoints = 10, .num_references = 2, .wrong = 0.7, .sigma_px = 1};
}

struct Counts {
  int without = 0;  // poses within half a meter, 20 m from the facade
  int with = 0;
};

template <typename MakePriors>
Counts CountRight(Method method, Rng& rng, const MakePriors& make_priors) {
  Counts counts;
  for (int i = 0; i < kPriorProblems; ++i) {
    CoherentProblem made = MakeCoherentProblem("few", FewCoherentMatches(), rng);
    const auto right = [&] {
      const PoseEstimate estimate = EstimateWith(method, made.problem);
      EXPECT_TRUE(IsSound(estimate, made.problem));
      return PositionErrorOrFar(estimate, made.query_from_world) < 0.5 ? 1 : 0;
    };
    counts.without += right();
    made.problem.priors = make_priors(made.query_from_world);
    counts.with += right();
  }
  return counts;
}

// A camera that looks down from a height of 10 over a slope of one to two.
TEST(PosePriors, ARangeIsMeasuredAlongTheOpticalAxis) {
  Eigen::Matrix3d looks_down;
  looks_down << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  const Vector3d normal(1, 0, 2);
  PosePriors known;
  known.range = {.range = 10, .sigma = 0.1, .plane = RangePrior::Plane{{0, 0, 0}, normal}};
  const NormalizedPriors priors(known, Vector3d::Zero(), 1, {});
  const auto cost = [&](const Vector3d& center) {
    return priors.Cost({looks_down, -(looks_down * center)});
  };
  EXPECT_NEAR(cost({0, 3, 10}), 0, 1e-12);
  EXPECT_NEAR(cost({2, 0, 9}), 0, 1e-12) << "the ground falls by 1";
  EXPECT_GT(cost({2, 0, 10}), 0.9 * priors.WorstCost());
  // One that sees the ground edge-on does not get away with that.
  Eigen::Matrix3d looks_along;
  looks_along << 1, 0, 2, 0, -std::sqrt(5), 0, 2, 0, -1;
  looks_along /= std::sqrt(5);
  EXPECT_GT(priors.Cost({looks_along, Vector3d::Zero()}), 0.2 * priors.WorstCost());
  // Of what the pose itself looks at, agreement is no evidence, but contradiction is.
  const auto evidence = [&](const Vector3d& center) {
    return priors.LogEvidence({looks_down, -(looks_down * center)});
  };
  EXPECT_EQ(evidence({0, 0, 10}), 0);
  EXPECT_LT(evidence({0, 0, 12}), -2);
  known.range->plane.reset();
  EXPECT_TRUE(NormalizedPriors(known, Vector3d::Zero(), 1, {}).empty()) << "of an unknown surface";
}

TEST(PosePriors, HelpWhereMatchesAreFew) {
  Rng rng = TestRng();
  for (const Method method : {Method::kP3p, Method::kAdaptive}) {
    const Counts position = CountRight(method, rng, [](const Rigid3& truth) {
      return PosePriors{.position = RightPriors(truth, 0.2, 1).position};
    });
    EXPECT_GE(position.with, position.without) << ToString(method);
    const Counts gravity = CountRight(method, rng, [](const Rigid3& truth) {
      return PosePriors{.gravity = RightPriors(truth, 1, 0.5).gravity};
    });
    EXPECT_GE(gravity.with, gravity.without) << ToString(method);
    const int with = position.with + gravity.with;
    EXPECT_GT(with, 1.2 * (position.without + gravity.without)) << ToString(method);
  }
}

TEST(PosePriors, AWrongOneTakesNothingFromManyMatches) {
  Rng rng = TestRng();
  double log_ratio = 0;
  for (int i = 0; i < kPriorProblems; ++i) {
    CoherentProblem made = MakeCoherentProblem("many", {.num_keypoints = 150}, rng);
    const PoseEstimate without = EstimateWith(Method::kAdaptive, made.problem);
    made.problem.priors = RightPriors(made.query_from_world, 1, 1);
    made.problem.priors.position->position += 50 * DrawDirection(rng);
    made.problem.priors.gravity->down_in_cam = DrawDirection(rng);
    made.problem.priors.heading->right_in_world = DrawDirection(rng);
    made.problem.priors.orientation->cam_from_world = RandomRigid3(rng, 1).rotation;
    const PoseEstimate with = EstimateWith(Method::kAdaptive, made.problem);
    ASSERT_TRUE(without.cam_from_world && with.cam_from_world);
    log_ratio += std::log(PositionErrorOrFar(with, made.query_from_world) /
                          PositionErrorOrFar(without, made.query_from_world)) /
                 kPriorProblems;
  }
  EXPECT_LT(std::abs(log_ratio), 0.01);
}

TEST(PosePriors, AnExactPositionIsKept) {
  Rng rng = TestRng();
  CoherentProblem made = MakeCoherentProblem("exact", {.num_keypoints = 60}, rng);
  made.problem.priors.position = PositionPrior{made.query_from_world.OriginInSource()};
  for (const Method method : {Method::kP3p, Method::kAdaptive}) {
    EXPECT_LT(PositionErrorOrFar(EstimateWith(method, made.problem), made.query_from_world), 1e-3)
        << ToString(method);
  }
}

}  // namespace
}  // namespace raylift
