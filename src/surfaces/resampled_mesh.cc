#include "surfaces/resampled_mesh.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>
#include <utility>

#include "base/rng.h"
#include "surfaces/texture.h"
#include <Eigen/Geometry>

#include "raylift/scene/image.h"

namespace raylift {
namespace {

using Triangles = std::vector<std::array<uint32_t, 3>>;

// Numbers of cells along a side fit into these bits of a key.
constexpr int kBitsPerSide = 21;

// The number of each vertex's cell, in the order of the cells' first vertices.
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

// Returns the triangles between three cells, once each.
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

// Returns the finest mesh, within 5 %, that has no more triangles than this.
Coarse FinestWithin(const TriangleMesh& mesh, size_t max_triangles) {
  Eigen::AlignedBox3f box;
  for (const Eigen::Vector3f& vertex : mesh.vertices) box.extend(vertex);
  const double extent = box.diagonal().cast<double>().maxCoeff();
  constexpr double kMaxCells = (1 << kBitsPerSide) - 1;
  // A cell of a plane has two triangles; fewer where the mesh has large ones and small ones.
  const double of_plane = std::sqrt(2 * AreaOf(mesh) / static_cast<double>(max_triangles));
  Coarse best = Coarsen(mesh, box.min(), std::max(of_plane, extent / kMaxCells));
  while (best.triangles.size() > max_triangles) best = Coarsen(mesh, box.min(), 1.1 * best.side);
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

// Returns the mean that a texture shows around each vertex, where `num_triangles` share it.
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

using Triangle = std::array<uint32_t, 3>;

// Halves edges that are too long, once.
class Splitter {
 public:
  Splitter(float max_edge, TriangleMesh& mesh) : max_edge_(max_edge), mesh_(mesh) {}

  // Returns whether anything was split.
  bool Split() {
    std::vector<Triangle> triangles;
    std::vector<uint32_t> parents;
    for (size_t t = 0; t < mesh_.triangles.size(); ++t) {
      Add(mesh_.triangles[t], triangles);
      parents.resize(triangles.size(), static_cast<uint32_t>(t));
    }
    if (triangles.size() == mesh_.triangles.size()) return false;
    TakeParents(parents);
    mesh_.triangles = std::move(triangles);
    return true;
  }

 private:
  static constexpr uint32_t kWhole = 0xffffffffu;

  // Returns the vertex in the middle of a long edge, which is added the first time; kWhole for
  // others.
  uint32_t Middle(uint32_t a, uint32_t b) {
    if (a > b) std::swap(a, b);
    if (!((mesh_.vertices[a] - mesh_.vertices[b]).norm() > max_edge_)) return kWhole;
    const auto [found, is_new] =
        middles_.emplace(uint64_t{a} << 32 | b, static_cast<uint32_t>(mesh_.vertices.size()));
    if (is_new) AddBetween(a, b);
    return found->second;
  }

  void AddBetween(uint32_t a, uint32_t b) {
    mesh_.vertices.push_back(0.5f * (mesh_.vertices[a] + mesh_.vertices[b]));
    if (!mesh_.texture_coordinates.empty()) {
      const auto& uv = mesh_.texture_coordinates;
      const Eigen::Vector2f middle = 0.5f * (uv[a] + uv[b]);
      mesh_.texture_coordinates.push_back(middle);
    }
    if (!mesh_.vertex_colors_rgb.empty()) {
      std::array<uint8_t, 3> middle;
      for (size_t c = 0; c < 3; ++c) {
        const int sum = mesh_.vertex_colors_rgb[a][c] + mesh_.vertex_colors_rgb[b][c];
        middle[c] = static_cast<uint8_t>((sum + 1) / 2);
      }
      mesh_.vertex_colors_rgb.push_back(middle);
    }
  }

  // Adds the parts of a triangle, wound as it is.
  void Add(const Triangle& whole, std::vector<Triangle>& triangles) {
    std::array<uint32_t, 3> middle;  // of the edge that begins at each corner
    int count = 0;
    for (size_t k = 0; k < 3; ++k) {
      middle[k] = Middle(whole[k], whole[(k + 1) % 3]);
      count += middle[k] != kWhole ? 1 : 0;
    }
    if (count == 0) {
      triangles.push_back(whole);
    } else if (count == 3) {
      for (size_t k = 0; k < 3; ++k)
        triangles.push_back({whole[k], middle[k], middle[(k + 2) % 3]});
      triangles.push_back(middle);
    } else {
      // Turned so that the first edge is halved and, of two, the last one is whole.
      size_t k = 0;
      while (middle[k] == kWhole || (count == 2 && middle[(k + 2) % 3] != kWhole)) ++k;
      const uint32_t a = whole[k], b = whole[(k + 1) % 3], c = whole[(k + 2) % 3];
      const uint32_t ab = middle[k];
      if (count == 1) {
        triangles.push_back({a, ab, c});
        triangles.push_back({ab, b, c});
        return;
      }
      const uint32_t bc = middle[(k + 1) % 3];
      triangles.push_back({ab, b, bc});
      triangles.push_back({a, ab, bc});
      triangles.push_back({a, bc, c});
    }
  }

  void TakeParents(const std::vector<uint32_t>& parents) {
    std::vector<uint32_t> faces(parents.size());
    for (size_t t = 0; t < parents.size(); ++t) faces[t] = mesh_.FaceOf(parents[t]);
    const auto take = [&parents](auto& values) {
      if (values.empty()) return;
      std::remove_reference_t<decltype(values)> taken(parents.size());
      for (size_t t = 0; t < parents.size(); ++t) taken[t] = values[parents[t]];
      values = std::move(taken);
    };
    take(mesh_.triangle_textures);
    take(mesh_.triangle_labels);
    for (uint32_t& begin : mesh_.object_begins) {
      begin = static_cast<uint32_t>(std::lower_bound(parents.begin(), parents.end(), begin) -
                                    parents.begin());
    }
    mesh_.triangle_faces = std::move(faces);
  }

  const float max_edge_;
  TriangleMesh& mesh_;
  std::unordered_map<uint64_t, uint32_t> middles_;
};

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

TriangleMesh SplitLongEdges(const TriangleMesh& mesh, double max_edge) {
  TriangleMesh split = mesh;
  while (Splitter(static_cast<float>(max_edge), split).Split()) {
  }
  return split;
}

double AreaOf(const TriangleMesh& mesh) {
  double area = 0;
  for (const auto& [a, b, c] : mesh.triangles) {
    const Eigen::Vector3f& corner = mesh.vertices[a];
    area += 0.5 * (mesh.vertices[b] - corner).cross(mesh.vertices[c] - corner).norm();
  }
  return area;
}

std::vector<SurfaceSample> SampleSurface(const TriangleMesh& mesh, size_t count, uint64_t seed) {
  std::vector<double> area_up_to;  // of the triangles, summed up, twice
  area_up_to.reserve(mesh.triangles.size());
  double area = 0;
  for (const auto& [a, b, c] : mesh.triangles) {
    const Eigen::Vector3f cross =
        (mesh.vertices[b] - mesh.vertices[a]).cross(mesh.vertices[c] - mesh.vertices[a]);
    area += cross.cast<double>().norm();
    area_up_to.push_back(area);
  }
  std::vector<SurfaceSample> samples;
  if (!(area > 0)) return samples;
  Rng rng(StreamSeed(seed, "surface", "samples"));
  for (size_t i = 0; i < count; ++i) {
    const auto at =
        std::upper_bound(area_up_to.begin(), area_up_to.end() - 1, rng.Uniform() * area);
    const auto& [a, b, c] = mesh.triangles[static_cast<size_t>(at - area_up_to.begin())];
    double u = rng.Uniform();
    double v = rng.Uniform();
    if (u + v > 1) {
      u = 1 - u;
      v = 1 - v;
    }
    const Eigen::Vector3d origin = mesh.VertexInWorld(a);
    const Eigen::Vector3d ab = mesh.VertexInWorld(b) - origin;
    const Eigen::Vector3d ac = mesh.VertexInWorld(c) - origin;
    samples.push_back({origin + u * ab + v * ac, ab.cross(ac).normalized()});
  }
  return samples;
}

}  // namespace raylift
