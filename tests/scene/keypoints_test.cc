#include "raylift/scene/keypoints.h"

#include <cmath>
#include <limits>
#include <string>

#include "support/matchers.h"
#include <gmock/gmock.h>

namespace raylift {
namespace {

using testing::ElementsAre;

Match2D2D Pair(const Eigen::Vector2d& query_px, std::optional<int> keypoint = std::nullopt) {
  return {.reference = 0, .query_px = query_px, .reference_px = {1, 1}, .query_keypoint = keypoint};
}

Match2D3D Point(const Eigen::Vector2d& query_px, std::optional<int> keypoint = std::nullopt) {
  return {.query_px = query_px,
          .point_in_world = {0, 0, 1},
          .reference = {},
          .point_sigma = {},
          .query_keypoint = keypoint};
}

TEST(CanonicalKeypoints, FeaturesAtOnePlaceAreTheFirstOfThem) {
  const std::vector<Eigen::Vector2d> pixels = {{5, 7}, {1, 2}, {5, 7}, {7, 5}, {1, 2}, {5, 7}};
  EXPECT_THAT(CanonicalKeypoints(pixels), ElementsAre(0, 1, 0, 3, 1, 0));
  EXPECT_TRUE(CanonicalKeypoints({}).empty());
}

TEST(CanonicalKeypoints, ZerosAreEqualAndWhatIsNotFiniteIsNothingElse) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<Eigen::Vector2d> pixels = {{0, 0}, {-0.0, 0}, {kNan, 0}, {kNan, 0}};
  EXPECT_THAT(CanonicalKeypoints(pixels), ElementsAre(0, 0, 2, 3));
}

TEST(NumberQueryKeypoints, EqualIndicesAreOneKeypointWhereverItsPixelsAre) {
  const double next = std::nextafter(2.5, 3);
  const std::vector<Match2D2D> pairs = {Pair({2.5, 1}, 40), Pair({9, 9}, 7), Pair({next, 1}, 40)};
  const std::vector<Match2D3D> points = {Point({next, 1}, 40), Point({2.5, 1}, 8)};
  const KeypointNumbers numbers = NumberQueryKeypoints(pairs, points);
  EXPECT_THAT(numbers.of_2d2d, ElementsAre(0, 1, 0));
  EXPECT_THAT(numbers.of_2d3d, ElementsAre(0, 2));
  EXPECT_EQ(numbers.count, 3u);
}

TEST(NumberQueryKeypoints, WithoutIndicesEqualPixelsAreOneKeypoint) {
  const std::vector<Match2D2D> pairs = {Pair({2, 1}), Pair({9, 9}), Pair({2, 1})};
  const std::vector<Match2D3D> points = {Point({4, 4}), Point({9, 9})};
  const KeypointNumbers numbers = NumberQueryKeypoints(pairs, points);
  EXPECT_THAT(numbers.of_2d2d, ElementsAre(0, 1, 0));
  EXPECT_THAT(numbers.of_2d3d, ElementsAre(2, 1));
  EXPECT_EQ(numbers.count, 3u);
}

TEST(AssignKeypointsByPixel, AMatchWithoutAnIndexTakesThatOfItsPixel) {
  PoseProblem problem;
  problem.matches_2d2d = {Pair({3, 3}), Pair({1, 1}), Pair({2, 2}, 5), Pair({1, 1}, 9)};
  problem.matches_2d3d = {Point({2, 2}), Point({3, 3}), Point({4, 4}), Point({1, 1}, 2)};
  AssignKeypointsByPixel(problem);
  const auto index = [](const auto& match) { return match.query_keypoint.value(); };
  std::vector<int> of_pairs, of_points;
  for (const Match2D2D& match : problem.matches_2d2d) of_pairs.push_back(index(match));
  for (const Match2D3D& match : problem.matches_2d3d) of_points.push_back(index(match));
  EXPECT_THAT(of_pairs, ElementsAre(10, 9, 5, 9));
  EXPECT_THAT(of_points, ElementsAre(5, 10, 11, 2));
}

TEST(AssignKeypointsByPixel, AnIndexOutOfRangeIsNamed) {
  for (const int index : {-1, kLargestKeypoint + 1}) {
    PoseProblem problem;
    problem.matches_2d2d = {Pair({3, 3}, index)};
    EXPECT_TRUE(FailsWithInputError([&] { AssignKeypointsByPixel(problem); },
                                    {"query_keypoint", std::to_string(index)}));
  }
}

}  // namespace
}  // namespace raylift
