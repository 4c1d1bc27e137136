// Reads glTF 2, text and binary: all meshes of the nodes that are shown, whose places stay double.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/read_limits.h"
#include "surfaces/file_readers.h"
#include "surfaces/gltf_file.h"
#include "surfaces/input_files.h"
#include <Eigen/Geometry>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using Eigen::Affine3d;

// The extensions that a file may require: they are read, or do not concern the geometry and its
// base color.
constexpr auto kKnownExtensions = std::to_array<std::string_view>(
    {"CESIUM_RTC", "EXT_mesh_features", "EXT_mesh_gpu_instancing", "EXT_meshopt_compression",
     "EXT_structural_metadata", "EXT_texture_webp", "KHR_draco_mesh_compression",
     "KHR_lights_punctual", "KHR_mesh_quantization", "KHR_texture_transform"});

constexpr Rgb kWhite = {255, 255, 255};

// Converts a color, which glTF states in linear light.
uint8_t ByteOfLinear(float linear) {
  const double c{linear};
  return NearestByte((c <= 0.0031308 ? 12.92 * c : 1.055 * std::pow(c, 1 / 2.4) - 0.055) * 255);
}

// The texture coordinates that a material needs besides its color or picture.
struct UvUse {
  uint64_t set = 0;
  // Transforms the file's texture coordinates, u to the right and v down.
  Eigen::Affine2d uv_transform = Eigen::Affine2d::Identity();
};

// Returns translation * rotation * scale, where the rotation is counter-clockwise as a picture is
// looked at.
UvUse UvUseOf(const JsonPlace& texture) {
  UvUse use{.set = CountOf(texture, "texCoord", 0)};
  IfThere(texture, {"extensions", "KHR_texture_transform"}, [&](const JsonPlace& transform) {
    const Eigen::Vector2d offset = VectorOr<2>(transform, "offset", {0, 0});
    const Eigen::Vector2d scale = VectorOr<2>(transform, "scale", {1, 1});
    double angle = 0;
    IfThere(transform, {"rotation"}, [&](const JsonPlace& rotation) { angle = rotation.Number(); });
    use.set = CountOf(transform, "texCoord", use.set);
    use.uv_transform =
        Eigen::Translation2d(offset) * Eigen::Rotation2Dd(-angle) * Eigen::Scaling(scale);
  });
  return use;
}

// A part of a mesh: its vertices, and three corners for each triangle.
struct Primitive {
  VertexNumbers positions, uvs, colors;
  std::vector<uint32_t> corners;
  size_t material = 0;
};

// Returns the corners of triangles, of a strip of them (whose winding alternates) or of a fan;
// points and lines have none.
std::vector<uint32_t> ToTriangles(uint64_t mode, std::vector<uint32_t> corners) {
  if (mode < 4 || mode > 6) return {};
  if (mode == 4) {
    corners.resize(corners.size() / 3 * 3);
    return corners;
  }
  std::vector<uint32_t> triangles;
  for (size_t i = 0; i + 2 < corners.size(); ++i) {
    const size_t first = mode == 6 ? 0 : i + i % 2;
    const size_t second = mode == 6 ? i + 1 : i + 1 - i % 2;
    triangles.insert(triangles.end(), {corners[first], corners[second], corners[i + 2]});
  }
  return triangles;
}

void RequireKnownExtensions(const GltfFile& file) {
  IfThere(file.root(), {"extensionsRequired"}, [](const JsonPlace& required) {
    for (size_t i = 0; i < required.ArraySize(); ++i) {
      const std::string name = required.At(i).String();
      if (name.starts_with("KHR_materials_") ||
          std::find(kKnownExtensions.begin(), kKnownExtensions.end(), name) !=
              kKnownExtensions.end()) {
        continue;
      }
      required.Fail(fmt::format("the file requires {}, which is not read; write it without", name));
    }
  });
}

// Reads materials and their pictures into a mesh.
class MaterialReader {
 public:
  // All must outlive it.
  MaterialReader(const std::filesystem::path& path, GltfFile& file, RawMesh& mesh)
      : path_(path), file_(file), mesh_(mesh) {}

  void Add(const JsonPlace& material) {
    RawMesh::Material added{.color_rgb = kWhite};
    UvUse use;
    const auto take = [&](const JsonPlace& part, std::string_view texture, std::string_view color) {
      IfThere(part, {texture}, [&](const JsonPlace& info) {
        use = UvUseOf(info);
        const JsonPlace index = info.Member("index");
        added.texture = Texture(file_.Index("textures", index));
      });
      const Eigen::Vector4d linear = VectorOr<4>(part, color, {1, 1, 1, 1});
      for (int c = 0; c < 3; ++c) {
        (*added.color_rgb)[static_cast<size_t>(c)] = ByteOfLinear(static_cast<float>(linear[c]));
      }
    };
    IfThere(material, {"extensions", "KHR_materials_pbrSpecularGlossiness"},
            [&](const JsonPlace& part) { take(part, "diffuseTexture", "diffuseFactor"); });
    IfThere(material, {"pbrMetallicRoughness"},
            [&](const JsonPlace& part) { take(part, "baseColorTexture", "baseColorFactor"); });
    if (material.Has("name")) added.name = material.Member("name").String();
    mesh_.materials.push_back(added);
    uv_uses_.push_back(use);
  }

  // Adds what primitives without a material are like, after the others.
  void AddNone() {
    uv_uses_.emplace_back();
    if (!mesh_.materials.empty()) mesh_.materials.push_back({.color_rgb = kWhite});
  }

  // Returns how the coordinates in a material's picture are found.
  const UvUse& UvUseOfMaterial(size_t index) const { return uv_uses_[index]; }

 private:
  // Returns the index of its picture; -1 where it has none that can be read.
  int32_t Texture(size_t index) {
    const JsonPlace texture = file_.Item("textures", index);
    std::optional<size_t> image;
    const auto take = [&](const JsonPlace& source) { image = file_.Index("images", source); };
    IfThere(texture, {"source"}, take);
    if (!image) IfThere(texture, {"extensions", "EXT_texture_webp", "source"}, take);
    if (!image) {
      mesh_.warnings.push_back(
          fmt::format("{}: textures[{}]: names no picture that is read", path_.string(), index));
      return -1;
    }
    const auto [entry, is_new] = texture_of_image_.try_emplace(*image, -1);
    if (is_new) entry->second = AddPicture(file_.Item("images", *image), *image);
    return entry->second;
  }

  int32_t AddPicture(const JsonPlace& image, size_t index) {
    std::string_view bytes;
    std::optional<std::string> data;
    if (image.Has("uri")) {
      const JsonPlace uri = image.Member("uri");
      data = file_.DataOfUri(uri);
      if (!data) return AddTextureFile(path_, DecodedUri(uri.String()), mesh_);
      bytes = *data;
    } else {
      const JsonPlace view = image.Member("bufferView");
      bytes = file_.BytesOfView(view);
    }
    return AddTexture(path_, fmt::format("images[{}]", index), DecodeTexture(bytes), mesh_);
  }

  const std::filesystem::path& path_;
  GltfFile& file_;
  RawMesh& mesh_;
  std::vector<UvUse> uv_uses_;
  std::map<size_t, int32_t> texture_of_image_;
};

class GltfReader {
 public:
  GltfReader(const std::filesystem::path& path, std::string_view contents, GltfPlace place,
             const Eigen::Matrix3d& z_up_from_gltf)
      : path_(path), file_(path, contents, place), z_up_from_gltf_(z_up_from_gltf) {}
  GltfReader(const GltfReader&) = delete;  // materials_ refers to what is in it

  RawMesh Read(std::span<const Affine3d> copies) {
    RequireKnownExtensions(file_);
    for (size_t i = 0; i < file_.CountItems("materials"); ++i) {
      materials_.Add(file_.Item("materials", i));
    }
    materials_.AddNone();
    std::map<size_t, size_t> uses;
    std::vector<GltfInstance> placed = PlaceMeshes(path_, file_, z_up_from_gltf_, copies);
    for (const GltfInstance& mesh : placed) ++uses[mesh.index];
    std::map<size_t, std::vector<Primitive>> read;  // while they are placed again
    for (GltfInstance& mesh : placed) {
      mesh_.parts.push_back(std::move(mesh.name));
      const auto [entry, is_new] = read.try_emplace(mesh.index);
      if (is_new) entry->second = ReadMesh(mesh.index);
      for (const Primitive& part : entry->second) Add(part, mesh.root_from_mesh);
      if (--uses[mesh.index] == 0) read.erase(entry);
    }
    if (!mesh_.uvs.empty()) mesh_.uvs.resize(mesh_.positions.size(), {0, 0});
    if (!mesh_.position_colors.empty()) {
      mesh_.position_colors.resize(mesh_.positions.size(), kWhite);
    }
    return std::move(mesh_);
  }

 private:
  std::vector<Primitive> ReadMesh(size_t index) {
    std::vector<Primitive> parts;
    const JsonPlace mesh = file_.Item("meshes", index);
    const JsonPlace primitives = mesh.Member("primitives");
    for (size_t i = 0; i < primitives.ArraySize(); ++i) {
      const JsonPlace primitive = primitives.At(i);
      const uint64_t mode = CountOf(primitive, "mode", 4);
      parts.push_back(ReadPrimitive(primitive, mode));
    }
    return parts;
  }

  struct Wanted {
    std::string_view name;
    size_t components;  // 0: 3 or 4
    VertexNumbers* numbers;
  };

  Primitive ReadPrimitive(const JsonPlace& place, uint64_t mode) {
    Primitive primitive;
    primitive.material = file_.CountItems("materials");
    IfThere(place, {"material"}, [&](const JsonPlace& material) {
      primitive.material = file_.Index("materials", material);
    });
    const std::string uv_name =
        fmt::format("TEXCOORD_{}", materials_.UvUseOfMaterial(primitive.material).set);
    const JsonPlace attributes = place.Member("attributes");
    const std::array<Wanted, 3> wanted = {{{"POSITION", 3, &primitive.positions},
                                           {uv_name, 2, &primitive.uvs},
                                           {"COLOR_0", 0, &primitive.colors}}};
    bool is_compressed = false;
    IfThere(place, {"extensions", "KHR_draco_mesh_compression"}, [&](const JsonPlace& draco) {
      is_compressed = true;
      primitive.corners = ReadDraco(draco, attributes, wanted);
    });
    for (const Wanted& want : wanted) {
      if (want.numbers->count() == 0) {
        *want.numbers = file_.ReadAttribute(attributes, want.name, want.components);
      }
    }
    if (!is_compressed) ReadCorners(place, mode, primitive);
    const size_t count = primitive.positions.count();
    if (count == 0) return Primitive();  // as the specification has it, there is nothing to show
    num_read_ += count + primitive.corners.size() / 3;
    if (num_read_ > kMaxPlacedParts) FailOfManyMeshes(path_);
    for (const VertexNumbers* numbers : {&primitive.uvs, &primitive.colors}) {
      if (numbers->count() != 0 && numbers->count() != count) {
        place.Fail(fmt::format("expected {} of each attribute", count));
      }
    }
    for (const uint32_t corner : primitive.corners) {
      if (corner >= count) {
        place.Fail(fmt::format("expected a vertex index below {}, found {}", count, corner));
      }
    }
    return primitive;
  }

  void ReadCorners(const JsonPlace& place, uint64_t mode, Primitive& primitive) {
    std::vector<uint32_t> corners;
    if (place.Has("indices")) {
      const JsonPlace indices = place.Member("indices");
      corners = file_.ReadIndices(indices);
    } else {
      corners.resize(primitive.positions.count());
      for (size_t i = 0; i < corners.size(); ++i) corners[i] = static_cast<uint32_t>(i);
    }
    primitive.corners = ToTriangles(mode, std::move(corners));
  }

  // Sets what is compressed of the wanted numbers, and returns the triangles' corners.
  std::vector<uint32_t> ReadDraco(const JsonPlace& draco, const JsonPlace& attributes,
                                  std::span<const Wanted> wanted) {
    const JsonPlace ids = draco.Member("attributes");
    std::vector<DracoAttribute> compressed;
    std::vector<VertexNumbers*> targets;
    for (const Wanted& want : wanted) {
      if (!ids.Has(want.name)) continue;
      bool is_normalized = false;
      IfThere(attributes, {want.name}, [&](const JsonPlace& index) {
        const JsonPlace accessor = file_.Item("accessors", file_.Index("accessors", index));
        IfThere(accessor, {"normalized"}, [&](const JsonPlace& n) { is_normalized = n.Bool(); });
      });
      compressed.push_back({static_cast<uint32_t>(CountOf(ids, want.name, 0)),
                            want.components == 0 ? 3 : want.components, is_normalized});
      targets.push_back(want.numbers);
    }
    const JsonPlace view = draco.Member("bufferView");
    const std::string_view bytes = file_.BytesOfView(view);
    DracoMesh mesh = draco.Blame([&] { return DecodeDraco(bytes, compressed); });
    for (size_t i = 0; i < targets.size(); ++i) *targets[i] = std::move(mesh.attributes[i]);
    return std::move(mesh.corners);
  }

  void Add(const Primitive& primitive, const Affine3d& root_from_mesh) {
    const size_t first = mesh_.positions.size();
    const size_t count = primitive.positions.count();
    num_placed_ += count + primitive.corners.size() / 3;
    if (num_placed_ > kMaxPlacedParts) FailOfManyMeshes(path_);
    for (size_t i = 0; i < count; ++i) {
      mesh_.positions.push_back(root_from_mesh * ItemOf<3>(primitive.positions, i));
    }
    AddUvs(primitive, first);
    AddColors(primitive, first);
    const bool is_mirrored = root_from_mesh.linear().determinant() < 0;
    for (size_t i = 0; i < primitive.corners.size(); i += 3) {
      std::array<uint32_t, 3> corners;
      for (size_t k = 0; k < 3; ++k) {
        corners[k] = static_cast<uint32_t>(first) + primitive.corners[i + k];
      }
      if (is_mirrored) std::swap(corners[1], corners[2]);
      mesh_.triangles.push_back(corners);
    }
    mesh_.triangle_materials.resize(mesh_.triangles.size(),
                                    primitive.material < mesh_.materials.size()
                                        ? static_cast<uint32_t>(primitive.material)
                                        : RawMesh::kNone);
    mesh_.triangle_parts.resize(mesh_.triangles.size(),
                                static_cast<uint32_t>(mesh_.parts.size()) - 1);
  }

  // Adds the texture coordinates of a part of a mesh; glTF's v goes down.
  void AddUvs(const Primitive& primitive, size_t first) {
    if (primitive.uvs.count() == 0) return;
    mesh_.uvs.resize(first, {0, 0});
    const Eigen::Affine2d& transform = materials_.UvUseOfMaterial(primitive.material).uv_transform;
    for (size_t i = 0; i < primitive.uvs.count(); ++i) {
      const Eigen::Vector2d down = transform * ItemOf<2>(primitive.uvs, i);
      mesh_.uvs.push_back(Eigen::Vector2d(down.x(), 1 - down.y()).cast<float>());
    }
  }

  void AddColors(const Primitive& primitive, size_t first) {
    if (primitive.colors.count() == 0) return;
    mesh_.position_colors.resize(first, kWhite);
    for (size_t i = 0; i < primitive.colors.count(); ++i) {
      const float* const linear = &primitive.colors.values[primitive.colors.components * i];
      mesh_.position_colors.push_back(
          {ByteOfLinear(linear[0]), ByteOfLinear(linear[1]), ByteOfLinear(linear[2])});
    }
  }

  const std::filesystem::path path_;
  GltfFile file_;
  const Eigen::Matrix3d z_up_from_gltf_;
  RawMesh mesh_;
  MaterialReader materials_{path_, file_, mesh_};
  size_t num_read_ = 0, num_placed_ = 0;  // vertices and triangles
};

}  // namespace

Eigen::Matrix3d ZUpFromYUp() {
  return (Eigen::Matrix3d() << 1, 0, 0, 0, 0, -1, 0, 1, 0).finished();
}

RawMesh ReadGltf(const std::filesystem::path& path, std::string_view contents, GltfPlace place,
                 const Eigen::Matrix3d& z_up_from_gltf, std::span<const Affine3d> copies) {
  return GltfReader(path, contents, place, z_up_from_gltf).Read(copies);
}

}  // namespace raylift
