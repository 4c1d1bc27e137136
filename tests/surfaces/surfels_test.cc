// Discs of point clouds, and rays cast at them, against closed forms.

#include <cmath>
#include <cstring>
#include <functional>
#include <numbers>

#include "support/matchers.h"
#include "support/meshes.h"
#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "raylift/renderers/frame_renderer.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/surfaces/point_cloud.h"

namespace raylift {
namespace {

// A square of 2 x 2 about `center`, turned by `axes`, with points of some density at random, moved
// along the normal by noise.
struct Square {
  Eigen::Vector3d center = {0, 0, 0};
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
  double noise = 0;

  PointCloud Sample(size_t count, Rng& rng,
                    const std::function<bool(const Eigen::Vector2d&)>& keep = {}) const {
    PointCloud cloud;
    while (cloud.points_in_world.size() < count) {
      const Eigen::Vector2d at(rng.Uniform(-1, 1), rng.Uniform(-1, 1));
      if (keep && !keep(at)) continue;
      const double height = noise > 0 ? noise * rng.Normal() : 0;
      cloud.points_in_world.emplace_back(center + axes * Eigen::Vector3d(at.x(), at.y(), height));
    }
    return cloud;
  }
  Eigen::Vector3d normal() const { return axes.col(2); }
};

RayCaster CasterOf(PointCloud cloud, const SurfelOptions& options = {}) {
  return RayCaster(std::make_shared<const Surfels>(MakeSurfels(std::move(cloud), options)));
}

// The radius that the derivation expects where a unit of area has `density` points.
double ExpectedRadius(double density) {
  return std::sqrt(SurfelOptions().neighbors / (std::numbers::pi * density));
}

// The share of a surface that discs do not close, as the derivation expects.
double ExpectedOpenShare() {
  const int k = SurfelOptions().neighbors;
  return k * std::exp(-0.5 * k);
}

Eigen::Vector3d RandomDirection(Rng& rng) {
  return Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).normalized();
}

TEST(Surfels, APlaneIsHitWhereTheClosedFormSays) {
  Rng rng = TestRng();
  const Square square{.center = kGeoreferenced,
                      .axes = RandomRigid3(rng, 0).rotation.toRotationMatrix()};
  const RayCaster caster = CasterOf(square.Sample(20000, rng));
  int missed = 0;
  constexpr int kRays = 10000;
  for (int i = 0; i < kRays; ++i) {
    const Eigen::Vector3d target =
        square.center +
        square.axes * Eigen::Vector3d(rng.Uniform(-0.9, 0.9), rng.Uniform(-0.9, 0.9), 0);
    const Eigen::Vector3d direction = RandomDirection(rng);
    if (std::abs(direction.dot(square.normal())) < 0.1) continue;
    const Ray ray{target - 5 * direction, direction};
    const auto hit = caster.Cast({&ray, 1})[0];
    if (!hit) {
      ++missed;
      continue;
    }
    // Float resolves 1e-7 of a meter here; planes through so few points magnify that.
    EXPECT_NEAR(hit->ray_t, 5, 2e-6 / std::abs(direction.dot(square.normal())));
    EXPECT_GT(std::abs(hit->normal_in_world.dot(square.normal())), 1 - 1e-6);
    EXPECT_LT(hit->normal_in_world.dot(direction), 0) << "turned against the ray";
  }
  EXPECT_LT(missed, 2 * ExpectedOpenShare() * kRays);
}

TEST(Surfels, TheRadiusFollowsTheDensity) {
  Rng rng = TestRng();
  for (const size_t count : {2000u, 20000u}) {
    const Surfels surfels = MakeSurfels(Square().Sample(count, rng));
    double sum_of_squares = 0;
    for (const Eigen::Vector4f& disc : surfels.discs) {
      sum_of_squares += double{disc.w()} * double{disc.w()};
    }
    const double radius = std::sqrt(sum_of_squares / static_cast<double>(surfels.discs.size()));
    // Medians lie below means, and edges above: some per cent each.
    const double expected = ExpectedRadius(static_cast<double>(count) / 4);
    EXPECT_NEAR(radius, expected, 0.1 * expected);
  }
}

// A disc that touches a sphere of radius R rises r^2 / 2R above it at its rim.
TEST(Surfels, ASphereHasNoBiasOfSecondOrder) {
  Rng rng = TestRng();
  constexpr size_t kPoints = 5000;
  PointCloud cloud;
  for (size_t i = 0; i < kPoints; ++i) cloud.points_in_world.emplace_back(RandomDirection(rng));
  const RayCaster caster = CasterOf(std::move(cloud));
  const double radius = ExpectedRadius(kPoints / (4 * std::numbers::pi));
  const double rim = radius * radius / 2;
  double sum = 0;
  double sum_of_squares = 0;
  int hits = 0;
  for (int i = 0; i < 20000; ++i) {
    const Eigen::Vector3d to_center = RandomDirection(rng);
    const Ray ray{-3 * to_center, to_center};
    const auto hit = caster.Cast({&ray, 1})[0];
    if (!hit || hit->ray_t > 3) continue;     // through a gap
    const double error = 3 - hit->ray_t - 1;  // outwards
    sum += error;
    sum_of_squares += error * error;
    ++hits;
    EXPECT_GT(-hit->normal_in_world.dot(to_center), std::cos(radius));
  }
  ASSERT_GT(hits, 20000 * (1 - 2 * ExpectedOpenShare()));
  RecordProperty("mean_of_rim", std::to_string(sum / hits / rim));
  RecordProperty("rms_of_rim", std::to_string(std::sqrt(sum_of_squares / hits) / rim));
  EXPECT_LT(std::abs(sum / hits), 0.1 * rim);
  EXPECT_LT(std::sqrt(sum_of_squares / hits), 0.5 * rim);
}

TEST(Surfels, NoiseIsAveragedAndTold) {
  Rng rng = TestRng();
  const Square square{.noise = 0.003};  // a third of the points' spacing
  const auto surfels = std::make_shared<const Surfels>(MakeSurfels(square.Sample(40000, rng)));
  const RayCaster caster(surfels);
  double sum_of_squares = 0;
  double sum_of_variances = 0;
  double sum = 0;
  int hits = 0;
  for (int i = 0; i < 5000; ++i) {
    const Ray ray{{rng.Uniform(-0.9, 0.9), rng.Uniform(-0.9, 0.9), 3}, {0, 0, -1}};
    const auto hit = caster.Cast({&ray, 1})[0];
    if (!hit) continue;
    const double error = 3 - hit->ray_t;
    sum += error;
    sum_of_squares += error * error;
    sum_of_variances += hit->sigma * hit->sigma;
    ++hits;
  }
  const double rms = std::sqrt(sum_of_squares / hits);
  const double told = std::sqrt(sum_of_variances / hits);
  RecordProperty("rms_of_noise", std::to_string(rms / square.noise));
  RecordProperty("told_of_noise", std::to_string(told / square.noise));
  EXPECT_LT(std::abs(sum / hits), 0.05 * square.noise) << "no bias toward the viewer";
  EXPECT_LT(rms, 0.5 * square.noise);
  // Neither are the discs independent of each other nor is their spread all of the error.
  EXPECT_GT(told, 0.75 * rms);
  EXPECT_LT(told, 2 * rms);
}

// A hole is as large as it is: its rim is off by less than the points' own spacing.
TEST(Surfels, HolesStayHoles) {
  Rng rng = TestRng();
  constexpr double kHole = 0.3;
  constexpr double kPoints = 20000;
  const RayCaster caster = CasterOf(
      Square().Sample(kPoints, rng, [](const Eigen::Vector2d& at) { return at.norm() > kHole; }));
  const double spacing = std::sqrt((4 - std::numbers::pi * kHole * kHole) / kPoints);
  int inside = 0;
  int outside = 0;
  constexpr int kRays = 2000;
  for (int i = 0; i < kRays; ++i) {
    const double angle = rng.Uniform(0, 2 * std::numbers::pi);
    const auto is_hit = [&](double distance) {
      const Ray ray{{distance * std::cos(angle), distance * std::sin(angle), 1}, {0, 0, -1}};
      return caster.Cast({&ray, 1})[0].has_value();
    };
    inside += is_hit(kHole - spacing) ? 1 : 0;
    outside += is_hit(kHole + spacing) ? 1 : 0;
  }
  RecordProperty("inside", inside);
  RecordProperty("outside", outside);
  EXPECT_LT(inside, 0.05 * kRays);
  EXPECT_GT(outside, 0.95 * kRays);
}

TEST(Surfels, APointApartStaysSmall) {
  Rng rng = TestRng();
  PointCloud cloud = Square().Sample(20000, rng);
  cloud.points_in_world.emplace_back(0, 0, 1);
  const RayCaster caster = CasterOf(std::move(cloud));
  const double radius = ExpectedRadius(20000 / 4);
  const Ray beside{{2 * radius, 0, 2}, {0, 0, -1}};
  const auto hit = caster.Cast({&beside, 1})[0];
  ASSERT_TRUE(hit);
  EXPECT_NEAR(hit->ray_t, 2, 1e-5);
}

// In front of a wall stands another one, one and a half radii off, and ends at x = 0.
TEST(Surfels, AnEdgeIsWhereItsPointsEnd) {
  Rng rng = TestRng();
  constexpr size_t kPoints = 20000;
  const double radius = ExpectedRadius(kPoints / 4);
  const Square front{.center = {0, 0, 1.5 * radius}};
  PointCloud cloud = Square().Sample(kPoints, rng);
  const PointCloud ledge =
      front.Sample(kPoints / 2, rng, [](const Eigen::Vector2d& at) { return at.x() < 0; });
  cloud.points_in_world.insert(cloud.points_in_world.end(), ledge.points_in_world.begin(),
                               ledge.points_in_world.end());
  const RayCaster caster = CasterOf(std::move(cloud));
  const auto share_at = [&](double x_begin, double x_end, double z) {
    int hits = 0;
    constexpr int kRays = 1000;
    for (int i = 0; i < kRays; ++i) {
      const Ray ray{{rng.Uniform(x_begin, x_end), rng.Uniform(-0.9, 0.9), 1}, {0, 0, -1}};
      const auto hit = caster.Cast({&ray, 1})[0];
      if (hit && std::abs(hit->ray_t - (1 - z)) < 1e-3 * radius) ++hits;
    }
    return static_cast<double>(hits) / kRays;
  };
  const double spacing = std::sqrt(4.0 / kPoints);
  EXPECT_GT(share_at(-0.9, -spacing, front.center.z()), 0.95);
  EXPECT_GT(share_at(spacing, 0.9, 0), 0.95);
}

TEST(Surfels, BlocksAndSingleRaysAgree) {
  Rng rng = TestRng();
  const RayCaster caster =
      CasterOf(Square{.center = kGeoreferenced, .noise = 0.005}.Sample(20000, rng));
  std::vector<RayBlock> blocks(100);
  const Eigen::Vector3d eye = kGeoreferenced + Eigen::Vector3d(0.1, 0.2, 3);
  for (RayBlock& block : blocks) {
    for (size_t i = 0; i < RayBlock::kSize; ++i) {
      block.x[i] = static_cast<float>(rng.Uniform(-0.2, 0.2));
      block.y[i] = static_cast<float>(rng.Uniform(-0.2, 0.2));
      block.z[i] = -1;
    }
  }
  std::vector<HitBlock> hits(blocks.size());
  caster.CastBlocks(eye, blocks, hits);
  int compared = 0;
  int different = 0;
  for (size_t b = 0; b < blocks.size(); ++b) {
    for (size_t i = 0; i < RayBlock::kSize; ++i) {
      const Eigen::Vector3d direction =
          Eigen::Vector3f(blocks[b].x[i], blocks[b].y[i], blocks[b].z[i]).cast<double>();
      const Ray ray{eye, direction};
      const auto hit = caster.Cast({&ray, 1})[0];
      if (!hit || hits[b].triangle[i] == HitBlock::kNoTriangle) continue;
      ++compared;
      if (std::abs(double{hits[b].ray_t[i]} - hit->ray_t) > 1e-5) ++different;
      const RayHit refined =
          caster.RefineHit(eye, direction, hits[b].triangle[i], double{hits[b].ray_t[i]});
      EXPECT_NEAR(refined.ray_t, double{hits[b].ray_t[i]}, 1e-6);
    }
  }
  EXPECT_GT(compared, 1500);
  EXPECT_LT(different, 10);  // which disc is the first one may be a matter of rounding
}

TEST(Surfels, PicturesHaveDepthAndColors) {
  Rng rng = TestRng();
  PointCloud cloud = Square().Sample(20000, rng);
  for (const Eigen::Vector3d& point : cloud.points_in_world) {
    cloud.colors_rgb.push_back({static_cast<uint8_t>(point.x() < 0 ? 200 : 50), 100, 0});
  }
  const RayCaster caster = CasterOf(std::move(cloud));
  EXPECT_TRUE(caster.HasColors());
  const double params[] = {60, 60, 32, 24};
  const Camera camera(CameraModel::kPinhole, 64, 48, params);
  const Rigid3 cam_from_world{Eigen::Quaterniond::Identity(), {0, 0, 1.5}};
  const DepthMap depth = RenderDepth(caster, camera, cam_from_world, 2);
  const Image color = RenderColor(caster, camera, cam_from_world, {}, 2);
  int good = 0;
  for (int y = 0; y < 48; ++y) {
    for (int x = 0; x < 64; ++x) {
      const size_t pixel = static_cast<size_t>(y) * 64 + static_cast<size_t>(x);
      const bool is_right = x >= 34;
      const bool is_edge = std::abs(x - 31.5) < 2;
      good += std::abs(depth.At(x, y) - 1.5f) < 1e-5f &&
                      (is_edge || color.data[3 * pixel] == (is_right ? 50 : 200))
                  ? 1
                  : 0;
    }
  }
  EXPECT_GT(good, (1 - 2 * ExpectedOpenShare()) * 64 * 48);
}

TEST(Surfels, TheSameForAnyNumberOfThreads) {
  Rng rng = TestRng();
  const PointCloud cloud = Square{.noise = 0.01}.Sample(20000, rng);
  const Surfels one = MakeSurfels(cloud, {.threads = 1});
  const Surfels four = MakeSurfels(cloud, {.threads = 4});
  ASSERT_EQ(one.discs.size(), four.discs.size());
  EXPECT_EQ(
      0, std::memcmp(one.discs.data(), four.discs.data(), one.discs.size() * sizeof(one.discs[0])));
  EXPECT_EQ(0, std::memcmp(one.normals.data(), four.normals.data(),
                           one.normals.size() * sizeof(one.normals[0])));
  EXPECT_EQ(one.sigmas, four.sigmas);
}

TEST(Surfels, NormalsAndRadiusOfTheUserAreTaken) {
  Rng rng = TestRng();
  PointCloud cloud = Square().Sample(1000, rng);
  const Eigen::Vector3f given = Eigen::Vector3f(0.1f, 0, 1).normalized();
  cloud.normals.assign(cloud.points_in_world.size(), 2 * given);
  const Surfels surfels = MakeSurfels(std::move(cloud), {.radius = 0.25});
  for (size_t i = 0; i < surfels.discs.size(); ++i) {
    EXPECT_EQ(surfels.discs[i].w(), 0.25f);
    EXPECT_TRUE(surfels.normals[i].isApprox(given, 1e-6f));
  }
}

TEST(Surfels, PointsThatSpanNoSurfaceAreLeftOut) {
  PointCloud line;
  for (int i = 0; i < 100; ++i) line.points_in_world.emplace_back(i, 0, 0);
  EXPECT_TRUE(FailsWithInputError([&] { MakeSurfels(line); },
                                  {"point cloud: expected points of a surface"}));
  EXPECT_TRUE(
      FailsWithInputError([] { MakeSurfels({}); }, {"point cloud: expected points of a surface"}));
  Rng rng = TestRng();
  PointCloud twice = Square().Sample(500, rng);
  twice.points_in_world.insert(twice.points_in_world.end(), 40, Eigen::Vector3d(0, 0, 0));
  EXPECT_EQ(MakeSurfels(twice).discs.size(), 540u);
}

}  // namespace
}  // namespace raylift
