#include "surfaces/raw_mesh.h"

#include <algorithm>
#include <limits>
#include <map>
#include <numeric>
#include <utility>

#include "base/input_paths.h"
#include "pictures/picture_codec.h"
#include <Eigen/Geometry>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

// The color of a surface without one in a mesh that has colors elsewhere (the default of MTL
// files).
constexpr Rgb kDefaultColor = {204, 204, 204};

std::vector<uint32_t> FirstIndices(size_t count) {
  std::vector<uint32_t> indices(count);
  std::iota(indices.begin(), indices.end(), 0u);
  return indices;
}

// Removes the triangles for which `remove` is true, with what belongs to them.
template <typename Predicate>
size_t RemoveTriangles(RawMesh& raw, const Predicate& remove) {
  size_t kept = 0;
  const auto with_attributes = [&raw](const auto& act) {
    for (auto* const indices :
         {&raw.triangle_faces, &raw.triangle_materials, &raw.triangle_parts}) {
      if (!indices->empty()) act(*indices);
    }
    if (!raw.triangle_uvs.empty()) act(raw.triangle_uvs);
  };
  for (size_t i = 0; i < raw.triangles.size(); ++i) {
    if (remove(raw.triangles[i])) {
      if (raw.triangle_faces.empty()) raw.triangle_faces = FirstIndices(raw.triangles.size());
      continue;
    }
    raw.triangles[kept] = raw.triangles[i];
    with_attributes([&](auto& values) { values[kept] = values[i]; });
    ++kept;
  }
  const size_t removed = raw.triangles.size() - kept;
  raw.triangles.resize(kept);
  with_attributes([&](auto& values) { values.resize(kept); });
  return removed;
}

// Returns the origin of the used vertices.
Eigen::Vector3d ChooseOrigin(const RawMesh& raw) {
  const double infinity = std::numeric_limits<double>::infinity();
  Eigen::Vector3d low = Eigen::Vector3d::Constant(infinity);
  Eigen::Vector3d high = -low;
  for (const auto& triangle : raw.triangles) {
    for (const uint32_t index : triangle) {
      low = low.cwiseMin(raw.positions[index]);
      high = high.cwiseMax(raw.positions[index]);
    }
  }
  return raw.triangles.empty() ? Eigen::Vector3d::Zero() : ChooseMeshOrigin(low, high);
}

Rgb Product(const Rgb& a, const Rgb& b) {
  Rgb product;
  for (size_t i = 0; i < 3; ++i) product[i] = static_cast<uint8_t>((a[i] * b[i] + 127) / 255);
  return product;
}

// Unites positions, texture coordinates and material colors to vertices: a position gets one
// vertex per combination that its corners use, none if no triangle uses it.
class VertexUniter {
 public:
  VertexUniter(const RawMesh& raw, TriangleMesh& mesh)
      : raw_(raw),
        mesh_(mesh),
        has_colors_(
            !raw.position_colors.empty() ||
            std::any_of(raw.materials.begin(), raw.materials.end(),
                        [](const auto& m) { return m.texture < 0 && m.color_rgb.has_value(); })),
        first_vertex_(raw.positions.size(), RawMesh::kNone) {
    mesh_.vertices.reserve(raw.positions.size() + 1);  // one more: RayCaster can share it
  }

  void AddTriangle(size_t triangle) {
    std::array<uint32_t, 3> corners;
    for (size_t k = 0; k < 3; ++k) {
      const uint32_t position = raw_.triangles[triangle][k];
      const uint32_t uv = raw_.uvs.empty()            ? RawMesh::kNone
                          : raw_.triangle_uvs.empty() ? position
                                                      : raw_.triangle_uvs[triangle][k];
      corners[k] = FindOrAdd(position, uv, Color(position, triangle));
    }
    mesh_.triangles.push_back(corners);
  }

 private:
  struct Attributes {
    uint32_t uv;
    uint32_t next_vertex;  // of the same position
  };

  Rgb Color(uint32_t position, size_t triangle) const {
    if (!has_colors_) return {};
    const uint32_t material =
        raw_.triangle_materials.empty() ? RawMesh::kNone : raw_.triangle_materials[triangle];
    const bool is_plain = material != RawMesh::kNone && raw_.materials[material].texture < 0;
    const std::optional<Rgb> tint = is_plain ? raw_.materials[material].color_rgb : std::nullopt;
    if (raw_.position_colors.empty()) return tint.value_or(kDefaultColor);
    const Rgb& own = raw_.position_colors[position];
    return tint ? Product(own, *tint) : own;
  }

  // Many writers repeat the same coordinates at each corner.
  bool IsSameUv(uint32_t a, uint32_t b) const {
    return a == b || (a != RawMesh::kNone && b != RawMesh::kNone && raw_.uvs[a] == raw_.uvs[b]);
  }

  uint32_t FindOrAdd(uint32_t position, uint32_t uv, const Rgb& color) {
    uint32_t* link = &first_vertex_[position];
    while (*link != RawMesh::kNone) {
      Attributes& vertex = attributes_[*link];
      if (IsSameUv(vertex.uv, uv) && (!has_colors_ || mesh_.vertex_colors_rgb[*link] == color)) {
        return *link;
      }
      link = &vertex.next_vertex;
    }
    const auto added = static_cast<uint32_t>(attributes_.size());
    *link = added;  // before the vector moves what it points into
    attributes_.push_back({uv, RawMesh::kNone});
    mesh_.vertices.push_back((raw_.positions[position] - mesh_.origin_in_world).cast<float>());
    if (has_colors_) mesh_.vertex_colors_rgb.push_back(color);
    if (!raw_.uvs.empty()) {
      mesh_.texture_coordinates.push_back(uv == RawMesh::kNone ? Eigen::Vector2f(0, 0)
                                                               : raw_.uvs[uv]);
    }
    return added;
  }

  const RawMesh& raw_;
  TriangleMesh& mesh_;
  bool has_colors_;
  std::vector<uint32_t> first_vertex_;
  std::vector<Attributes> attributes_;
};

void SetTriangleTextures(const RawMesh& raw, TriangleMesh& mesh) {
  const bool textured =
      std::any_of(raw.triangle_materials.begin(), raw.triangle_materials.end(),
                  [&](uint32_t m) { return m != RawMesh::kNone && raw.materials[m].texture >= 0; });
  if (!textured || raw.uvs.empty()) return;
  mesh.triangle_textures.reserve(raw.triangles.size());
  for (size_t i = 0; i < raw.triangles.size(); ++i) {
    const uint32_t material = raw.triangle_materials[i];
    const bool has_uvs =
        raw.triangle_uvs.empty() ||
        std::count(raw.triangle_uvs[i].begin(), raw.triangle_uvs[i].end(), RawMesh::kNone) == 0;
    mesh.triangle_textures.push_back(
        material != RawMesh::kNone && has_uvs ? raw.materials[material].texture : -1);
  }
}

// Sets a label for each pair of part and material that triangles have.
void SetTriangleLabels(const RawMesh& raw, TriangleMesh& mesh) {
  const bool named = !raw.parts.empty() ||
                     std::any_of(raw.materials.begin(), raw.materials.end(),
                                 [](const auto& material) { return !material.name.empty(); });
  if (!named) return;
  std::map<std::pair<uint32_t, uint32_t>, uint32_t> numbers;
  std::pair<uint32_t, uint32_t> before;  // triangles of one label mostly follow each other
  mesh.triangle_labels.reserve(raw.triangles.size());
  for (size_t i = 0; i < raw.triangles.size(); ++i) {
    const uint32_t part = raw.triangle_parts.empty() ? RawMesh::kNone : raw.triangle_parts[i];
    const uint32_t material =
        raw.triangle_materials.empty() ? RawMesh::kNone : raw.triangle_materials[i];
    if (i > 0 && before == std::pair(part, material)) {
      mesh.triangle_labels.push_back(mesh.triangle_labels.back());
      continue;
    }
    before = {part, material};
    const auto [entry, is_new] =
        numbers.try_emplace(before, static_cast<uint32_t>(mesh.labels.size()));
    mesh.triangle_labels.push_back(entry->second);
    if (!is_new) continue;
    SurfaceLabel& label = mesh.labels.emplace_back();
    if (part != RawMesh::kNone)
      label.instance_name = PartName("", raw.parts[label.instance = part]);
    if (material != RawMesh::kNone) label.material = PartName("", raw.materials[material].name);
  }
  mesh.num_instances = static_cast<uint32_t>(raw.parts.size());
  NumberMaterials(mesh);
}

}  // namespace

size_t AddFace(size_t face, std::span<const uint32_t> corners, std::span<const uint32_t> corner_uvs,
               RawMesh& mesh, std::span<const uint32_t> hole_begins) {
  const auto add = [&](uint32_t a, uint32_t b, uint32_t c) {
    if (mesh.triangle_faces.empty() && mesh.triangles.size() != face) {
      mesh.triangle_faces = FirstIndices(mesh.triangles.size());
    }
    if (mesh.triangles.size() != face || !mesh.triangle_faces.empty()) {
      mesh.triangle_faces.push_back(static_cast<uint32_t>(face));
    }
    mesh.triangles.push_back({corners[a], corners[b], corners[c]});
    if (!corner_uvs.empty()) {
      mesh.triangle_uvs.push_back({corner_uvs[a], corner_uvs[b], corner_uvs[c]});
    }
  };
  if (corners.size() == 3) {
    add(0, 1, 2);
    return 1;
  }
  std::vector<Eigen::Vector3d> points;
  points.reserve(corners.size());
  for (const uint32_t corner : corners) points.push_back(mesh.positions[corner]);
  const auto triangles = TriangulatePolygon(points, hole_begins);
  for (const auto& [a, b, c] : triangles) add(a, b, c);
  return triangles.size();
}

Eigen::Vector3d ChooseMeshOrigin(const Eigen::Vector3d& low, const Eigen::Vector3d& high) {
  const double extent = (high - low).maxCoeff();
  if (!(extent > 0)) return low;
  const double step = std::exp2(std::ceil(std::log2(extent)));
  const Eigen::Vector3d center = 0.5 * low + 0.5 * high;
  return center.unaryExpr([step](double c) { return step * std::round(c / step) + 0.0; });
}

bool TriangleHasNoArea(const Eigen::Vector3f& a, const Eigen::Vector3f& b,
                       const Eigen::Vector3f& c) {
  const Eigen::Vector3d ab = b.cast<double>() - a.cast<double>();
  const Eigen::Vector3d ac = c.cast<double>() - a.cast<double>();
  return ab.cross(ac).squaredNorm() == 0;
}

void RefuseCoarseFloats(const std::filesystem::path& path, const TriangleMesh& mesh,
                        size_t without_area, size_t triangles_in_file) {
  constexpr double kShare = 0.01;  // of triangles; scans have some that never had an area
  if (static_cast<double>(without_area) <= kShare * static_cast<double>(triangles_in_file)) return;
  double farthest = 0;
  for (uint32_t i = 0; i < mesh.vertices.size(); ++i) {
    const Eigen::Vector3d p = mesh.VertexInWorld(i);
    if (p.cast<float>().cast<double>() != p) return;
    farthest = std::max(farthest, p.cwiseAbs().maxCoeff());
  }
  std::vector<float> edges;
  for (const auto& t : mesh.triangles) {
    edges.push_back((mesh.vertices[t[0]] - mesh.vertices[t[1]]).norm());
  }
  std::nth_element(edges.begin(), edges.begin() + std::ssize(edges) / 2, edges.end());
  const double step = farthest * std::numeric_limits<float>::epsilon();
  constexpr double kFineSteps = 16;  // of an edge whose triangle keeps its shape
  if (edges[edges.size() / 2] > kFineSteps * step) return;
  throw InputError(
      path, fmt::format("{} of {} triangles lost their area, as coordinates of {:.7g} are floats, "
                        "which have steps of {:.2g} there; write its vertices as double, or "
                        "relative to an origin that shift=X/Y/Z adds",
                        without_area, triangles_in_file, farthest, step));
}

TriangleMesh FinishMesh(const std::filesystem::path& path, RawMesh raw) {
  const size_t triangles_in_file = raw.triangles.size();
  auto mesh = FinishMeshIfAny(path, std::move(raw));
  if (mesh) return std::move(*mesh);
  throw InputError(path, fmt::format("expected a mesh, found {} triangles, none of which has "
                                     "finite vertices and an area",
                                     triangles_in_file));
}

std::optional<TriangleMesh> FinishMeshIfAny(const std::filesystem::path& path, RawMesh raw) {
  if (raw.triangles.empty()) {
    if (raw.positions.empty()) {
      throw InputError(path, "expected a mesh, found no vertices and no faces");
    }
    throw InputError(path,
                     fmt::format("expected a mesh, found a point cloud: {} vertices, no faces",
                                 raw.positions.size()));
  }
  const size_t triangles_in_file = raw.triangles.size();
  const size_t not_finite = RemoveTriangles(raw, [&](const auto& t) {
    return !(IsUsablePosition(raw.positions[t[0]]) && IsUsablePosition(raw.positions[t[1]]) &&
             IsUsablePosition(raw.positions[t[2]]));
  });
  TriangleMesh mesh;
  mesh.origin_in_world = ChooseOrigin(raw);
  const auto local = [&](uint32_t index) -> Eigen::Vector3f {
    return (raw.positions[index] - mesh.origin_in_world).cast<float>();
  };
  const size_t without_area = RemoveTriangles(
      raw, [&](const auto& t) { return TriangleHasNoArea(local(t[0]), local(t[1]), local(t[2])); });
  mesh.crs = std::move(raw.crs);
  mesh.warnings = std::move(raw.warnings);
  if (not_finite > 0) {
    mesh.warnings.push_back(fmt::format("{}: {} of {} triangles removed: a vertex is not finite",
                                        path.string(), not_finite, triangles_in_file));
  }
  if (without_area > 0) {
    mesh.warnings.push_back(fmt::format("{}: {} of {} triangles removed: they have no area",
                                        path.string(), without_area, triangles_in_file));
  }
  if (raw.triangles.empty()) return std::nullopt;
  mesh.triangles.reserve(raw.triangles.size());
  VertexUniter uniter(raw, mesh);
  for (size_t i = 0; i < raw.triangles.size(); ++i) uniter.AddTriangle(i);
  RefuseCoarseFloats(path, mesh, without_area, triangles_in_file);
  SetTriangleTextures(raw, mesh);
  SetTriangleLabels(raw, mesh);
  mesh.textures = std::move(raw.textures);
  mesh.triangle_faces = std::move(raw.triangle_faces);
  return mesh;
}

std::string PartName(std::string_view above, std::string_view name) {
  constexpr size_t kMaxLength = 200;
  std::string whole(above);
  if (!above.empty() && !name.empty()) whole += '/';
  whole += name;
  if (whole.size() <= kMaxLength) return whole;
  size_t begin = whole.size() - kMaxLength;
  while (begin < whole.size() && (whole[begin] & 0xC0) == 0x80)
    ++begin;  // within a letter of UTF-8
  return whole.substr(begin);
}

uint32_t MaterialOf(std::string_view name, std::map<std::string, uint32_t, std::less<>>& by_name,
                    RawMesh& mesh) {
  const auto next = static_cast<uint32_t>(mesh.materials.size());
  const auto [entry, is_new] = by_name.try_emplace(std::string(name), next);
  if (is_new) mesh.materials.push_back({.name = entry->first});
  return entry->second;
}

void NumberMaterials(TriangleMesh& mesh) {
  std::map<std::string, uint32_t> numbers;
  for (SurfaceLabel& label : mesh.labels) {
    if (label.material.empty()) continue;
    const auto next = static_cast<uint32_t>(numbers.size());
    label.semantic = numbers.try_emplace(label.material, next).first->second;
    label.semantic_name = label.material;
  }
}

std::optional<Image> DecodeTexture(std::string_view bytes) {
  try {
    return DecodePicture(bytes, ImageChannels::kRgb);
  } catch (const InputError&) {
    return std::nullopt;
  }
}

int32_t AddTexture(const std::filesystem::path& mesh_path, std::string_view what,
                   std::optional<Image> picture, RawMesh& mesh) {
  if (!picture) {
    mesh.warnings.push_back(
        fmt::format("{}: {}: cannot be decoded as a picture", mesh_path.string(), what));
    return -1;
  }
  mesh.textures.push_back(std::move(*picture));
  return static_cast<int32_t>(mesh.textures.size()) - 1;
}

bool IsBelow(const std::filesystem::path& mesh_path, std::string_view what,
             const std::string& named, RawMesh& mesh) {
  if (MayBeRead(named)) return true;
  mesh.warnings.push_back(
      fmt::format("{}: {} {}: not read, as it is not below the mesh's folder; "
                  "RAYLIFT_FILES_ANYWHERE=1 in the environment allows it",
                  mesh_path.string(), what, named));
  return false;
}

int32_t AddTextureFile(const std::filesystem::path& mesh_path, const std::string& name,
                       RawMesh& mesh) {
  std::string portable = name;
  std::replace(portable.begin(), portable.end(), '\\', '/');
  if (!IsBelow(mesh_path, "texture", portable, mesh)) return -1;
  const std::filesystem::path path = mesh_path.parent_path() / portable;
  try {
    return AddTexture(mesh_path, fmt::format("texture {}", path.string()),
                      DecodeTexture(ReadFile(path)), mesh);
  } catch (const InputError& error) {
    mesh.warnings.push_back(fmt::format("{}: texture {}", mesh_path.string(), error.what()));
    return -1;
  }
}

}  // namespace raylift
