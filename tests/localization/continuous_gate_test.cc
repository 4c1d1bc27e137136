#include <limits>

#include "localization/continuous/join_gate.h"
#include "support/matchers.h"
#include "support/synthetic_problem.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using testing::HasSubstr;

JoinEvidence GoodEvidence() {
  JoinEvidence evidence;
  evidence.inliers_2d2d = 300;
  evidence.inliers_2d3d = 200;
  evidence.distance = 10;
  evidence.covariance = PoseCovariance::Identity();
  evidence.rotation_sigma_deg = 0.1;
  evidence.position_sigma = 0.05;
  evidence.asked_solvers = true;
  evidence.difference_deg = 0.2;
  evidence.difference_position = 0.1;
  return evidence;
}

TEST(ContinuousGate, AGoodQueryJoins) { EXPECT_EQ(ReasonNotToJoin(GoodEvidence(), {}), ""); }

TEST(ContinuousGate, EachLimitKeepsAQueryOutAndSaysWhy) {
  const auto reason = [](const auto& change, const JoinGateOptions& options = {}) {
    JoinEvidence evidence = GoodEvidence();
    change(evidence);
    return ReasonNotToJoin(evidence, options);
  };
  EXPECT_THAT(reason([](auto& e) { e.inliers_2d2d = 29; }), HasSubstr("29 2D-2D inliers"));
  EXPECT_THAT(reason([](auto& e) { e.inliers_2d3d = 19; }), HasSubstr("19 2D-3D inliers"));
  EXPECT_THAT(reason([](auto& e) { e.covariance.reset(); }), HasSubstr("covariance"));
  EXPECT_THAT(reason([](auto& e) { e.rotation_sigma_deg = 0.6; }), HasSubstr("rotation"));
  EXPECT_THAT(reason([](auto& e) { e.position_sigma = 0.21; }), HasSubstr("0.2 is allowed"));
  EXPECT_THAT(reason([](auto& e) { e.difference_deg = 1.1; }), HasSubstr("differ by 1.1 degrees"));
  EXPECT_THAT(reason([](auto& e) { e.difference_position = 0.6; }), HasSubstr("0.5 is allowed"));
  EXPECT_THAT(reason([](auto& e) { e.difference_deg.reset(); }), HasSubstr("alone finds no pose"));
  EXPECT_THAT(reason([](auto& e) { e.position_sigma = std::numeric_limits<double>::quiet_NaN(); }),
              HasSubstr("position"));
  // Limits in scene units go before shares of the distance.
  EXPECT_EQ(reason([](auto& e) { e.position_sigma = 0.3; }, {.max_position_sigma = 0.4}), "");
  EXPECT_EQ(reason([](auto& e) { e.difference_position = 2; }, {.max_difference_position = 2.5}),
            "");
}

TEST(ContinuousGate, WithoutGeometryPointsAndAgreementAreNotAskedFor) {
  JoinEvidence evidence = GoodEvidence();
  evidence.inliers_2d3d.reset();
  evidence.asked_solvers = false;
  evidence.difference_deg.reset();
  evidence.difference_position.reset();
  EXPECT_EQ(ReasonNotToJoin(evidence, {}), "");
  evidence.asked_solvers = true;
  EXPECT_NE(ReasonNotToJoin(evidence, {}), "");
  EXPECT_EQ(ReasonNotToJoin(evidence, {.needs_agreement = false}), "");
}

TEST(ContinuousGate, LimitsOutOfRangeAreNamed) {
  const auto fails = [](const JoinGateOptions& options) {
    EXPECT_THROW(options.Validate(), OptionError);
  };
  fails({.min_inliers_2d2d = -1});
  fails({.max_rotation_sigma_deg = 0});
  fails({.max_position_sigma = -1});
  fails({.max_difference_deg = std::numeric_limits<double>::infinity()});
  JoinGateOptions().Validate();
}

QueryResult Localize(const SyntheticProblem& synthetic) {
  QueryResult result;
  result.problem = synthetic.problem;
  result.localized.estimate = MakePoseEstimator({})->Estimate(synthetic.problem);
  return result;
}

// Geometry that is turned as a whole by a degree against the references, about the query.
SyntheticProblem WithTurnedGeometry(SyntheticProblem synthetic) {
  const Rigid3 turn = {RotationFromVector({0, 0.02, 0}), Eigen::Vector3d::Zero()};
  for (Match2D3D& match : synthetic.problem.matches_2d3d) {
    match.point_in_world = turn * match.point_in_world;
  }
  return synthetic;
}

TEST(ContinuousGate, SolversAgreeWhereGeometryAndReferencesDo) {
  const SyntheticProblem right = MakeRegime(RegimeByName("accurate"), 1).front();
  const SyntheticProblem wrong = WithTurnedGeometry(right);
  const JoinedReferences none(true);
  for (const SyntheticProblem* synthetic : {&right, &wrong}) {
    const QueryResult result = Localize(*synthetic);
    const JoinEvidence evidence =
        CollectEvidence(result, none, EstimateBySolvers(result.problem, {}, 2));
    EXPECT_GT(evidence.inliers_2d2d, 500);
    EXPECT_TRUE(evidence.difference_deg.has_value());
    EXPECT_EQ(ReasonNotToJoin(evidence, {}).empty(), synthetic == &right)
        << ReasonNotToJoin(evidence, {});
  }
}

TEST(ContinuousGate, TheSolversDifferenceWidensTheCovariance) {
  const QueryResult result = Localize(MakeRegime(RegimeByName("accurate"), 1).front());
  const JoinedReferences none(true);
  const Rigid3 pose = *result.localized.estimate.cam_from_world;
  const Rigid3 beside = Rigid3{Eigen::Quaterniond::Identity(), {0.5, 0, 0}} * pose;
  const JoinEvidence alone = CollectEvidence(result, none, std::nullopt);
  const JoinEvidence differ = CollectEvidence(result, none, SolverPoses{pose, beside});
  EXPECT_NEAR(*differ.difference_position, 0.5, 1e-12);
  EXPECT_NEAR(differ.covariance->diagonal()[3] - alone.covariance->diagonal()[3], 0.0625, 1e-12);
  EXPECT_NEAR(differ.rotation_sigma_deg, alone.rotation_sigma_deg, 1e-9);
}

}  // namespace
}  // namespace raylift
