#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <new>
#include <utility>

#include "base/input_paths.h"
#include "base/read_limits.h"
#include "surfaces/file_readers.h"
#include "surfaces/input_files.h"
#include "surfaces/raw_mesh.h"
#include <Eigen/Geometry>
#include <assimp/Importer.hpp>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/scene/image.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

constexpr unsigned int kSteps = aiProcess_Triangulate;

Eigen::Affine3d ToEigen(const aiMatrix4x4& m) {
  Eigen::Affine3d transform;
  transform.matrix() << m.a1, m.a2, m.a3, m.a4, m.b1, m.b2, m.b3, m.b4, m.c1, m.c2, m.c3, m.c4,  //
      m.d1, m.d2, m.d3, m.d4;
  return transform;
}

double SrgbFromLinear(double c) {
  return c <= 0.0031308 ? 12.92 * c : 1.055 * std::pow(c, 1 / 2.4) - 0.055;
}

class SceneConverter {
 public:
  // glTF states colors in linear light, the other formats as they are shown.
  SceneConverter(const std::filesystem::path& path, const aiScene& scene,
                 const std::optional<GltfScene>& gltf, const Eigen::Vector3d& center)
      : path_(path), scene_(scene), gltf_(gltf), root_from_scene_(Eigen::Translation3d(center)) {}

  RawMesh Convert() {
    for (unsigned int i = 0; i < scene_.mNumMaterials; ++i) AddMaterial(*scene_.mMaterials[i]);
    for (unsigned int i = 0; i < scene_.mNumMeshes; ++i) {
      any_colors_ |= scene_.mMeshes[i]->HasVertexColors(0);
      any_uvs_ |= scene_.mMeshes[i]->HasTextureCoords(0);
    }
    if (scene_.mRootNode != nullptr) AddRoot(*scene_.mRootNode);
    return std::move(mesh_);
  }

 private:
  Rgb Color(const aiColor4D& color) const {
    const auto byte = [&](double c) { return NearestByte((gltf_ ? SrgbFromLinear(c) : c) * 255); };
    return {byte(color.r), byte(color.g), byte(color.b)};
  }

  void AddMaterial(const aiMaterial& material) {
    RawMesh::Material added;
    for (const aiTextureType type : {aiTextureType_BASE_COLOR, aiTextureType_DIFFUSE}) {
      aiString name;
      if (added.texture < 0 && material.GetTexture(type, 0, &name) == aiReturn_SUCCESS) {
        added.texture = Texture(name.C_Str());
      }
    }
    aiColor4D color;
    if (material.Get(AI_MATKEY_BASE_COLOR, color) == aiReturn_SUCCESS ||
        material.Get(AI_MATKEY_COLOR_DIFFUSE, color) == aiReturn_SUCCESS) {
      added.color_rgb = Color(color);
    }
    mesh_.materials.push_back(added);
  }

  int32_t Texture(const std::string& name) {
    const auto [entry, is_new] = texture_by_name_.try_emplace(name, -1);
    if (is_new) {
      const aiTexture* embedded = scene_.GetEmbeddedTexture(name.c_str());
      entry->second = embedded != nullptr
                          ? AddEmbedded(*embedded, name)
                          : AddTextureFile(path_, gltf_ ? DecodedUri(name) : name, mesh_);
    }
    return entry->second;
  }

  int32_t AddEmbedded(const aiTexture& texture, const std::string& name) {
    std::optional<Image> image;
    if (texture.mHeight == 0) {  // a whole file of mWidth bytes
      image = DecodeTexture({reinterpret_cast<const uint8_t*>(texture.pcData), texture.mWidth});
    } else {
      image = Image{static_cast<int>(texture.mWidth), static_cast<int>(texture.mHeight), 3, {}};
      const size_t count = size_t{texture.mWidth} * texture.mHeight;
      image->data.reserve(count * 3);
      for (size_t i = 0; i < count; ++i) {
        const aiTexel& texel = texture.pcData[i];
        image->data.insert(image->data.end(), {texel.r, texel.g, texel.b});
      }
    }
    if (!image) {
      mesh_.warnings.push_back(fmt::format(
          "{}: embedded texture {}: cannot be decoded as a picture", path_.string(), name));
      return -1;
    }
    mesh_.textures.push_back(std::move(*image));
    return static_cast<int32_t>(mesh_.textures.size()) - 1;
  }

  // Assimp makes a node above those of a glTF scene, unless there is one.
  void AddRoot(const aiNode& root) {
    if (!gltf_ || gltf_->roots.empty()) return AddNode(root, root_from_scene_, 0, std::nullopt);
    if (gltf_->roots.size() == 1) return AddNode(root, root_from_scene_, 0, gltf_->roots[0]);
    RequireChildren(root, gltf_->roots);
    for (unsigned int i = 0; i < root.mNumChildren; ++i) {
      AddNode(*root.mChildren[i], root_from_scene_, 1, gltf_->roots[i]);
    }
  }

  void RequireChildren(const aiNode& node, const std::vector<size_t>& children) const {
    if (node.mNumChildren == children.size()) return;
    throw InputError(path_, "nodes", "their tree is not what it is read as");
  }

  // `index`: of a glTF node, whose place assimp has in float alone.
  void AddNode(const aiNode& node, const Eigen::Affine3d& root_from_parent, int depth,
               std::optional<size_t> index) {
    if (depth > kMaxNodeNesting) {
      throw InputError(path_, fmt::format("nodes are nested more than {} deep", kMaxNodeNesting));
    }
    const Eigen::Affine3d root_from_node =
        root_from_parent *
        (index ? gltf_->nodes[*index].parent_from_node : ToEigen(node.mTransformation));
    for (unsigned int i = 0; i < node.mNumMeshes; ++i) {
      AddMesh(*scene_.mMeshes[node.mMeshes[i]], root_from_node);
    }
    if (index) RequireChildren(node, gltf_->nodes[*index].children);
    for (unsigned int i = 0; i < node.mNumChildren; ++i) {
      AddNode(*node.mChildren[i], root_from_node, depth + 1,
              index ? std::optional(gltf_->nodes[*index].children[i]) : std::nullopt);
    }
  }

  // Assimp's v goes up; glTF's and its transforms' go down.
  Eigen::Vector2f TextureCoordinate(const aiMesh& part, const aiVector3D& uv) const {
    if (!gltf_ || part.mMaterialIndex >= gltf_->uv_transforms.size()) return {uv.x, uv.y};
    const Eigen::Vector2d down =
        gltf_->uv_transforms[part.mMaterialIndex] * Eigen::Vector2d(uv.x, 1.0 - uv.y);
    return Eigen::Vector2d(down.x(), 1 - down.y()).cast<float>();
  }

  void AddMesh(const aiMesh& part, const Eigen::Affine3d& root_from_part) {
    const size_t first = mesh_.positions.size();
    if (first + part.mNumVertices >= RawMesh::kNone) throw InputError(path_, "too many vertices");
    for (unsigned int i = 0; i < part.mNumVertices; ++i) {
      const aiVector3D& v = part.mVertices[i];
      mesh_.positions.push_back(root_from_part * Eigen::Vector3d(v.x, v.y, v.z));
      if (any_colors_) {
        mesh_.position_colors.push_back(part.HasVertexColors(0) ? Color(part.mColors[0][i])
                                                                : Rgb{255, 255, 255});
      }
      if (any_uvs_) {
        mesh_.uvs.push_back(part.HasTextureCoords(0)
                                ? TextureCoordinate(part, part.mTextureCoords[0][i])
                                : Eigen::Vector2f(0, 0));
      }
    }
    const bool mirrored = root_from_part.linear().determinant() < 0;
    for (unsigned int f = 0; f < part.mNumFaces; ++f) {
      AddTriangle(part, part.mFaces[f], first, mirrored);
    }
  }

  void AddTriangle(const aiMesh& part, const aiFace& face, size_t first, bool mirrored) {
    if (face.mNumIndices != 3) {  // points and lines; polygons were cut by assimp
      return;
    }
    std::array<uint32_t, 3> corners;
    for (size_t k = 0; k < 3; ++k) {
      if (face.mIndices[k] >= part.mNumVertices) {
        throw InputError(path_, fmt::format("triangle {}", mesh_.triangles.size()),
                         fmt::format("expected a vertex index below {}, found {}",
                                     part.mNumVertices, face.mIndices[k]));
      }
      corners[k] = static_cast<uint32_t>(first + face.mIndices[k]);
    }
    if (mirrored) std::swap(corners[1], corners[2]);
    mesh_.triangles.push_back(corners);
    mesh_.triangle_materials.push_back(
        part.mMaterialIndex < scene_.mNumMaterials ? part.mMaterialIndex : RawMesh::kNone);
  }

  const std::filesystem::path& path_;
  const aiScene& scene_;
  const std::optional<GltfScene>& gltf_;
  const Eigen::Affine3d root_from_scene_;
  bool any_colors_ = false;
  bool any_uvs_ = false;
  RawMesh mesh_;
  std::map<std::string, int32_t> texture_by_name_;
};

std::function<bool(const std::filesystem::path&)> survives;

// `read` lets an importer read the scene. `center` is added to all points.
template <typename Read>
RawMesh Converted(const std::filesystem::path& path, const std::optional<GltfScene>& gltf,
                  const Eigen::Vector3d& center, const Read& read) {
  Assimp::Importer importer;
  const aiScene* scene = nullptr;
  try {
    scene = read(importer);
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    throw InputError(path, fmt::format("cannot be read as a mesh: {}", Printable(error.what())));
  }
  if (scene == nullptr) {
    throw InputError(
        path, fmt::format("cannot be read as a mesh: {}", Printable(importer.GetErrorString())));
  }
  return SceneConverter(path, *scene, gltf, center).Convert();
}

}  // namespace

void SetMeshTrial(std::function<bool(const std::filesystem::path&)> trial) {
  survives = std::move(trial);
}

Eigen::Matrix3d ZUpFromYUp() {
  return (Eigen::Matrix3d() << 1, 0, 0, 0, 0, -1, 0, 1, 0).finished();
}

RawMesh ReadGltf(const std::filesystem::path& path, std::string_view contents, GltfPlace place,
                 const Eigen::Matrix3d& z_up_from_gltf) {
  const std::optional<GltfScene> gltf = ReadGltfScene(path, contents, place);
  const Eigen::Vector3d center = z_up_from_gltf.transpose() * gltf->center;
  RawMesh mesh = Converted(path, gltf, center, [&](Assimp::Importer& importer) {
    return place == GltfPlace::kFile
               ? importer.ReadFile(path.string(), kSteps)
               : importer.ReadFileFromMemory(contents.data(), contents.size(), kSteps, "glb");
  });
  for (const std::string& warning : gltf->warnings) {
    mesh.warnings.push_back(fmt::format("{}: {}", path.string(), warning));
  }
  return mesh;
}

RawMesh ReadWithAssimp(const std::filesystem::path& path) {
  RequireRegularFile(path);
  const std::string extension = LowerExtension(path);
  if (extension == ".glb" || extension == ".gltf") {
    return ReadGltf(path, MappedFile(path).contents(), GltfPlace::kFile, ZUpFromYUp());
  }
  if (extension != ".stl" && survives && !survives(path)) {
    throw InputError(path, "cannot be read as a mesh: the file is damaged");
  }
  return Converted(path, std::nullopt, Eigen::Vector3d::Zero(), [&](Assimp::Importer& importer) {
    return importer.ReadFile(path.string(), kSteps);
  });
}

}  // namespace raylift
