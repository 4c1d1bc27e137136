#include "estimation/problem/repeats.h"

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

#include "support/coherent_problem.h"
#include "support/matchers.h"
#include <gmock/gmock.h>

#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"

namespace raylift {
namespace {

using ::testing::ElementsAre;

constexpr double kWithinPx = 0.2;

Match2D2D Pair(int reference, const Eigen::Vector2d& query_px,
               const Eigen::Vector2d& reference_px) {
  Match2D2D match;
  match.reference = reference;
  match.query_px = query_px;
  match.reference_px = reference_px;
  return match;
}

PoseProblem OfTwoReferences(std::vector<Match2D2D> pairs, std::vector<Match2D3D> points) {
  PoseProblem problem;
  problem.query_camera =
      Camera(CameraModel::kPinhole, 1600, 1200, std::vector<double>{1000, 1000, 800, 600});
  problem.references.resize(2);
  problem.matches_2d2d = std::move(pairs);
  problem.matches_2d3d = std::move(points);
  return problem;
}

Repeats Find(const PoseProblem& problem, double within_px = kWithinPx) {
  return FindRepeats(problem, within_px, Eigen::Vector3d::Zero());
}

TEST(FindRepeats, APairOfOneReferenceRepeatsOneThatCoincidesInBothImages) {
  const PoseProblem problem = OfTwoReferences(
      {Pair(0, {50, 60}, {10, 10}), Pair(0, {50.1, 60.1}, {10.1, 10}),  // the same
       Pair(1, {50, 60.1}, {10, 10}), Pair(0, {50, 60}, {10.3, 10}), Pair(0, {50.3, 60}, {10, 10})},
      {});
  const Repeats repeats = Find(problem);
  EXPECT_THAT(repeats.of_2d2d, ElementsAre(0, 0, 2, 3, 4));
  EXPECT_THAT(repeats.keypoints.of_2d2d, ElementsAre(0, 0, 0, 0, 3));
  EXPECT_THAT(Find(problem, 0).of_2d2d, ElementsAre(0, 1, 2, 3, 4));
}

TEST(FindRepeats, PointsOfOneReferenceRepeatThoseThatAreSeenAtTheirPixel) {
  const Eigen::Vector3d at(1, 2, 10), near(1.001, 2, 10), beyond(1, 2, 10.01);
  const PoseProblem problem = OfTwoReferences(
      {Pair(0, {90, 60}, {10, 10})}, {{{50, 60}, at},
                                      {{50.1, 60}, near},
                                      {{50, 60}, beyond},
                                      {.query_px = {50, 60}, .point_in_world = at, .reference = 1},
                                      {{70, 60}, at}});
  EXPECT_THAT(Find(problem).of_2d3d, ElementsAre(0, 0, 2, 3, 4));
  const PoseProblem of_points = OfTwoReferences({}, problem.matches_2d3d);
  EXPECT_THAT(Find(of_points).of_2d3d, ElementsAre(0, 1, 2, 3, 4));
}

// A depth is a depth of its own pair, however far it is from that of the pair's repeat.
TEST(FindRepeats, PointsRepeatAsTheirPairsDo) {
  const Match2D2D pair = Pair(0, {50, 60}, {10, 10}), again = Pair(0, {50.1, 60}, {10.1, 10});
  const Match2D3D near = {.query_px = {50, 60}, .point_in_world = {1, 2, 10}, .match_2d2d = 0};
  const Match2D3D far = {.query_px = {50.1, 60}, .point_in_world = {1, 2, 12}, .match_2d2d = 1};
  const Repeats of_both = Find(OfTwoReferences({pair, again}, {near, far}));
  EXPECT_THAT(of_both.of_2d2d, ElementsAre(0, 0));
  EXPECT_THAT(of_both.of_2d3d, ElementsAre(0, 0));
  const Repeats in_other_order = Find(OfTwoReferences({pair, again}, {far, near, near}));
  EXPECT_THAT(in_other_order.of_2d2d, ElementsAre(1, 1));
  EXPECT_THAT(in_other_order.of_2d3d, ElementsAre(0, 0, 0));
  const Repeats with_hole = Find(OfTwoReferences({pair, again}, {far}));
  EXPECT_THAT(with_hole.of_2d2d, ElementsAre(1, 1));
  EXPECT_THAT(with_hole.of_2d3d, ElementsAre(0));
}

TEST(FindRepeats, WhatIsNotFiniteOrOfNoReferenceRepeatsNothing) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const PoseProblem problem = OfTwoReferences(
      {Pair(0, {50, nan}, {10, 10}), Pair(0, {50, nan}, {10, 10}), Pair(0, {50, 60}, {nan, 10}),
       Pair(0, {50, 60}, {nan, 10}), Pair(-1, {50, 60}, {10, 10}), Pair(1, {50, 60}, {10, 10})},
      {});
  EXPECT_THAT(Find(problem).of_2d2d, ElementsAre(0, 1, 2, 3, 4, 5));
}

// Detectors find one feature twice, .05 px apart, which matches take for two keypoints.
TEST(Repeats, ChangeNeitherAPoseNorItsCovariance) {
  Rng rng = TestRng();
  const std::pair<CoherentOptions, double> kinds[] = {
      {{}, 1},
      {{}, 1.2},
      {{.wrong = 0.1, .surface = 0.007}, 1},
      {{.vertical = 0.5, .reference_factor = 0.08}, 1}};
  for (const auto& [options, focal_range] : kinds) {
    CoherentProblem once = MakeCoherentProblem("once", options, rng);
    once.problem.priors.focal_range = focal_range;
    PoseProblem again = once.problem;
    const auto off = [&]() -> Eigen::Vector2d {
      return 0.05 * Eigen::Vector2d(rng.Normal(), rng.Normal());
    };
    std::vector<Eigen::Vector2d> query_off(1000);
    std::generate(query_off.begin(), query_off.end(), off);
    const auto repeat = [&](auto match) {
      match.query_px += query_off.at(static_cast<size_t>(*match.query_keypoint));
      *match.query_keypoint += 1000;
      return match;
    };
    for (const Match2D2D& match : once.problem.matches_2d2d) {
      again.matches_2d2d.push_back(repeat(match));
      again.matches_2d2d.back().reference_px += off();
    }
    for (const Match2D3D& match : once.problem.matches_2d3d) {
      again.matches_2d3d.push_back(repeat(match));
      *again.matches_2d3d.back().match_2d2d += once.problem.matches_2d2d.size();
    }
    const PoseEstimate of_once = MakePoseEstimator({})->Estimate(once.problem);
    const PoseEstimate of_again = MakePoseEstimator({})->Estimate(again);
    ASSERT_TRUE(of_once.covariance && of_again.covariance);
    // Another order of the matches alone changes as much.
    EXPECT_NEAR(of_again.position_sigma, of_once.position_sigma, 0.1 * of_once.position_sigma);
    const Eigen::Vector3d moved =
        of_again.cam_from_world->OriginInSource() - of_once.cam_from_world->OriginInSource();
    EXPECT_LT(moved.norm(), 0.7 * of_once.position_sigma);
    // Each is an inlier where what it repeats is.
    EXPECT_EQ(of_again.score_2d2d.num_inliers,
              std::count(of_again.inliers_2d2d.begin(), of_again.inliers_2d2d.end(), true));
    EXPECT_EQ(of_again.score_2d2d.num_matches, 2 * of_once.score_2d2d.num_matches);
    EXPECT_NEAR(of_again.score_2d2d.num_inliers, 2 * of_once.score_2d2d.num_inliers, 20);
  }
}

}  // namespace
}  // namespace raylift
