#include "geometry/triangulation.h"

#include <cmath>
#include <limits>

#include "support/matchers.h"
#include <Eigen/Geometry>

namespace raylift {
namespace {

using Eigen::Vector3d;

Vector3d RandomVector(Rng& rng) { return {rng.Normal(), rng.Normal(), rng.Normal()}; }

TEST(Approach, AgreesWithTheCommonPerpendicularOfLinesAlongTheAxes) {
  // Along x at z = 0, and against y at z = 5, twice as fast.
  const SightLine a{{1, 2, 0}, {1, 0, 0}};
  const SightLine b{{4, 10, 5}, {0, -2, 0}};
  const auto approach = Approach(a, b);
  ASSERT_TRUE(approach);
  EXPECT_EQ(approach->ray_t_a, 3);
  EXPECT_EQ(approach->ray_t_b, 4);
  EXPECT_EQ(approach->sine, 1);
  EXPECT_EQ(b.At(approach->ray_t_b) - a.At(approach->ray_t_a), Vector3d(0, 0, 5));
}

TEST(Approach, FindsThePointThatBothRaysShow) {
  Rng rng = TestRng();
  for (int i = 0; i < 100; ++i) {
    const Vector3d point = RandomVector(rng);
    const double ray_t_a = rng.Uniform(0.1, 10);
    const double ray_t_b = -rng.Uniform(0.1, 10);  // behind its origin
    const Vector3d direction_a = RandomVector(rng);
    const Vector3d direction_b = RandomVector(rng);
    const auto approach = Approach({point - ray_t_a * direction_a, direction_a},
                                   {point - ray_t_b * direction_b, direction_b});
    ASSERT_TRUE(approach);
    EXPECT_NEAR(approach->ray_t_a, ray_t_a, 1e-11);
    EXPECT_NEAR(approach->ray_t_b, ray_t_b, 1e-11);
    const double cosine = direction_a.normalized().dot(direction_b.normalized());
    EXPECT_NEAR(approach->sine, std::sqrt(1 - cosine * cosine), 1e-11);
  }
}

TEST(Approach, ConnectsSkewLinesAtRightAnglesToBoth) {
  Rng rng = TestRng();
  for (int i = 0; i < 100; ++i) {
    const SightLine a{RandomVector(rng), RandomVector(rng)};
    const SightLine b{RandomVector(rng), RandomVector(rng)};
    const auto approach = Approach(a, b);
    ASSERT_TRUE(approach);
    const Vector3d gap = b.At(approach->ray_t_b) - a.At(approach->ray_t_a);
    EXPECT_NEAR(gap.dot(a.direction), 0, 1e-10);
    EXPECT_NEAR(gap.dot(b.direction), 0, 1e-10);
  }
}

TEST(Approach, IsTheSameFromEitherSide) {
  Rng rng = TestRng();
  const SightLine a{RandomVector(rng), RandomVector(rng)};
  const SightLine b{RandomVector(rng), RandomVector(rng)};
  const auto one = Approach(a, b);
  const auto other = Approach(b, a);
  ASSERT_TRUE(one && other);
  EXPECT_EQ(one->ray_t_a, other->ray_t_b);
  EXPECT_EQ(one->ray_t_b, other->ray_t_a);
  EXPECT_EQ(one->sine, other->sine);
}

// One camera straight ahead of the other, as on a road. Rounding turns the directions by 1e-16
// against each other, 1e-9 of the angle.
TEST(Approach, HoldsAtTinyAngles) {
  Rng rng = TestRng();
  constexpr double kAngle = 1e-7;
  const Vector3d point(0.3, -0.2, 5);
  for (int i = 0; i < 100; ++i) {
    const Vector3d ahead = RandomVector(rng).normalized();
    const Vector3d origin_a = point - 4 * ahead;
    const Vector3d origin_b = point - 2 * ahead + 2 * kAngle * ahead.unitOrthogonal();
    const auto approach = Approach({origin_a, (point - origin_a).normalized()},
                                   {origin_b, (point - origin_b).normalized()});
    ASSERT_TRUE(approach);
    EXPECT_NEAR(approach->ray_t_a, 4, 4e-7);
    EXPECT_NEAR(approach->ray_t_b, 2, 4e-7);
    EXPECT_NEAR(approach->sine, kAngle, 1e-7 * kAngle);
  }
}

TEST(Approach, OfParallelOrUnknownLinesIsNone) {
  const SightLine line{{1, 2, 3}, {0.5, 0, -1}};
  EXPECT_FALSE(Approach(line, {{0, 0, 0}, line.direction}));
  EXPECT_FALSE(Approach(line, {{0, 0, 0}, -2 * line.direction}));
  EXPECT_FALSE(Approach(line, {{0, 0, 0}, {0, 0, 0}}));
  EXPECT_FALSE(Approach(line, {{std::nan(""), 0, 0}, {0, 0, 1}}));
  EXPECT_FALSE(Approach({{0, 0, 0}, {0, std::numeric_limits<double>::infinity(), 0}}, line));
}

}  // namespace
}  // namespace raylift
