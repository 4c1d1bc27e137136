#include <array>
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

class SceneConverter {
 public:
  SceneConverter(const std::filesystem::path& path, const aiScene& scene)
      : path_(path), scene_(scene) {}

  RawMesh Convert() {
    for (unsigned int i = 0; i < scene_.mNumMaterials; ++i) AddMaterial(*scene_.mMaterials[i]);
    for (unsigned int i = 0; i < scene_.mNumMeshes; ++i) {
      any_colors_ |= scene_.mMeshes[i]->HasVertexColors(0);
      any_uvs_ |= scene_.mMeshes[i]->HasTextureCoords(0);
    }
    if (scene_.mRootNode != nullptr) AddNode(*scene_.mRootNode, Eigen::Affine3d::Identity(), "", 0);
    return std::move(mesh_);
  }

 private:
  static Rgb Color(const aiColor4D& color) {
    return {NearestByte(color.r * 255), NearestByte(color.g * 255), NearestByte(color.b * 255)};
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
    added.name = material.GetName().C_Str();
    mesh_.materials.push_back(added);
  }

  int32_t Texture(const std::string& name) {
    const auto [entry, is_new] = texture_by_name_.try_emplace(name, -1);
    if (is_new) {
      const aiTexture* embedded = scene_.GetEmbeddedTexture(name.c_str());
      entry->second =
          embedded != nullptr ? AddEmbedded(*embedded, name) : AddTextureFile(path_, name, mesh_);
    }
    return entry->second;
  }

  int32_t AddEmbedded(const aiTexture& texture, const std::string& name) {
    std::optional<Image> image;
    if (texture.mHeight == 0) {  // a whole file of mWidth bytes
      image = DecodeTexture({reinterpret_cast<const char*>(texture.pcData), texture.mWidth});
    } else {
      image = Image{static_cast<int>(texture.mWidth), static_cast<int>(texture.mHeight), 3, {}};
      const size_t count = size_t{texture.mWidth} * texture.mHeight;
      image->data.reserve(count * 3);
      for (size_t i = 0; i < count; ++i) {
        const aiTexel& texel = texture.pcData[i];
        image->data.insert(image->data.end(), {texel.r, texel.g, texel.b});
      }
    }
    return AddTexture(path_, fmt::format("embedded texture {}", name), std::move(image), mesh_);
  }

  // `above` is the name of its parent (PartName()).
  void AddNode(const aiNode& node, const Eigen::Affine3d& root_from_parent,
               const std::string& above, int depth) {
    if (depth > kMaxNodeNesting) {
      throw InputError(path_, fmt::format("nodes are nested more than {} deep", kMaxNodeNesting));
    }
    const Eigen::Affine3d root_from_node = root_from_parent * ToEigen(node.mTransformation);
    const std::string name = PartName(above, node.mName.C_Str());
    if (node.mNumMeshes > 0) mesh_.parts.push_back(name);
    for (unsigned int i = 0; i < node.mNumMeshes; ++i) {
      AddMesh(*scene_.mMeshes[node.mMeshes[i]], root_from_node);
    }
    for (unsigned int i = 0; i < node.mNumChildren; ++i) {
      AddNode(*node.mChildren[i], root_from_node, name, depth + 1);
    }
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
        const aiVector3D uv = part.HasTextureCoords(0) ? part.mTextureCoords[0][i] : aiVector3D();
        mesh_.uvs.emplace_back(uv.x, uv.y);
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
    mesh_.triangle_parts.push_back(static_cast<uint32_t>(mesh_.parts.size()) - 1);
    mesh_.triangle_materials.push_back(
        part.mMaterialIndex < scene_.mNumMaterials ? part.mMaterialIndex : RawMesh::kNone);
  }

  const std::filesystem::path& path_;
  const aiScene& scene_;
  bool any_colors_ = false;
  bool any_uvs_ = false;
  RawMesh mesh_;
  std::map<std::string, int32_t> texture_by_name_;
};

std::function<bool(const std::filesystem::path&)> survives;

}  // namespace

void SetMeshTrial(std::function<bool(const std::filesystem::path&)> trial) {
  survives = std::move(trial);
}

RawMesh ReadWithAssimp(const std::filesystem::path& path) {
  RequireRegularFile(path);
  if (LowerExtension(path) != ".stl" && survives && !survives(path)) {
    throw InputError(path, "cannot be read as a mesh: the file is damaged");
  }
  Assimp::Importer importer;
  const aiScene* scene = nullptr;
  try {
    scene = importer.ReadFile(path.string(), kSteps);
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    throw InputError(path, fmt::format("cannot be read as a mesh: {}", Printable(error.what())));
  }
  if (scene == nullptr) {
    throw InputError(
        path, fmt::format("cannot be read as a mesh: {}", Printable(importer.GetErrorString())));
  }
  return SceneConverter(path, *scene).Convert();
}

}  // namespace raylift
