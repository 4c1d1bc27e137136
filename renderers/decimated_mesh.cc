#include "raylift/renderers/decimated_mesh.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "texture.h"
#include <Eigen/Geometry>

#include "raylift/base/nearest_byte.h"

namespace raylift {
namespace {

using Triangles = std::vector<std::array<uint32_t, 3>>;

// Numbers of cells along a side fit into these bits of a key.
constexpr int kBitsPerSide = 21;

double Area(const TriangleMesh& mesh) {
  double area = 0;
  for (const auto& [a, b, c] : mesh.triangles) {
    const Eigen::Vector3f& corner = mesh.vertices[a];
    area += 0.5 * (mesh.vertices[b] - corner).cross(mesh.vertices[c] - corner).norm();
  }
  return area;
}

// For each vertex the number of its cell, in the order of the cells' first vertices.
struct Cells {
  std::vector<uint32_t> of_vertex;
  uint32_t count = 0;
};
Cells FindCells(const TriangleMesh& mesh, const Eigen::Vector3f& low, double side) {
  Cells cells;
  std::unordered_map<uint64_t, uint32_t> numbers;
  cells.of_vertex.reserve(mesh.vertices.size());
  for (const Eigen::Vector3f& vertex : mesh.vertices) {
    const Eigen::Vector3d place = (vertex - low).cast<double>() / side;
    uint64_t key = 0;
    for (const double coordinate : {place.x(), place.y(), place.z()}) {
      key = key << kBitsPerSide | static_cast<uint64_t>(coordinate);
    }
    cells.of_vertex.push_back(numbers.emplace(key, cells.count).first->second);
    cells.count = static_cast<uint32_t>(numbers.size());
  }
  return cells;
}

// Those between three cells, once each.
Triangles TrianglesOf(const TriangleMesh& mesh, const Cells& cells) {
  Triangles triangles;
  for (const auto& [a, b, c] : mesh.triangles) {
    std::array<uint32_t, 3> corners = {cells.of_vertex[a], cells.of_vertex[b], cells.of_vertex[c]};
    if (corners[0] == corners[1] || corners[1] == corners[2] || corners[2] == corners[0]) continue;
    std::rotate(corners.begin(), std::min_element(corners.begin(), corners.end()), corners.end());
    triangles.push_back(corners);
  }
  std::sort(triangles.begin(), triangles.end());
  triangles.erase(std::unique(triangles.begin(), triangles.end()), triangles.end());
  return triangles;
}

struct Coarse {
  double side;  // of a cell
  Cells cells;
  Triangles triangles;
};
Coarse Coarsen(const TriangleMesh& mesh, const Eigen::Vector3f& low, double side) {
  Coarse coarse{side, FindCells(mesh, low, side), {}};
  coarse.triangles = TrianglesOf(mesh, coarse.cells);
  return coarse;
}

// The finest, within 5 %, that has no more triangles than this.
Coarse FinestWithin(const TriangleMesh& mesh, size_t max_triangles) {
  Eigen::AlignedBox3f box;
  for (const Eigen::Vector3f& vertex : mesh.vertices) box.extend(vertex);
  const double extent = box.diagonal().cast<double>().maxCoeff();
  constexpr double kMaxCells = (1 << kBitsPerSide) - 1;
  // A cell of a plane has two triangles; fewer where the mesh has large ones and small ones.
  const double of_plane = std::sqrt(2 * Area(mesh) / static_cast<double>(max_triangles));
  Coarse best = Coarsen(mesh, box.min(), std::max(of_plane, extent / kMaxCells));
  while (best.triangles.size() > max_triangles) {
    best = Coarsen(mesh, box.min(), 1.1 * best.side);
  }
  double too_fine = std::max(best.side / 1024, extent / kMaxCells);
  while (best.side > 1.05 * too_fine) {
    Coarse finer = Coarsen(mesh, box.min(), std::sqrt(best.side * too_fine));
    if (finer.triangles.size() > max_triangles) {
      too_fine = finer.side;
    } else {
      best = std::move(finer);
    }
  }
  return best;
}

constexpr std::array<uint8_t, 3> kGray = {128, 128, 128};

// Of textured meshes: what a texture shows around each vertex, where `num_triangles` share it.
std::vector<std::array<uint8_t, 3>> ColorsOfTextures(const TriangleMesh& mesh,
                                                     size_t num_triangles) {
  std::vector<std::array<uint8_t, 3>> colors(mesh.vertices.size(), kGray);
  if (!mesh.vertex_colors_rgb.empty()) colors = mesh.vertex_colors_rgb;
  const std::vector<Texture> textures(mesh.textures.begin(), mesh.textures.end());
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (mesh.triangle_textures[i] < 0) continue;
    const Texture& texture = textures[static_cast<size_t>(mesh.triangle_textures[i])];
    const double texels = texture.NumTexels() / static_cast<double>(num_triangles);
    for (const uint32_t vertex : mesh.triangles[i]) {
      const Eigen::Vector3f color =
          texture.Sample(mesh.texture_coordinates[vertex], 0.5 * std::log2(texels));
      for (Eigen::Index c = 0; c < 3; ++c) {
        colors[vertex][static_cast<size_t>(c)] = NearestByte(static_cast<double>(color[c]));
      }
    }
  }
  return colors;
}

}  // namespace

TriangleMesh DecimatedMesh(const TriangleMesh& mesh, size_t max_triangles) {
  if (mesh.triangles.size() <= max_triangles) return mesh;
  Coarse best = FinestWithin(mesh, max_triangles);
  const Cells& cells = best.cells;
  std::vector<std::array<uint8_t, 3>> colors = mesh.vertex_colors_rgb;
  if (!mesh.textures.empty()) colors = ColorsOfTextures(mesh, best.triangles.size());

  std::vector<Eigen::Vector3d> positions(cells.count, Eigen::Vector3d::Zero());
  std::vector<Eigen::Vector3d> sums(colors.empty() ? 0 : cells.count, Eigen::Vector3d::Zero());
  std::vector<double> counts(cells.count, 0);
  for (size_t i = 0; i < mesh.vertices.size(); ++i) {
    const uint32_t cell = cells.of_vertex[i];
    positions[cell] += mesh.vertices[i].cast<double>();
    counts[cell] += 1;
    if (!colors.empty()) sums[cell] += Eigen::Vector3d(colors[i][0], colors[i][1], colors[i][2]);
  }
  TriangleMesh coarse;
  coarse.origin_in_world = mesh.origin_in_world;
  coarse.triangles = std::move(best.triangles);
  for (size_t i = 0; i < cells.count; ++i) {
    coarse.vertices.push_back((positions[i] / counts[i]).cast<float>());
    if (colors.empty()) continue;
    const Eigen::Vector3d mean = sums[i] / counts[i];
    coarse.vertex_colors_rgb.push_back(
        {NearestByte(mean.x()), NearestByte(mean.y()), NearestByte(mean.z())});
  }
  return coarse;
}

}  // namespace raylift
