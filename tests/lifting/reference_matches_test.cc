#include "lifting/reference_matches.h"

#include <gtest/gtest.h>

#include "raylift/lifting/depth_alignment.h"

namespace raylift {
namespace {

TEST(HalvesByReference, GivesEachReferenceItsSideOfEveryMatchInOrder) {
  const std::vector<ReferenceMatch> matches = {
      {2, 0, {20, 21}, {1, 2}}, {0, 1, {3, 4}, {10, 11}}, {0, 2, {5, 6}, {22, 23}}};
  const auto halves = HalvesByReference(matches, 4);
  ASSERT_EQ(halves.size(), 4u);
  ASSERT_EQ(halves[0].size(), 3u);
  EXPECT_EQ(halves[0][0].pixel, Eigen::Vector2d(1, 2));
  EXPECT_EQ(halves[0][0].other, 2);
  EXPECT_EQ(halves[0][0].other_px, Eigen::Vector2d(20, 21));
  EXPECT_EQ(halves[0][1].pixel, Eigen::Vector2d(3, 4));
  EXPECT_EQ(halves[0][2].pixel, Eigen::Vector2d(5, 6));
  ASSERT_EQ(halves[1].size(), 1u);
  EXPECT_EQ(halves[1][0].pixel, Eigen::Vector2d(10, 11));
  EXPECT_EQ(halves[1][0].other_px, Eigen::Vector2d(3, 4));
  EXPECT_EQ(halves[2].size(), 2u);
  EXPECT_TRUE(halves[3].empty());
}

}  // namespace
}  // namespace raylift
