#include "raylift/renderers/split_mesh.h"

#include <unordered_map>
#include <utility>

namespace raylift {
namespace {

using Triangle = std::array<uint32_t, 3>;

// Halves what is too long, once.
class Splitter {
 public:
  Splitter(float max_edge, TriangleMesh& mesh) : max_edge_(max_edge), mesh_(mesh) {}

  // Whether anything was.
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

  // The vertex in the middle of a long edge, kWhole of others.
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

  // The parts of a triangle, wound as it is.
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
    if (!mesh_.triangle_textures.empty()) {
      std::vector<int32_t> textures(parents.size());
      for (size_t t = 0; t < parents.size(); ++t) textures[t] = mesh_.triangle_textures[parents[t]];
      mesh_.triangle_textures = std::move(textures);
    }
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

TriangleMesh SplitLongEdges(const TriangleMesh& mesh, double max_edge) {
  TriangleMesh split = mesh;
  while (Splitter(static_cast<float>(max_edge), split).Split()) {
  }
  return split;
}

}  // namespace raylift
