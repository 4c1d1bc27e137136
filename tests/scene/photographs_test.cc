#include "raylift/scene/photographs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace raylift {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

TEST(Subsampling, KeepsEveryNthFromTheOffset) {
  const std::vector<std::string> cameras(7, "c0");
  EXPECT_THAT(KeptIndices(cameras, {}), ElementsAre(0, 1, 2, 3, 4, 5, 6));
  EXPECT_THAT(KeptIndices(cameras, {.every = 3}), ElementsAre(0, 3, 6));
  EXPECT_THAT(KeptIndices(cameras, {.every = 3, .offset = 2}), ElementsAre(2, 5));
  EXPECT_THAT(KeptIndices(cameras, {.every = 9, .offset = 8}), IsEmpty());
}

// The paper takes every 11th image of Extended CMU Seasons, where two cameras take turns: an even
// number would leave one camera.
TEST(Subsampling, PerCameraKeepsBothCamerasOfARig) {
  std::vector<std::string> cameras;
  for (int i = 0; i < 44; ++i) cameras.push_back(i % 2 == 0 ? "c0" : "c1");
  const auto count = [&](const Subsampling& subsampling, const std::string& camera) {
    size_t kept = 0;
    for (const size_t i : KeptIndices(cameras, subsampling)) kept += cameras[i] == camera ? 1 : 0;
    return kept;
  };
  EXPECT_EQ(count({.every = 10}, "c1"), 0u);
  EXPECT_EQ(count({.every = 11}, "c0"), 2u);
  EXPECT_EQ(count({.every = 11}, "c1"), 2u);
  EXPECT_EQ(count({.every = 10, .per_camera = true}, "c0"), 3u);
  EXPECT_EQ(count({.every = 10, .per_camera = true}, "c1"), 3u);
  EXPECT_THAT(KeptIndices(cameras, {.every = 11, .offset = 3, .per_camera = true}),
              ElementsAre(6, 7, 28, 29));
}

}  // namespace
}  // namespace raylift
