#include "raylift/renderers/ray_caster.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "renderers/casters.h"
#include "support/matchers.h"
#include "support/meshes.h"
#include "support/test_data.h"
#include "surfaces/space_order.h"
#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

Eigen::Vector3d RandomDirection(Rng& rng) {
  return Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal()).normalized();
}

std::optional<RayHit> CastOne(const RayCaster& caster, const Ray& ray) {
  return caster.Cast(std::span(&ray, 1)).front();
}

// Where a ray from inside an axis-aligned box leaves it.
double BoxExit(const Eigen::Vector3d& origin_from_center, const Eigen::Vector3d& direction,
               const Eigen::Vector3d& half_size) {
  double exit = std::numeric_limits<double>::infinity();
  for (int axis = 0; axis < 3; ++axis) {
    const double side = direction[axis] > 0 ? half_size[axis] : -half_size[axis];
    exit = std::min(exit, (side - origin_from_center[axis]) / direction[axis]);
  }
  return exit;
}

// Every triangle in double, by Moller and Trumbore: slow, and without any of Embree.
std::optional<double> BruteForce(const TriangleMesh& mesh, const Ray& ray) {
  std::optional<double> nearest;
  const Eigen::Vector3d origin = ray.origin_in_world - mesh.origin_in_world;
  for (const auto& [i0, i1, i2] : mesh.triangles) {
    const Eigen::Vector3d v0 = mesh.vertices[i0].cast<double>();
    const Eigen::Vector3d e1 = mesh.vertices[i1].cast<double>() - v0;
    const Eigen::Vector3d e2 = mesh.vertices[i2].cast<double>() - v0;
    const Eigen::Vector3d p = ray.direction_in_world.cross(e2);
    const double determinant = e1.dot(p);
    if (determinant == 0) continue;
    const Eigen::Vector3d s = origin - v0;
    const double u = s.dot(p) / determinant;
    if (u < 0 || u > 1) continue;
    const Eigen::Vector3d q = s.cross(e1);
    const double v = ray.direction_in_world.dot(q) / determinant;
    if (v < 0 || u + v > 1) continue;
    const double t = e2.dot(q) / determinant;
    if (t > ray.ray_t_near && (!nearest || t < *nearest)) nearest = t;
  }
  return nearest;
}

TEST(OrderInSpace, NeighborsFollowEachOtherAndEqualPointsStayInOrder) {
  Rng rng = TestRng();
  std::vector<Eigen::Vector3f> points;
  for (int i = 0; i < 4096; ++i) {
    points.emplace_back(rng.Uniform(0, 1), rng.Uniform(0, 1), rng.Uniform(0, 1));
  }
  points.insert(points.end(), points.begin(), points.begin() + 512);
  const std::vector<uint32_t> order = OrderInSpace(points, 21);
  std::vector<uint32_t> sorted = order;
  std::sort(sorted.begin(), sorted.end());
  double as_given = 0;
  double along_curve = 0;
  for (uint32_t i = 0; i < sorted.size(); ++i) {
    ASSERT_EQ(sorted[i], i);
    if (i == 0) continue;
    as_given += (points[i] - points[i - 1]).norm();
    along_curve += (points[order[i]] - points[order[i - 1]]).norm();
    if (points[order[i]] == points[order[i - 1]]) {
      EXPECT_LT(order[i - 1], order[i]);
    }
  }
  // Random points are .66 apart in the mean, cells of so many some 1 / 16.
  EXPECT_LT(along_curve, 0.2 * as_given);
}

TEST(RayCaster, HitsBoxWhereTheClosedFormSays) {
  Rng rng = TestRng();
  const Eigen::Vector3d half(1.3, 0.9, 2.1);
  for (const Eigen::Vector3d& center : {Eigen::Vector3d(0.1, 0.2, 0.3), kGeoreferenced}) {
    const RayCaster caster = MakeCaster(MakeBox(center, half));
    for (int i = 0; i < 2000; ++i) {
      const Eigen::Vector3d offset(rng.Uniform(-1, 1), rng.Uniform(-0.5, 0.5), rng.Uniform(-2, 2));
      const double length = rng.Uniform(0.1, 10);
      const Ray ray{center + offset, length * RandomDirection(rng)};
      const auto hit = CastOne(caster, ray);
      ASSERT_TRUE(hit);
      const double expected = BoxExit(offset, ray.direction_in_world, half);
      // The box's corners are rounded to float, 2.1 * 2^-24; a factor for oblique rays.
      EXPECT_NEAR(hit->ray_t, expected, 1e-6 * expected + 1e-6 / length);
      EXPECT_NEAR(hit->normal_in_world.norm(), 1, 1e-12);
      EXPECT_GT(hit->normal_in_world.dot(ray.direction_in_world), 0) << "seen from inside";
    }
  }
}

TEST(RayCaster, BarycentricCoordinatesGiveThePoint) {
  Rng rng = TestRng();
  const TriangleMesh mesh = MakeSphere(kGeoreferenced, 3, 20, 40);
  const RayCaster caster = MakeCaster(mesh);
  for (int i = 0; i < 1000; ++i) {
    const Ray ray{kGeoreferenced + RandomDirection(rng), RandomDirection(rng)};
    const auto hit = CastOne(caster, ray);
    ASSERT_TRUE(hit);
    const auto& [i0, i1, i2] = mesh.triangles[hit->triangle];
    const double u = hit->barycentric.x();
    const double v = hit->barycentric.y();
    EXPECT_GE(u, 0);
    EXPECT_GE(v, 0);
    EXPECT_LE(u + v, 1);
    const Eigen::Vector3d point = (1 - u - v) * mesh.VertexInWorld(i0) +
                                  u * mesh.VertexInWorld(i1) + v * mesh.VertexInWorld(i2);
    const Eigen::Vector3d expected = ray.origin_in_world + hit->ray_t * ray.direction_in_world;
    EXPECT_LT((point - expected).norm(), 2e-6);  // float chose the triangle
  }
}

TEST(RayCaster, FarCamerasLoseNoPrecision) {
  Rng rng = TestRng();
  const double radius = 5;
  const RayCaster caster = MakeCaster(MakeSphere(kGeoreferenced, radius, 200, 400));
  const RayCaster near_caster = MakeCaster(MakeSphere({0, 0, 0}, radius, 200, 400));
  for (int i = 0; i < 500; ++i) {
    const Eigen::Vector3d away = RandomDirection(rng);
    const Eigen::Vector3d target = 0.5 * radius * RandomDirection(rng);
    const Eigen::Vector3d near_origin = target + 20 * away;
    const auto near_hit = CastOne(near_caster, {near_origin, -away});
    const auto far_hit = CastOne(caster, {kGeoreferenced + target + 1e6 * away, -away});
    ASSERT_TRUE(near_hit);
    ASSERT_TRUE(far_hit);
    // Doubles at 5e6 resolve 1e-9; the sphere's vertices are rounded elsewhere, 5 * 2^-24 each.
    EXPECT_NEAR(far_hit->ray_t - 1e6, near_hit->ray_t - 20, 5e-6);
  }
}

TEST(RayCaster, ClosedMeshHasNoLeaks) {
  Rng rng = TestRng();
  for (const auto quality :
       {RayCasterOptions::BuildQuality::kLow, RayCasterOptions::BuildQuality::kMedium}) {
    const TriangleMesh mesh = MakeSphere(kGeoreferenced, 7, 60, 120);
    const RayCaster caster = MakeCaster(mesh, {quality});
    std::vector<Ray> rays;
    const auto inside = [&]() -> Eigen::Vector3d {
      return kGeoreferenced + rng.Uniform(0, 6.5) * RandomDirection(rng);
    };
    for (int i = 0; i < 200000; ++i) {
      rays.push_back({inside(), RandomDirection(rng)});
    }
    for (const auto& triangle : mesh.triangles) {
      for (int k = 0; k < 3; ++k) {
        const Eigen::Vector3d a = mesh.VertexInWorld(triangle[static_cast<size_t>(k)]);
        const Eigen::Vector3d b = mesh.VertexInWorld(triangle[static_cast<size_t>((k + 1) % 3)]);
        const double share = rng.Uniform();
        for (const Eigen::Vector3d& target : {a, Eigen::Vector3d(a + share * (b - a))}) {
          const Eigen::Vector3d origin = inside();
          rays.push_back({origin, target - origin});
        }
      }
    }
    const auto hits = caster.Cast(rays);
    EXPECT_EQ(std::count(hits.begin(), hits.end(), std::nullopt), 0) << "of " << rays.size();
  }
}

// Directions around an axis, as blocks; the last block is filled up with rays that are none.
std::vector<RayBlock> Blocks(const std::vector<Eigen::Vector3d>& directions) {
  std::vector<RayBlock> blocks((directions.size() + RayBlock::kSize - 1) / RayBlock::kSize);
  for (size_t i = 0; i < directions.size(); ++i) {
    const Eigen::Vector3f direction = directions[i].normalized().cast<float>();
    blocks[i / RayBlock::kSize].x[i % RayBlock::kSize] = direction.x();
    blocks[i / RayBlock::kSize].y[i % RayBlock::kSize] = direction.y();
    blocks[i / RayBlock::kSize].z[i % RayBlock::kSize] = direction.z();
  }
  return blocks;
}

TEST(RayCaster, BlocksHaveNoLeaksAndAgreeWithSingleRays) {
  Rng rng = TestRng();
  const TriangleMesh mesh = MakeSphere(kGeoreferenced, 7, 60, 120);
  const RayCaster caster = MakeCaster(mesh);
  for (const double distance : {5.0, 300.0, 7e4}) {  // inside, outside, ray by ray
    const Eigen::Vector3d away = RandomDirection(rng);
    const Eigen::Vector3d origin = kGeoreferenced + distance * away;
    std::vector<Eigen::Vector3d> directions;
    for (size_t i = 0; i < 1000; ++i) {
      directions.emplace_back(kGeoreferenced + 6.5 * RandomDirection(rng) - origin);
    }
    const auto blocks = Blocks(directions);
    std::vector<HitBlock> hits(blocks.size());
    caster.CastBlocks(origin, blocks, hits);
    for (size_t i = 0; i < directions.size(); ++i) {
      const HitBlock& block = hits[i / RayBlock::kSize];
      const size_t k = i % RayBlock::kSize;
      ASSERT_NE(block.triangle[k], HitBlock::kNoTriangle) << distance;
      const auto expected = CastOne(caster, {origin, directions[i].normalized()});
      ASSERT_TRUE(expected);
      if ((block.grazing >> k & 1u) == 0) {
        // The direction is rounded to float; seen from outside the limb is oblique.
        EXPECT_NEAR(double{block.ray_t[k]}, expected->ray_t, 6e-6 * expected->ray_t);
      }
    }
  }
}

TEST(RayCaster, BlocksAimedAtVerticesAndEdgesHaveNoLeaks) {
  Rng rng = TestRng();
  const TriangleMesh mesh = MakeSphere(kGeoreferenced, 7, 60, 120);
  const RayCaster caster = MakeCaster(mesh);
  const Eigen::Vector3d origin = kGeoreferenced + 5 * RandomDirection(rng);
  std::vector<Eigen::Vector3d> directions;
  for (const auto& triangle : mesh.triangles) {
    for (size_t k = 0; k < 3; ++k) {
      const Eigen::Vector3d a = mesh.VertexInWorld(triangle[k]);
      const Eigen::Vector3d b = mesh.VertexInWorld(triangle[(k + 1) % 3]);
      directions.push_back(a - origin);
      directions.emplace_back(a + rng.Uniform() * (b - a) - origin);
    }
  }
  const auto blocks = Blocks(directions);
  std::vector<HitBlock> hits(blocks.size());
  caster.CastBlocks(origin, blocks, hits);
  size_t leaks = 0;
  for (size_t i = 0; i < directions.size(); ++i) {
    leaks += hits[i / RayBlock::kSize].triangle[i % RayBlock::kSize] == HitBlock::kNoTriangle;
  }
  EXPECT_EQ(leaks, 0u) << "of " << directions.size();
}

TEST(RayCaster, BlocksSkipRaysWithoutDirection) {
  const RayCaster caster = MakeCaster(MakeBox({0, 0, 0}, {1, 1, 1}));
  auto blocks = Blocks(std::vector<Eigen::Vector3d>(20, Eigen::Vector3d(0, 0, 1)));
  blocks[0].z[3] = 0;
  blocks[1].x[1] = std::numeric_limits<float>::quiet_NaN();
  std::vector<HitBlock> hits(2);
  caster.CastBlocks({0.1, 0.2, 0}, blocks, hits);
  for (size_t i = 0; i < 32; ++i) {
    const uint32_t triangle = hits[i / 16].triangle[i % 16];
    EXPECT_EQ(triangle != HitBlock::kNoTriangle, i != 3 && i != 17 && i < 20) << i;
  }
  const double nan = std::numeric_limits<double>::quiet_NaN();
  caster.CastBlocks({nan, 0, 0}, blocks, hits);
  EXPECT_EQ(hits[0].triangle[0], HitBlock::kNoTriangle);
}

TEST(RayCaster, NearLimitCountsInTheCallersDirection) {
  const RayCaster caster = MakeCaster(MakeBox(kGeoreferenced, {1, 1, 1}));
  const Eigen::Vector3d direction(0, 0, 4);
  for (const double distance : {3.0, 3000.0}) {
    const Eigen::Vector3d origin = kGeoreferenced + Eigen::Vector3d(0.1, 0.2, -distance);
    const auto first = CastOne(caster, {origin, direction});
    ASSERT_TRUE(first);
    EXPECT_NEAR(first->ray_t, (distance - 1) / 4, 1e-7);
    const auto second = CastOne(caster, {origin, direction, first->ray_t + 0.01});
    ASSERT_TRUE(second);
    EXPECT_NEAR(second->ray_t, (distance + 1) / 4, 1e-7);
    EXPECT_FALSE(CastOne(caster, {origin, direction, second->ray_t + 0.01}));
    EXPECT_TRUE(caster.IsOccluded({origin, direction}));
    EXPECT_TRUE(caster.IsOccluded({origin, direction, first->ray_t + 0.01}));
    EXPECT_FALSE(caster.IsOccluded({origin, direction, second->ray_t + 0.01}));
  }
}

TEST(RayCaster, RaysThatAreNotFiniteMiss) {
  const RayCaster caster = MakeCaster(MakeBox({0, 0, 0}, {1, 1, 1}));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  const Eigen::Vector3d forward(0, 0, 1);
  EXPECT_FALSE(CastOne(caster, {{nan, 0, 0}, forward}));
  EXPECT_FALSE(CastOne(caster, {{infinity, 0, 0}, forward}));
  // Embree ends the process for these.
  EXPECT_FALSE(CastOne(caster, {{2e18, 0, 0}, forward}));
  EXPECT_FALSE(CastOne(caster, {{0, 0, 1e30}, forward}));
  EXPECT_FALSE(caster.IsOccluded({{0, 2e18, 0}, forward}));
  EXPECT_FALSE(CastOne(caster, {{0, 0, 0}, {0, nan, 1}}));
  EXPECT_FALSE(CastOne(caster, {{0, 0, 0}, {0, 0, 0}}));
  EXPECT_FALSE(caster.IsOccluded({{0, 0, 0}, {0, 0, 0}}));
  EXPECT_FALSE(caster.IsOccluded({{0, 0, nan}, forward}));
}

// A closed form, so that every version of Embree gives the same. Packets of coherent occlusion
// rays, which would be quicker, never return from some scenes where Embree 3.13 takes AVX-512: this
// test would hang, until its time-out.
TEST(RayCaster, OcclusionByAFineSphereIsThatOfTheClosedForm) {
  constexpr int kRings = 300;
  // The middles of its triangles lie deeper than its vertices.
  const double inner = std::cos(std::numbers::pi / kRings);
  const RayCaster caster = MakeCaster(MakeSphere({0, 0, 0}, 1, kRings, 2 * kRings));
  Rng rng = TestRng();
  int occluded = 0, wrong = 0;
  for (int i = 0; i < 200'000; ++i) {
    const Ray ray{3 * RandomDirection(rng), RandomDirection(rng)};
    const double along = -ray.origin_in_world.dot(ray.direction_in_world);
    const double distance = (ray.origin_in_world + along * ray.direction_in_world).norm();
    if (distance > inner && distance < 1) continue;
    const bool expected = along > 0 && distance < inner;
    occluded += expected ? 1 : 0;
    wrong += caster.IsOccluded(ray) != expected ? 1 : 0;
    wrong += CastOne(caster, ray).has_value() != expected ? 1 : 0;
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(occluded, 5'000);
}

TEST(RayCaster, EmptyMeshHasNoHits) {
  const RayCaster caster = MakeCaster(TriangleMesh{});
  EXPECT_FALSE(CastOne(caster, {{0, 0, 0}, {0, 0, 1}}));
}

TEST(RayCaster, IndexOutOfRangeIsCaughtBeforeEmbreeReadsIt) {
  TriangleMesh mesh = MakeBox({0, 0, 0}, {1, 1, 1});
  mesh.triangles.push_back({0, 1, 8});
  EXPECT_THROW(MakeCaster(std::move(mesh)), std::logic_error);
}

TEST(RayCaster, AgreesWithBruteForceOnARealMesh) {
  const auto data = FindTestData("rgbd_small");
  if (!data) GTEST_SKIP() << "rgbd_small is not on this machine";
  Rng rng = TestRng();
  TriangleMesh mesh = ReadMesh(*data / "mesh.ply");
  const RayCaster caster = MakeCaster(mesh);
  int hits = 0;
  for (int i = 0; i < 150; ++i) {
    const auto near_surface = [&](double distance) -> Eigen::Vector3d {
      const auto vertex = rng.UniformIndex(static_cast<uint32_t>(mesh.vertices.size()));
      return mesh.VertexInWorld(vertex) + distance * RandomDirection(rng);
    };
    const Eigen::Vector3d origin = near_surface(0.5);
    const Ray ray{origin, near_surface(0.01) - origin};
    const auto expected = BruteForce(mesh, ray);
    const auto hit = CastOne(caster, ray);
    // Rays pass edges of holes by chance no nearer than float resolves.
    ASSERT_EQ(hit.has_value(), expected.has_value()) << i;
    if (hit) {
      ++hits;
      EXPECT_NEAR(hit->ray_t, *expected, 1e-6 * *expected + 1e-6);
    }
  }
  EXPECT_GT(hits, 100);
}

}  // namespace
}  // namespace raylift
