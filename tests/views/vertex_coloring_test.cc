// Vertex colors from photographs that are painted by formula.

#include "views/vertex_coloring.h"

#include <cmath>
#include <functional>
#include <memory>
#include <optional>

#include "support/meshes.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/io/image_file.h"
#include "raylift/scene/image.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;
using Eigen::Vector3d;

// The wall z = 0, [-2, 2]^2, seen from -z, in colors that change slowly.
Vector3d WallColor(double x, double y) {
  return {128 + 60 * std::sin(2 * x), 120 + 60 * std::cos(1.5 * y), 110 + 50 * std::sin(x + y)};
}

TriangleMesh Wall() { return MakePlane(Rigid3(), 2, 40); }

// At `center`, looking along +z.
PosedImage View(const std::string& name, const Vector3d& center) {
  return {name, CenteredPinhole(320, 240, 300), Rigid3{Eigen::Quaterniond::Identity(), -center}};
}

// What the camera sees of the wall, times `factor`; `nearer` gives the color of what hides it.
using Nearer = std::function<std::optional<Vector3d>(const Vector3d& origin, const Vector3d& ray)>;
void Paint(const fs::path& folder, const PosedImage& view, const Vector3d& factor,
           const Nearer& nearer = {}) {
  const Vector3d center = view.cam_from_world.OriginInSource();
  Image image{.width_px = 320, .height_px = 240, .channels = 3, .data = {}};
  image.data.resize(size_t{320} * 240 * 3);
  for (int y = 0; y < 240; ++y) {
    for (int x = 0; x < 320; ++x) {
      const Vector3d ray((x + 0.5 - 160) / 300, (y + 0.5 - 120) / 300, 1);
      const Vector3d point = center - center.z() * ray;
      Vector3d color = WallColor(point.x(), point.y());
      if (nearer) color = nearer(center, ray).value_or(color);
      for (int c = 0; c < 3; ++c) image.Pixel(x, y)[c] = NearestByte(color[c] * factor[c]);
    }
  }
  WriteImage(folder / view.name, image);
}

RayCaster CasterOf(const TriangleMesh& mesh) {
  return RayCaster(std::make_shared<const TriangleMesh>(mesh));
}

bool IsInside(const Vector3d& vertex, double half) {
  return std::abs(vertex.x()) < half && std::abs(vertex.y()) < half;
}

TEST(VertexColoring, TakesWhatPhotographsShow) {
  const fs::path folder = TestFolder();
  const TriangleMesh wall = Wall();
  const std::vector<PosedImage> views = {
      View("a.png", {-0.5, 0, -3}), View("b.png", {0.5, 0.2, -4}), View("c.png", {0, -0.4, -3.5})};
  for (const PosedImage& view : views) Paint(folder, view, Vector3d::Ones());
  const VertexColoring coloring = ColorVertices(wall, CasterOf(wall), views, folder);
  size_t checked = 0;
  for (uint32_t v = 0; v < wall.vertices.size(); ++v) {
    const Vector3d at = wall.VertexInWorld(v);
    if (!IsInside(at, 0.9)) continue;
    ++checked;
    const Vector3d expected = WallColor(at.x(), at.y());
    for (int c = 0; c < 3; ++c) {
      EXPECT_NEAR(coloring.colors_rgb[v][static_cast<size_t>(c)], expected[c], 3) << at.transpose();
    }
  }
  EXPECT_GT(checked, 200u);
  EXPECT_GT(coloring.num_seen, checked);
  EXPECT_LT(coloring.num_seen, wall.vertices.size());
  for (const Vector3d& factor : coloring.factors_rgb) {
    EXPECT_LT((factor - Vector3d::Ones()).norm(), 0.01);
  }
  // Edges of 0.1 and 0.14 at 300 px and three units.
  EXPECT_NEAR(coloring.median_spacing_px, 11, 2);
  EXPECT_NEAR(coloring.median_pixel_width, 0.01, 0.002);

  const VertexColoring four = ColorVertices(wall, CasterOf(wall), views, folder, {.threads = 4});
  EXPECT_EQ(four.colors_rgb, coloring.colors_rgb);
}

TEST(VertexColoring, LevelsExposures) {
  const fs::path folder = TestFolder();
  const TriangleMesh wall = Wall();
  const std::vector<PosedImage> views = {View("a.png", {-1, 0, -3}), View("b.png", {0, 0, -3}),
                                         View("c.png", {1, 0, -3})};
  const Vector3d factors[] = {{0.8, 0.8, 0.8}, {1.0, 1.1, 1.0}, {1.2, 1.1, 1.3}};
  for (size_t i = 0; i < views.size(); ++i) Paint(folder, views[i], factors[i]);
  const VertexColoring coloring = ColorVertices(wall, CasterOf(wall), views, folder);
  for (int c = 0; c < 3; ++c) {
    for (size_t i = 1; i < views.size(); ++i) {
      EXPECT_NEAR(coloring.factors_rgb[i][c] / coloring.factors_rgb[0][c],
                  factors[0][c] / factors[i][c], 0.01);
    }
  }
  // One factor for the whole wall: that of the geometric mean.
  for (uint32_t v = 0; v < wall.vertices.size(); ++v) {
    const Vector3d at = wall.VertexInWorld(v);
    if (!IsInside(at, 1)) continue;
    const double mean = std::cbrt(0.8 * 1.0 * 1.2);
    EXPECT_NEAR(coloring.colors_rgb[v][0], mean * WallColor(at.x(), at.y())[0], 4);
  }
}

TEST(VertexColoring, WhatIsHiddenTakesNoColorOfWhatHidesIt) {
  const fs::path folder = TestFolder();
  const TriangleMesh wall = Wall();
  const TriangleMesh box = MakeBox({0, 0, -1}, {0.3, 0.3, 0.1});
  TriangleMesh both = wall;
  for (uint32_t v = 0; v < box.vertices.size(); ++v) {
    both.vertices.emplace_back((box.VertexInWorld(v) - wall.origin_in_world).cast<float>());
  }
  const auto first = static_cast<uint32_t>(wall.vertices.size());
  for (const auto& t : box.triangles) {
    both.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
  }
  const std::vector<PosedImage> views = {View("a.png", {0, 0, -4}), View("b.png", {0.1, 0, -4})};
  const auto green = [](const Vector3d& origin, const Vector3d& ray) -> std::optional<Vector3d> {
    const Vector3d point = origin + (-1.1 - origin.z()) * ray;
    if (IsInside(point, 0.3)) return Vector3d(0, 255, 0);
    return std::nullopt;
  };
  for (const PosedImage& view : views) Paint(folder, view, Vector3d::Ones(), green);
  const VertexColoring coloring = ColorVertices(both, CasterOf(both), views, folder);
  // All of the wall, what neighbors lend to the hidden part among it, but where the box's edge is
  // within the patch of a vertex.
  for (uint32_t v = 0; v < first; ++v) {
    const Vector3d at = both.VertexInWorld(v);
    const double radius = std::max(std::abs(at.x()), std::abs(at.y()));
    if (radius < 0.6 && radius > 0.25) continue;
    EXPECT_GT(coloring.colors_rgb[v][0], 20) << at.transpose();
  }
}

TEST(VertexColoring, APhotographOfAnotherSizeIsNamed) {
  const fs::path folder = TestFolder();
  const TriangleMesh wall = Wall();
  PosedImage view = View("a.png", {0, 0, -3});
  Paint(folder, view, Vector3d::Ones());
  view.camera = CenteredPinhole(320, 240, 300).Scaled(640, 480);
  EXPECT_THROW(ColorVertices(wall, CasterOf(wall), std::vector{view}, folder), std::runtime_error);
}

}  // namespace
}  // namespace raylift
