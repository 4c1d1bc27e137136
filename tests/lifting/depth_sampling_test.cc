#include "lifting/depth_sampling.h"

#include <cmath>
#include <functional>

#include "support/enum_names.h"
#include "support/matchers.h"

namespace raylift {
namespace {

// 1/z by a function of the pixel center; 0 or less is a hole.
DepthMap MakeMap(int width, int height, const std::function<double(double, double)>& inverse_z) {
  DepthMap map{width, height, {}};
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double w = inverse_z(x + 0.5, y + 0.5);
      map.z.push_back(w > 0 ? static_cast<float>(1 / w) : 0.0f);
    }
  }
  return map;
}

double SlantedPlane(double x, double y) { return 0.2 + 0.004 * x - 0.003 * y; }

// Depths are floats, good to 6e-8 relative; interpolation doubles that at most.
constexpr double kFloatTolerance = 2e-7;

TEST(SampleDepth, PlanesAreExactBetweenPixelsAndAtBorders) {
  const DepthMap map = MakeMap(40, 30, SlantedPlane);
  Rng rng = TestRng();
  for (int i = 0; i < 5000; ++i) {
    const Eigen::Vector2d at(rng.Uniform(0, 40), rng.Uniform(0, 30));
    const auto sample = SampleDepth(map, at, {});
    ASSERT_TRUE(sample);
    const double z = 1 / SlantedPlane(at.x(), at.y());
    EXPECT_NEAR(sample->z, z, kFloatTolerance * z) << at.transpose();
    EXPECT_TRUE(sample->has_gradient);
    EXPECT_NEAR(sample->inverse_z_gradient.x(), 0.004, 1e-6);
    EXPECT_NEAR(sample->inverse_z_gradient.y(), -0.003, 1e-6);
    EXPECT_LT(sample->depth_jump, 1e-5);
  }
  for (const Eigen::Vector2d& corner : {Eigen::Vector2d(0, 0), Eigen::Vector2d(40, 30)}) {
    EXPECT_TRUE(SampleDepth(map, corner, {}));
  }
  for (const Eigen::Vector2d& outside :
       {Eigen::Vector2d(-0.01, 5), Eigen::Vector2d(5, 30.01), Eigen::Vector2d(NAN, 5)}) {
    EXPECT_FALSE(SampleDepth(map, outside, {}));
  }
}

TEST(SampleDepth, PlanesAreExactRightUpToASilhouette) {
  // A slanted foreground in front of a slanted background; the edge runs obliquely.
  const auto is_front = [](double x, double y) { return x + 0.3 * y < 17.2; };
  const auto front = [](double x, double y) { return 0.5 + 0.002 * x + 0.001 * y; };
  const DepthMap map = MakeMap(40, 30, [&](double x, double y) {
    return is_front(x, y) ? front(x, y) : SlantedPlane(x, y);
  });
  Rng rng = TestRng();
  for (int i = 0; i < 20000; ++i) {
    const Eigen::Vector2d at(rng.Uniform(0, 40), rng.Uniform(0, 30));
    const auto sample = SampleDepth(map, at, {});
    ASSERT_TRUE(sample);
    // Which surface is asked is told by the pixel that the position lies in.
    const Eigen::Vector2d center(std::floor(at.x()) + 0.5, std::floor(at.y()) + 0.5);
    const double expected = 1 / (is_front(center.x(), center.y()) ? front(at.x(), at.y())
                                                                  : SlantedPlane(at.x(), at.y()));
    EXPECT_NEAR(sample->z, expected, 5 * kFloatTolerance * expected) << at.transpose();
    const double distance = std::abs(at.x() + 0.3 * at.y() - 17.2) / std::hypot(1, 0.3);
    if (distance < 0.5) {
      EXPECT_GT(sample->depth_jump, 0.4);
    }
    if (distance > 2.5) {
      EXPECT_LT(sample->depth_jump, 1e-5);
    }
  }
}

TEST(SampleDepth, ASmallStepIsASilhouetteAndASteepSlopeIsNot) {
  // Both change by 2 % from pixel to pixel.
  const DepthMap step = MakeMap(20, 20, [](double x, double) { return x < 10 ? 0.5 : 0.5 * 1.02; });
  for (double x = 8.6; x < 11.4; x += 0.1) {
    const double z = SampleDepth(step, {x, 10.3}, {})->z;
    EXPECT_TRUE(std::abs(z - 2) < 1e-6 || std::abs(z - 2 / 1.02) < 1e-6) << x << " " << z;
  }
  const DepthMap slope = MakeMap(20, 20, [](double x, double) { return 0.5 + 0.01 * x; });
  for (double x = 0.1; x < 20; x += 0.1) {
    const double z = 1 / (0.5 + 0.01 * x);
    EXPECT_NEAR(SampleDepth(slope, {x, 10.3}, {})->z, z, kFloatTolerance * z);
  }
}

TEST(SampleDepth, HolesAreNeverFilledNorMixedIn) {
  const DepthMap map = MakeMap(40, 30, [](double x, double y) {
    return (std::floor(x) * 7 + std::floor(y) * 3) / 11 ==
                   std::floor((std::floor(x) * 7 + std::floor(y) * 3) / 11)
               ? 0
               : SlantedPlane(x, y);
  });
  Rng rng = TestRng();
  int holes = 0;
  for (int i = 0; i < 20000; ++i) {
    const Eigen::Vector2d at(rng.Uniform(0, 40), rng.Uniform(0, 30));
    const auto sample = SampleDepth(map, at, {});
    const bool hole = map.At(static_cast<int>(at.x()), static_cast<int>(at.y())) == 0;
    ASSERT_EQ(sample.has_value(), !hole);
    holes += hole ? 1 : 0;
    if (!sample) continue;
    const double z = 1 / SlantedPlane(at.x(), at.y());
    EXPECT_NEAR(sample->z, z, 5 * kFloatTolerance * z);
  }
  EXPECT_GT(holes, 500);
}

TEST(SampleDepth, APixelThatStandsAloneGivesItsOwnDepth) {
  const DepthMap map =
      MakeMap(20, 20, [](double x, double y) { return x == 10.5 && y == 7.5 ? 0.25 : 0.0; });
  const auto sample = SampleDepth(map, {10.1, 7.9}, {});
  ASSERT_TRUE(sample);
  EXPECT_EQ(sample->z, 4);
  EXPECT_FALSE(sample->has_gradient);
  EXPECT_FALSE(SampleDepth(map, {9.9, 7.9}, {}));
  const DepthMap single{1, 1, {2.0f}};
  EXPECT_EQ(SampleDepth(single, {0.2, 0.9}, {})->z, 2);
}

TEST(SampleDepth, NearestIsThePixelsOwnDepth) {
  const DepthMap map = MakeMap(40, 30, SlantedPlane);
  Rng rng = TestRng();
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Vector2d at(rng.Uniform(0, 40), rng.Uniform(0, 30));
    const auto sample = SampleDepth(map, at, {.interpolation = DepthInterpolation::kNearest});
    EXPECT_FLOAT_EQ(static_cast<float>(sample->z),
                    map.At(static_cast<int>(at.x()), static_cast<int>(at.y())));
  }
}

TEST(DepthInterpolation, EachHasAName) { EXPECT_TRUE(NamesEveryValue<DepthInterpolation>()); }

}  // namespace
}  // namespace raylift
