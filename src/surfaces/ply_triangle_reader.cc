#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cstring>

#include "base/bytes.h"
#include "surfaces/file_readers.h"
#include "surfaces/input_files.h"
#include "surfaces/raw_mesh.h"
#include <Eigen/Geometry>
#include <fmt/format.h>

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr size_t kRecordsPerTask = size_t{1} << 16;

struct VertexLayout {
  size_t stride = 0;
  PlyType position_type = PlyType::kFloat;
  std::array<size_t, 3> position{};
  std::optional<std::array<size_t, 3>> color;  // bytes
};

struct FaceLayout {
  size_t stride = 0;  // of a triangle
  size_t count = 0;   // where the number of corners stands, one byte
  size_t corners = 0;
};

// Returns the offsets of `names` in a record; nullopt unless all are there and of this type.
std::optional<std::array<size_t, 3>> Places(const PlyElement& element,
                                            const std::array<std::string_view, 3>& names,
                                            PlyType type) {
  std::array<size_t, 3> places{};
  size_t found = 0;
  size_t place = 0;
  for (const PlyProperty& property : element.properties) {
    for (size_t i = 0; i < 3; ++i) {
      if (property.name != names[i]) continue;
      if (property.type != type) return std::nullopt;
      places[i] = place;
      ++found;
    }
    place += SizeOf(property.type);
  }
  return found == 3 ? std::optional(places) : std::nullopt;
}

// Returns whether the general reader takes colors or texture coordinates from vertices by this
// name.
bool IsOtherAttribute(std::string_view name) {
  static constexpr std::string_view kNames[] = {
      "r", "g", "b", "diffuse_red", "diffuse_green", "diffuse_blue",
      "u", "v", "s", "t",           "texture_u",     "texture_v"};
  return std::find(std::begin(kNames), std::end(kNames), name) != std::end(kNames);
}

std::optional<VertexLayout> LayOutVertices(const PlyElement& element) {
  VertexLayout layout;
  for (const PlyProperty& property : element.properties) {
    if (property.count_type || IsOtherAttribute(property.name)) return std::nullopt;
    layout.stride += SizeOf(property.type);
  }
  for (const PlyType type : {PlyType::kFloat, PlyType::kDouble}) {
    if (const auto places = Places(element, {"x", "y", "z"}, type)) {
      layout.position_type = type;
      layout.position = *places;
      layout.color = Places(element, {"red", "green", "blue"}, PlyType::kUint8);
      const bool has_red = std::any_of(element.properties.begin(), element.properties.end(),
                                       [](const PlyProperty& p) { return p.name == "red"; });
      return has_red == layout.color.has_value() ? std::optional(layout) : std::nullopt;
    }
  }
  return std::nullopt;
}

std::optional<FaceLayout> LayOutFaces(const PlyElement& element) {
  FaceLayout layout;
  bool found = false;
  for (const PlyProperty& property : element.properties) {
    if (!property.count_type) {
      if (property.name == "texnumber") return std::nullopt;
      layout.stride += SizeOf(property.type);
      continue;
    }
    const bool is_corners = property.name == "vertex_indices" || property.name == "vertex_index";
    if (found || !is_corners || SizeOf(*property.count_type) != 1 ||
        (property.type != PlyType::kInt32 && property.type != PlyType::kUint32)) {
      return std::nullopt;
    }
    found = true;
    layout.count = layout.stride;
    layout.corners = layout.count + 1;
    layout.stride += 1 + 3 * sizeof(uint32_t);
  }
  return found ? std::optional(layout) : std::nullopt;
}

template <typename T>
Eigen::Vector3d PositionAt(const char* record, const VertexLayout& layout) {
  const auto at = [&](size_t axis) {
    return static_cast<double>(LoadNumber<T>(record + layout.position[axis]));
  };
  return {at(0), at(1), at(2)};
}

class TriangleReader {
 public:
  TriangleReader(const VertexLayout& vertices, size_t num_vertices, const char* vertex_bytes,
                 const FaceLayout& faces, size_t num_faces, const char* face_bytes, int threads)
      : vertices_(vertices),
        num_vertices_(num_vertices),
        vertex_bytes_(vertex_bytes),
        faces_(faces),
        num_faces_(num_faces),
        face_bytes_(face_bytes),
        threads_(threads) {}

  std::optional<TriangleMesh> Read(const std::filesystem::path& path) {
    const bool is_float = vertices_.position_type == PlyType::kFloat;
    if (!(is_float ? ReadAll<float>() : ReadAll<double>())) return std::nullopt;
    const size_t removed = any_without_area_ ? RemoveThoseWithoutArea() : 0;
    if (removed > 0) {
      mesh_.warnings.push_back(fmt::format("{}: {} of {} triangles removed: they have no area",
                                           path.string(), removed, num_faces_));
      used_.assign(num_vertices_, 0);
      for (const auto& triangle : mesh_.triangles) {
        for (const uint32_t corner : triangle) used_[corner] = 1;
      }
    }
    if (mesh_.triangles.empty()) return std::nullopt;
    RemoveUnusedVertices();
    RefuseCoarseFloats(path, mesh_, removed, num_faces_);
    return std::move(mesh_);
  }

 private:
  // Supposes that all vertices are used, and does the vertices again where that is not so and
  // another origin follows from it.
  template <typename T>
  bool ReadAll() {
    const Eigen::AlignedBox3d all = Bounds<T>([](size_t) { return true; });
    if (all.isEmpty()) return false;
    mesh_.origin_in_world = ChooseMeshOrigin(all.min(), all.max());
    ConvertVertices<T>();
    if (!ReadTriangles()) return false;
    if (std::find(used_.begin(), used_.end(), uint8_t{0}) == used_.end()) return !any_unusable_;
    any_unusable_ = false;
    const Eigen::AlignedBox3d used = Bounds<T>([&](size_t i) { return used_[i] != 0; });
    if (any_unusable_ || used.isEmpty()) return false;
    const Eigen::Vector3d origin = ChooseMeshOrigin(used.min(), used.max());
    if (origin != mesh_.origin_in_world) {
      mesh_.origin_in_world = origin;
      ConvertVertices<T>();
      any_without_area_ = true;  // to be looked for again
    }
    return true;
  }

  // Reads the triangles and marks their vertices; returns false where a face is no triangle or has
  // an index that is none.
  bool ReadTriangles() {
    mesh_.triangles.reserve(num_faces_);
    AdviseLargePages(mesh_.triangles.data(), num_faces_ * sizeof(mesh_.triangles[0]));
    mesh_.triangles.resize(num_faces_);
    used_.resize(num_vertices_);
    std::atomic<bool> good{true};
    ParallelForParts(num_faces_, kRecordsPerTask, threads_, [&](size_t begin, size_t end) {
      const char* record = face_bytes_ + begin * faces_.stride;
      std::array<uint32_t, 3>* const triangles = mesh_.triangles.data();
      bool without_area = false;
      for (size_t i = begin; i < end; ++i, record += faces_.stride) {
        std::array<uint32_t, 3> triangle;
        std::memcpy(triangle.data(), record + faces_.corners, sizeof(triangle));
        if (record[faces_.count] != 3 ||
            std::max({triangle[0], triangle[1], triangle[2]}) >= num_vertices_) {
          good = false;
          return;
        }
        for (const uint32_t corner : triangle) MarkUsed(corner);
        without_area |= HasNoArea(triangle);
        triangles[i] = triangle;
      }
      if (without_area) any_without_area_ = true;
      ReleaseMapped({face_bytes_ + begin * faces_.stride, (end - begin) * faces_.stride});
    });
    return good;
  }

  // Marks a vertex as used; many threads may write the same 1.
  void MarkUsed(uint32_t vertex) {
    std::atomic_ref<uint8_t>(used_[vertex]).store(1, std::memory_order_relaxed);
  }

  // Returns the bounds of the usable ones among the vertices for which include(i) is true; notes
  // whether there are others.
  template <typename T, typename Include>
  Eigen::AlignedBox3d Bounds(const Include& include) {
    std::vector<Eigen::AlignedBox3d> boxes((num_vertices_ + kRecordsPerTask - 1) / kRecordsPerTask);
    ParallelForParts(num_vertices_, kRecordsPerTask, threads_, [&](size_t begin, size_t end) {
      Eigen::AlignedBox3d box;
      for (size_t i = begin; i < end; ++i) {
        if (!include(i)) continue;
        const Eigen::Vector3d p = PositionAt<T>(vertex_bytes_ + i * vertices_.stride, vertices_);
        if (IsUsablePosition(p)) {
          box.extend(p);
        } else {
          any_unusable_ = true;
        }
      }
      boxes[begin / kRecordsPerTask] = box;
    });
    Eigen::AlignedBox3d all;
    for (const Eigen::AlignedBox3d& box : boxes) all.extend(box);
    return all;
  }

  template <typename T>
  void ConvertVertices() {
    mesh_.vertices.reserve(num_vertices_ + 1);  // one more: RayCaster can share it
    AdviseLargePages(mesh_.vertices.data(), num_vertices_ * sizeof(mesh_.vertices[0]));
    mesh_.vertices.resize(num_vertices_);
    if (vertices_.color) mesh_.vertex_colors_rgb.resize(num_vertices_);
    ParallelForParts(num_vertices_, kRecordsPerTask, threads_, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) {
        const char* record = vertex_bytes_ + i * vertices_.stride;
        mesh_.vertices[i] =
            (PositionAt<T>(record, vertices_) - mesh_.origin_in_world).template cast<float>();
        if (!vertices_.color) continue;
        for (size_t c = 0; c < 3; ++c) {
          mesh_.vertex_colors_rgb[i][c] = static_cast<uint8_t>(record[(*vertices_.color)[c]]);
        }
      }
      ReleaseMapped({vertex_bytes_ + begin * vertices_.stride, (end - begin) * vertices_.stride});
    });
  }

  // Returns whether a triangle has no area, which is decided in float where that is beyond doubt.
  bool HasNoArea(const std::array<uint32_t, 3>& t) const {
    const Eigen::Vector3f& a = mesh_.vertices[t[0]];
    const Eigen::Vector3f ab = mesh_.vertices[t[1]] - a;
    const Eigen::Vector3f ac = mesh_.vertices[t[2]] - a;
    constexpr float kSurely = 1e-10f;
    if (ab.cross(ac).squaredNorm() > kSurely * ab.squaredNorm() * ac.squaredNorm()) return false;
    return TriangleHasNoArea(a, mesh_.vertices[t[1]], mesh_.vertices[t[2]]);
  }

  // Removes the triangles without area and returns their number; those that stay keep the number of
  // their face.
  size_t RemoveThoseWithoutArea() {
    std::vector<uint32_t> faces;
    for (size_t i = 0; i < mesh_.triangles.size(); ++i) {
      if (!HasNoArea(mesh_.triangles[i])) faces.push_back(static_cast<uint32_t>(i));
    }
    const size_t removed = mesh_.triangles.size() - faces.size();
    if (removed == 0) return 0;
    for (size_t i = 0; i < faces.size(); ++i) mesh_.triangles[i] = mesh_.triangles[faces[i]];
    mesh_.triangles.resize(faces.size());
    mesh_.triangle_faces = std::move(faces);
    return removed;
  }

  void RemoveUnusedVertices() {
    if (std::find(used_.begin(), used_.end(), uint8_t{0}) == used_.end()) return;
    std::vector<uint32_t> new_index(num_vertices_);
    uint32_t kept = 0;
    for (size_t i = 0; i < num_vertices_; ++i) {
      if (used_[i] == 0) continue;
      mesh_.vertices[kept] = mesh_.vertices[i];
      if (vertices_.color) mesh_.vertex_colors_rgb[kept] = mesh_.vertex_colors_rgb[i];
      new_index[i] = kept++;
    }
    mesh_.vertices.resize(kept);
    if (vertices_.color) mesh_.vertex_colors_rgb.resize(kept);
    ParallelForParts(mesh_.triangles.size(), kRecordsPerTask, threads_,
                     [&](size_t begin, size_t end) {
                       for (size_t i = begin; i < end; ++i) {
                         for (uint32_t& corner : mesh_.triangles[i]) corner = new_index[corner];
                       }
                     });
  }

  const VertexLayout& vertices_;
  size_t num_vertices_;
  const char* vertex_bytes_;
  const FaceLayout& faces_;
  size_t num_faces_;
  const char* face_bytes_;
  int threads_;
  TriangleMesh mesh_;
  std::vector<uint8_t> used_;
  std::atomic<bool> any_unusable_{false};
  std::atomic<bool> any_without_area_{false};
};

}  // namespace

std::optional<TriangleMesh> ReadPlyTriangles(const std::filesystem::path& path,
                                             const PlyHeader& header, std::string_view contents,
                                             int threads) {
  const auto native = std::endian::native == std::endian::little ? PlyHeader::Format::kLittleEndian
                                                                 : PlyHeader::Format::kBigEndian;
  if (header.format != native || !header.texture_files.empty() || header.elements.size() < 2 ||
      header.elements[0].name != "vertex" || header.elements[1].name != "face") {
    return std::nullopt;
  }
  const PlyElement& vertex = header.elements[0];
  const PlyElement& face = header.elements[1];
  const auto vertices = LayOutVertices(vertex);
  const auto faces = LayOutFaces(face);
  if (!vertices || !faces || vertex.count == 0 || face.count == 0 ||
      vertex.count >= RawMesh::kNone) {
    return std::nullopt;
  }
  const std::string_view body = contents.substr(header.size_bytes);
  if (vertex.count > body.size() / vertices->stride) return std::nullopt;
  const size_t face_begin = vertex.count * vertices->stride;
  if (face.count > (body.size() - face_begin) / faces->stride) return std::nullopt;
  return TriangleReader(*vertices, vertex.count, body.data(), *faces, face.count,
                        body.data() + face_begin, threads)
      .Read(path);
}

}  // namespace raylift
