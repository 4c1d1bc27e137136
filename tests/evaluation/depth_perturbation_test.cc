#include <cmath>
#include <vector>

#include <gtest/gtest.h>

#include "raylift/base/error.h"
#include "raylift/evaluation/depth_errors.h"
#include "raylift/evaluation/perturbation.h"

namespace raylift {
namespace {

// A wall at 4 with a box at 2 before it, and a hole.
DepthMap Scene() {
  DepthMap map{160, 120, std::vector<float>(size_t{160} * 120, 4.0F)};
  for (size_t y = 30; y < 90; ++y) {
    for (size_t x = 40; x < 100; ++x) map.z[y * 160 + x] = 2;
  }
  for (size_t y = 5; y < 15; ++y) {
    for (size_t x = 5; x < 15; ++x) map.z[y * 160 + x] = 0;
  }
  return map;
}

std::vector<DepthPerturbation> EveryKind() {
  return {{.scale = 1.1},        {.scale_sigma = 0.1},
          {.warp_sigma = 0.05},  {.bubbles = 3},
          {.floaters = 10},      {.flying_share = 0.5},
          {.noise_sigma = 0.02}, {.relative_noise_sigma = 0.02},
          {.hole_share = 0.2},   {.quantization_step = 0.3}};
}

size_t CountHoles(const DepthMap& map) {
  size_t count = 0;
  for (const float z : map.z) count += z == 0;
  return count;
}

TEST(PerturbDepth, IsReproducibleAndDiffersBetweenImagesAndSeeds) {
  const DepthMap map = Scene();
  for (DepthPerturbation kind : EveryKind()) {
    const DepthMap once = PerturbDepth(map, kind, "a");
    EXPECT_EQ(once.z, PerturbDepth(map, kind, "a").z);
    EXPECT_NE(once.z, map.z);
    if (kind.scale != 1 || kind.quantization_step > 0) continue;
    EXPECT_NE(once.z, PerturbDepth(map, kind, "b").z);
    kind.seed = 1;
    EXPECT_NE(once.z, PerturbDepth(map, kind, "a").z);
  }
}

TEST(PerturbDepth, HolesStayHolesAndAllIsFinite) {
  const DepthMap map = Scene();
  for (const DepthPerturbation& kind : EveryKind()) {
    const DepthMap worse = PerturbDepth(map, kind, "a");
    for (size_t i = 0; i < map.z.size(); ++i) {
      EXPECT_TRUE(std::isfinite(worse.z[i]) && worse.z[i] >= 0);
      EXPECT_TRUE(map.z[i] > 0 || worse.z[i] == 0);
    }
  }
}

TEST(PerturbDepth, NothingAskedForChangesNothing) {
  EXPECT_EQ(PerturbDepth(Scene(), {}, "a").z, Scene().z);
}

TEST(PerturbDepth, NoiseHasItsDeviation) {
  const DepthMap map = Scene();
  const auto additive = ComputeDepthErrors(PerturbDepth(map, {.noise_sigma = 0.02}, "a").z, map.z);
  EXPECT_NEAR(additive->rmse, 0.02, 0.001);  // of 19000 pixels: 0.5 %
  const auto relative =
      ComputeDepthErrors(PerturbDepth(map, {.relative_noise_sigma = 0.02}, "a").z, map.z);
  EXPECT_NEAR(relative->rmse_log, 0.02, 0.001);
}

TEST(PerturbDepth, AScaleIsAScaleAndAWarpIsSmooth) {
  const DepthMap map = Scene();
  const DepthMap scaled = PerturbDepth(map, {.scale = 1.1}, "a");
  EXPECT_NEAR(FitDepth(scaled.z, map.z, DepthFitKind::kMedian)->scale, 1 / 1.1, 1e-6);
  const DepthMap warped = PerturbDepth(map, {.warp_sigma = 0.05}, "a");
  EXPECT_GT(ComputeDepthErrors(warped.z, map.z)->si_log, 1);
  EXPECT_EQ(FindDepthEdges(warped), FindDepthEdges(map));
}

TEST(PerturbDepth, HolesHaveTheirShare) {
  const DepthMap map = Scene();
  const size_t added = CountHoles(PerturbDepth(map, {.hole_share = 0.2}, "a")) - CountHoles(map);
  EXPECT_EQ(added, static_cast<size_t>(0.2 * 160 * 120));
}

TEST(PerturbDepth, FlyingPixelsAreAtEdgesAndBetweenTheirSurfaces) {
  const DepthMap map = Scene();
  const DepthMap worse = PerturbDepth(map, {.flying_share = 1}, "a");
  const auto distance = DistanceToSet(FindDepthEdges(map), map.width_px);
  size_t moved = 0;
  for (size_t i = 0; i < map.z.size(); ++i) {
    if (worse.z[i] == map.z[i]) continue;
    ++moved;
    EXPECT_LE(distance[i], 1.5F);
    EXPECT_GE(worse.z[i], 2);
    EXPECT_LE(worse.z[i], 4);
  }
  EXPECT_GT(moved, 400u);  // two rings around a square of 60
}

TEST(PerturbDepth, FloatersAndBubblesAreInFront) {
  const DepthMap map = Scene();
  for (const DepthPerturbation& kind :
       std::vector<DepthPerturbation>{{.bubbles = 5}, {.floaters = 20}}) {
    const DepthMap worse = PerturbDepth(map, kind, "a");
    size_t changed = 0;
    for (size_t i = 0; i < map.z.size(); ++i) {
      EXPECT_LE(worse.z[i], map.z[i]);
      changed += worse.z[i] < map.z[i];
    }
    EXPECT_GT(changed, 50u);
  }
}

TEST(ConfidenceOfPerturbed, FallsWithErrorsThatAreNoScaleWhereItIsInformative) {
  const DepthMap map = Scene();
  const DepthPerturbation kind = {.scale_sigma = 0.4, .warp_sigma = 0.05, .bubbles = 4};
  const DepthMap unseen = PerturbDepth(map, {.scale_sigma = 0.4, .warp_sigma = 0.05}, "a");
  const DepthMap worse = PerturbDepth(map, kind, "a");
  const DepthMap told = ConfidenceOfPerturbed(map, kind, MadeConfidence::kInformative, "a");
  const DepthMap random = ConfidenceOfPerturbed(map, kind, MadeConfidence::kRandom, "a");
  float most_of_wrong = 0, most = 0;
  for (size_t i = 0; i < map.z.size(); ++i) {
    if (map.z[i] == 0) continue;
    const double error = std::abs(std::log(static_cast<double>(worse.z[i] / unseen.z[i])));
    if (error > 0.1) most_of_wrong = std::max(most_of_wrong, told.z[i]);
    most = std::max(most, told.z[i]);
    EXPECT_GT(random.z[i], 1);
  }
  EXPECT_LT(most_of_wrong, 1.3F);
  EXPECT_GT(most, 1.9F);
  EXPECT_NE(random.z, told.z);
}

TEST(PerturbDepth, RefusesNonsense) {
  EXPECT_THROW(DepthPerturbation{.scale = 0}.Validate(), OptionError);
  EXPECT_THROW(DepthPerturbation{.noise_sigma = -1}.Validate(), OptionError);
  EXPECT_THROW(DepthPerturbation{.hole_share = 1.5}.Validate(), OptionError);
  EXPECT_NO_THROW(DepthPerturbation{}.Validate());
}

}  // namespace
}  // namespace raylift
