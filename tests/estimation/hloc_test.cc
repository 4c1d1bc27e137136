#include <cmath>

#include "estimation/methods/methods.h"
#include <gmock/gmock.h>

namespace raylift {
namespace {

using testing::ElementsAre;

TEST(ClusterBySharedKeypoints, AKeypointMatchedInTwoReferencesLinksThem) {
  PoseProblem problem;
  problem.references.resize(5);
  problem.matches_2d2d = {{0, {1, 1}, {5, 5}},
                          {1, {2, 2}, {5, 5}},
                          {3, {1, 1}, {5, 5}},
                          {4, {2, 3}, {5, 5}},
                          {7, {2, 3}, {5, 5}}};
  EXPECT_THAT(ClusterBySharedKeypoints(problem), ElementsAre(0, 1, 2, 0, 3));
}

TEST(ClusterBySharedKeypoints, IndicesSayWhichMatchesAreOfOneKeypoint) {
  PoseProblem problem;
  problem.references.resize(3);
  problem.matches_2d2d = {
      {.reference = 0, .query_px = {1, 1}, .reference_px = {5, 5}, .query_keypoint = 8},
      {.reference = 1, .query_px = {1, 1}, .reference_px = {5, 5}, .query_keypoint = 9},
      {.reference = 2,
       .query_px = {std::nextafter(1, 2), 1},
       .reference_px = {5, 5},
       .query_keypoint = 8}};
  EXPECT_THAT(ClusterBySharedKeypoints(problem), ElementsAre(0, 1, 0));
}

}  // namespace
}  // namespace raylift
