#include <limits>

#include "support/matchers.h"
#include "surfaces/raw_mesh.h"
#include <Eigen/Geometry>
#include <gtest/gtest.h>

namespace raylift {
namespace {

// The areas of the triangles, signed by the polygon's normal.
std::vector<double> Areas(const std::vector<Eigen::Vector3d>& corners,
                          const Eigen::Vector3d& normal) {
  std::vector<double> areas;
  for (const auto& [a, b, c] : TriangulatePolygon(corners)) {
    areas.push_back(0.5 * (corners[b] - corners[a]).cross(corners[c] - corners[a]).dot(normal));
  }
  return areas;
}

double Sum(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value;
  return sum;
}

TEST(TriangulatePolygon, FillsConcavePolygonsInAnyPlane) {
  // A comb, wound counter-clockwise: a base of 5 x 1 and three teeth of 1 x 2.
  const std::vector<Eigen::Vector2d> comb = {{0, 0}, {5, 0}, {5, 3}, {4, 3}, {4, 1}, {3, 1},
                                             {3, 3}, {2, 3}, {2, 1}, {1, 1}, {1, 3}, {0, 3}};
  Rng rng = TestRng();
  for (int i = 0; i < 50; ++i) {
    const Rigid3 world_from_plane = RandomRigid3(rng, 1000);
    std::vector<Eigen::Vector3d> corners;
    const size_t first = rng.UniformIndex(static_cast<uint32_t>(comb.size()));
    for (size_t k = 0; k < comb.size(); ++k) {
      const Eigen::Vector2d& p = comb[(first + k) % comb.size()];
      corners.push_back(world_from_plane * Eigen::Vector3d(p.x(), p.y(), 0));
    }
    const auto areas = Areas(corners, world_from_plane.rotation * Eigen::Vector3d(0, 0, 1));
    EXPECT_EQ(areas.size(), comb.size() - 2);
    EXPECT_NEAR(Sum(areas), 11, 1e-9);
    for (const double area : areas) EXPECT_GE(area, -1e-9);
  }
}

// Squares of 1 x 1 in some cells of a rectangle of 9 x 9, whose outline has teeth.
TEST(TriangulatePolygon, LeavesHolesOpen) {
  Rng rng = TestRng();
  for (int i = 0; i < 3000; ++i) {
    const Rigid3 world_from_plane = RandomRigid3(rng, 1000);
    std::vector<Eigen::Vector3d> corners;
    const auto add = [&](double x, double y) {
      corners.push_back(world_from_plane * Eigen::Vector3d(x, y, 0));
    };
    double expected = 81;
    add(0, 0);
    for (int tooth = 0; tooth < 4 && i % 2 == 0; ++tooth) {
      const double tip = rng.Uniform(0.1, 0.9);
      add(2 * tooth + 1, 0);
      add(2 * tooth + 1.5, tip);
      add(2 * tooth + 2, 0);
      expected -= 0.5 * tip;
    }
    add(9, 0);
    add(9, 9);
    add(0, 9);
    const size_t outer = corners.size();
    std::vector<uint32_t> hole_begins;
    for (int cell = 0; cell < 16; ++cell) {
      if (rng.Uniform() < 0.5) continue;
      const double x = 2 * (cell % 4) + 1, y = 2 * static_cast<int>(cell / 4) + 1;
      hole_begins.push_back(static_cast<uint32_t>(corners.size()));
      const double slant = i % 3 == 0 ? rng.Uniform(-0.3, 0.3) : 0;  // else corners are in line
      const bool is_reversed = rng.Uniform() < 0.5;
      add(x, y);
      if (is_reversed) add(x + slant, y + 1);
      if (!is_reversed) add(x + 1, y);
      add(x + 1 + slant, y + 1);
      if (is_reversed) add(x + 1, y);
      if (!is_reversed) add(x + slant, y + 1);
      expected -= 1;
    }
    const Eigen::Vector3d normal = world_from_plane.rotation * Eigen::Vector3d(0, 0, 1);
    double area = 0;
    const auto triangles = TriangulatePolygon(corners, hole_begins);
    for (const auto& [a, b, c] : triangles) {
      const double own = 0.5 * (corners[b] - corners[a]).cross(corners[c] - corners[a]).dot(normal);
      EXPECT_GE(own, -1e-9) << i;
      area += own;
    }
    EXPECT_EQ(triangles.size(), corners.size() - 2 + 2 * hole_begins.size()) << i << ' ' << outer;
    EXPECT_NEAR(area, expected, 1e-8) << i;
  }
}

TEST(TriangulatePolygon, WhatIsNoPolygonComesBackAsTriangles) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(TriangulatePolygon(std::vector<Eigen::Vector3d>(5, {1, 2, 3})).size(), 3u);
  EXPECT_EQ(TriangulatePolygon(std::vector<Eigen::Vector3d>(6, {1, nan, 3})).size(), 4u);
  EXPECT_EQ(TriangulatePolygon(std::vector<Eigen::Vector3d>(5000, {1, 2, 3})).size(), 4998u);
  // A bow tie crosses itself.
  EXPECT_EQ(
      TriangulatePolygon(std::vector<Eigen::Vector3d>{{0, 0, 0}, {1, 1, 0}, {1, 0, 0}, {0, 1, 0}})
          .size(),
      2u);
}

}  // namespace
}  // namespace raylift
