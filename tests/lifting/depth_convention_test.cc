#include "lifting/depth_convention.h"

#include <limits>

#include "support/enum_names.h"
#include "support/matchers.h"
#include "support/meshes.h"

namespace raylift {
namespace {

StoredDepth Stored(int width, int height, std::vector<float> values, const char* type) {
  StoredDepth stored;
  stored.width_px = width;
  stored.height_px = height;
  stored.values = std::move(values);
  stored.sample_type = type;
  return stored;
}

TEST(DepthConvention, EveryKindGivesTheSameDepthThroughEveryLens) {
  Rng rng = TestRng();
  for (const Camera& full : CamerasOfEveryModel()) {
    const Camera camera = full.Scaled(32, 24);  // the maps have half the image's size
    std::vector<float> z, ray, inverse;
    for (int y = 0; y < 24; ++y) {
      for (int x = 0; x < 32; ++x) {
        const double depth = rng.Uniform(1, 20);
        const double cosine = camera.RayInCam({x + 0.5, y + 0.5})->z();
        z.push_back(static_cast<float>(depth));
        ray.push_back(static_cast<float>(depth / cosine));
        inverse.push_back(static_cast<float>(1 / depth));
      }
    }
    const DepthMap from_z = ToDepthMap(Stored(32, 24, z, "float32"), full, {});
    const DepthMap from_ray =
        ToDepthMap(Stored(32, 24, ray, "float32"), full, {.kind = DepthKind::kRay});
    const DepthMap from_inverse =
        ToDepthMap(Stored(32, 24, inverse, "float32"), full, {.kind = DepthKind::kInverse});
    for (size_t i = 0; i < z.size(); ++i) {
      EXPECT_EQ(from_z.z[i], z[i]);
      EXPECT_NEAR(from_ray.z[i], z[i], 1e-6f * z[i]) << full.ToString();
      EXPECT_NEAR(from_inverse.z[i], z[i], 1e-6f * z[i]);
    }
  }
}

TEST(DepthConvention, WhatIsNoDepthBecomesZero) {
  constexpr float kInf = std::numeric_limits<float>::infinity();
  const StoredDepth stored = Stored(8, 1, {0, -1, kInf, NAN, 65535, 2000, 5000, -kInf}, "uint16");
  const DepthMap map =
      ToDepthMap(stored, Camera(), {.unit = 0.001, .invalid_values = {65535}, .max_depth = 4});
  EXPECT_EQ(map.z, (std::vector<float>{0, 0, 0, 0, 0, 2, 0, 0}));
}

TEST(DepthConvention, IntegersAreMillimetersUnlessTheUnitIsGiven) {
  const DepthConvention none;
  EXPECT_EQ(ToDepthMap(Stored(1, 1, {1500}, "uint16"), Camera(), none).z[0], 1.5f);
  EXPECT_EQ(ToDepthMap(Stored(1, 1, {1500}, "float32"), Camera(), none).z[0], 1500.0f);
  EXPECT_EQ(ToDepthMap(Stored(1, 1, {1500}, "uint16"), Camera(), {.unit = 0.01}).z[0], 15.0f);
  EXPECT_EQ(ToDepthMap(Stored(1, 1, {1500}, "uint16"), Camera(), {.unit = 0.01, .scale = 2}).z[0],
            30.0f);
}

TEST(DepthConvention, UntrustedPixelsAreHolesWhateverTheConfidenceMapsSize) {
  const StoredDepth stored = Stored(4, 2, std::vector<float>(8, 1), "float32");
  const StoredDepth same = Stored(4, 2, {0, 1, 0.5f, 0.4f, 1, 1, 0, NAN}, "float32");
  EXPECT_EQ(ToDepthMap(stored, Camera(), {}, &same).z,
            (std::vector<float>{0, 1, 1, 0, 1, 1, 0, 0}));
  const StoredDepth small = Stored(2, 1, {0, 1}, "float32");
  EXPECT_EQ(ToDepthMap(stored, Camera(), {}, &small).z,
            (std::vector<float>{0, 0, 1, 1, 0, 0, 1, 1}));
}

TEST(DepthConvention, PatternsNameTheFileOfAnImage) {
  EXPECT_EQ(ExpandPattern("{name}.bin", "a/b.c.jpg"), "a/b.c.jpg.bin");
  EXPECT_EQ(ExpandPattern("{dir}/{stem}.npy", "a/b.c.jpg"), "a/b.c.npy");
  EXPECT_EQ(ExpandPattern("{dir}/{stem}.npy", "b.jpg"), "b.npy");
  EXPECT_EQ(ExpandPattern("{dir}/{base}_depth.npz", "a/b.c.jpg"), "a/b_depth.npz");
  EXPECT_EQ(ExpandPattern("{flat}_depth.npz", "s/a/b.c.jpg"), "s_a_b_depth.npz");
  EXPECT_EQ(ExpandPattern("{flat}_depth.npz", "b.jpg"), "b_depth.npz");
  EXPECT_EQ(ExpandPattern("{flat7}.pose.depth.tiff", "seq-01/frame-000000.color.png"),
            "seq01_frame-000000.pose.depth.tiff");
  EXPECT_EQ(ExpandPattern("{index}/{stem}_{index}", "b.jpg", 7), "00000007/b_00000007");
  EXPECT_EQ(ExpandPattern("{index}", "b.jpg"), "{index}");
}

TEST(DepthConvention, PresetsAreKnownByName) {
  for (const char* name : {"colmap", "nerfstudio", "metric3d", "7scenes", "7scenes_sensor",
                           "12scenes", "scannet", "tum", "meshloc", "lamar", "eth3d", "kapture"}) {
    const auto preset = DepthPreset(name);
    ASSERT_TRUE(preset) << name;
    EXPECT_TRUE(preset->unit);
    EXPECT_FALSE(preset->patterns.empty());
    EXPECT_NE(DepthPresetNames().find(name), std::string::npos);
  }
  EXPECT_FALSE(DepthPreset("foo"));
  EXPECT_EQ(DepthPreset("nerfstudio")->kind, DepthKind::kRay);
  EXPECT_EQ(DepthPreset("tum")->unit, 1.0 / 5000);
}

TEST(Oriented, TellsWhereSamplesLie) {
  using enum MapOrientation;
  StoredDepth stored;
  stored.width_px = 3;
  stored.height_px = 2;
  stored.values = {1, 2, 3, 4, 5, 6};
  const auto values = [&](MapOrientation orientation) {
    return Oriented(stored, orientation).values;
  };
  EXPECT_EQ(values(kAsStored), stored.values);
  EXPECT_EQ(values(kFlippedX), (std::vector<float>{3, 2, 1, 6, 5, 4}));
  EXPECT_EQ(values(kFlippedY), (std::vector<float>{4, 5, 6, 1, 2, 3}));
  EXPECT_EQ(values(kHalfTurn), (std::vector<float>{6, 5, 4, 3, 2, 1}));
  EXPECT_EQ(values(kTransposed), (std::vector<float>{1, 4, 2, 5, 3, 6}));
  EXPECT_EQ(Oriented(stored, kTransposed).width_px, 2);
  for (const MapOrientation o : {kFlippedX, kFlippedY, kHalfTurn, kTransposed}) {
    EXPECT_EQ(Oriented(Oriented(stored, o), o).values, stored.values) << ToString(o);
  }
}

TEST(DepthConvention, ItsValuesHaveNames) {
  EXPECT_TRUE(NamesEveryValue<DepthKind>());
  EXPECT_TRUE(NamesEveryValue<MapOrientation>());
  EXPECT_TRUE(NamesEveryValue<MapFit>());
  EXPECT_TRUE(NamesEveryValue<PointFrame>());
}

}  // namespace
}  // namespace raylift
