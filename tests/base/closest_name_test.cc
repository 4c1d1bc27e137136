#include "raylift/base/closest_name.h"

#include <vector>

#include <gtest/gtest.h>

namespace raylift {
namespace {

TEST(EditDistance, CountsChangedAddedLostAndSwappedLetters) {
  EXPECT_EQ(EditDistance("", ""), 0u);
  EXPECT_EQ(EditDistance("", "abc"), 3u);
  EXPECT_EQ(EditDistance("render", "render"), 0u);
  EXPECT_EQ(EditDistance("rendr", "render"), 1u);
  EXPECT_EQ(EditDistance("localise", "localize"), 1u);
  EXPECT_EQ(EditDistance("modle", "model"), 1u);
  EXPECT_EQ(EditDistance("ab", "ba"), 1u);
  EXPECT_EQ(EditDistance("kitten", "sitting"), 3u);
}

TEST(EditDistance, IsTheSameBothWays) {
  const std::vector<std::string> words = {"depth", "dpeth", "deep", "", "incidence", "indices"};
  for (const std::string& a : words) {
    for (const std::string& b : words) EXPECT_EQ(EditDistance(a, b), EditDistance(b, a));
  }
}

TEST(ClosestName, IsLikelyOrNone) {
  const std::vector<std::string> names = {"depth", "distance", "color", "mask"};
  EXPECT_EQ(ClosestName("colour", names), "color");
  EXPECT_EQ(ClosestName("dpeth", names), "depth");
  EXPECT_EQ(ClosestName("moon", names), std::nullopt);
  EXPECT_EQ(ClosestName("", names), std::nullopt);
  EXPECT_EQ(DidYouMean("colour", names), "; did you mean color?");
  EXPECT_EQ(DidYouMean("moon", names), "");
}

}  // namespace
}  // namespace raylift
