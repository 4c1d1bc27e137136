// The contents of a mesh file before it becomes a TriangleMesh: positions in double, texture
// coordinates with indices of their own, materials. The readers fill it; FinishMesh cleans it,
// recenters it and unites positions and attributes to vertices.

#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/image.h"
#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

using Rgb = std::array<uint8_t, 3>;

struct RawMesh {
  static constexpr uint32_t kNone = 0xffffffffu;

  struct Material {
    int32_t texture = -1;                         // index into `textures`, -1 = none
    std::optional<Rgb> color_rgb = std::nullopt;  // what a surface without texture looks like
    std::string name = {};
  };

  std::vector<Eigen::Vector3d> positions;
  std::vector<Rgb> position_colors;                // empty, or one per position
  std::vector<Eigen::Vector3f> position_normals;   // of a point cloud; empty, or one per position
  std::vector<std::array<uint32_t, 3>> triangles;  // indices into `positions`, all in range

  // This is the face of the file that each triangle belongs to; empty while that is its own index.
  std::vector<uint32_t> triangle_faces;

  std::vector<Eigen::Vector2f> uvs;
  // These are the indices into `uvs` (or kNone) of each triangle's corners; empty where `uvs` is
  // empty or per position.
  std::vector<std::array<uint32_t, 3>> triangle_uvs;
  std::vector<uint32_t> triangle_materials;  // empty, or one per triangle; kNone allowed

  std::vector<uint32_t> triangle_parts;  // likewise, indices into `parts`

  std::vector<std::string> parts;  // names of nodes, groups or objects
  std::vector<Material> materials;
  std::vector<Image> textures;
  std::string crs;  // as TriangleMesh has it
  std::vector<std::string> warnings;
};

// Adds the file's face number `face`: triangles are added as they are, larger polygons are cut.
// `corner_uvs` is empty or as long as `corners`; `hole_begins` is as TriangulatePolygon() has it;
// the material is left to the caller. Returns the number of triangles added.
size_t AddFace(size_t face, std::span<const uint32_t> corners, std::span<const uint32_t> corner_uvs,
               RawMesh& mesh, std::span<const uint32_t> hole_begins = {});

// Embree takes no coordinate beyond 1.844e18; nothing that was measured comes near.
inline constexpr double kMaxCoordinate = 1e18;

// Returns whether a position is finite, and within Embree's range.
inline bool IsUsablePosition(const Eigen::Vector3d& p) {
  return std::abs(p.x()) <= kMaxCoordinate && std::abs(p.y()) <= kMaxCoordinate &&
         std::abs(p.z()) <= kMaxCoordinate;
}

// Returns the origin of a mesh in this box: its center, rounded to a multiple of a power of two
// above its extent, so that it is zero for a mesh around the world's origin, and the difference of
// a float coordinate to it is exact.
Eigen::Vector3d ChooseMeshOrigin(const Eigen::Vector3d& low, const Eigen::Vector3d& high);

bool TriangleHasNoArea(const Eigen::Vector3f& a, const Eigen::Vector3f& b,
                       const Eigen::Vector3f& c);

// Throws InputError where so many of the file's triangles have no area that its vertices must have
// been rounded to floats far from the origin: they are floats, whose step there is no small part of
// a common edge of the triangles that are left.
void RefuseCoarseFloats(const std::filesystem::path& path, const TriangleMesh& mesh,
                        size_t without_area, size_t triangles_in_file);

// `path` is for messages only. FinishMeshIfAny returns nullopt where no triangle has finite
// vertices and an area, FinishMesh throws InputError then.
std::optional<TriangleMesh> FinishMeshIfAny(const std::filesystem::path& path, RawMesh raw);
TriangleMesh FinishMesh(const std::filesystem::path& path, RawMesh raw);

// Returns the name of a part below others, with a slash between; of long names the end, as hostile
// files would have them fill the memory.
std::string PartName(std::string_view above, std::string_view name);

// Returns the material of a name, which is added without a color where it is new.
uint32_t MaterialOf(std::string_view name, std::map<std::string, uint32_t, std::less<>>& by_name,
                    RawMesh& mesh);

// Sets the semantics of labels: the numbers of their materials' names.
void NumberMaterials(TriangleMesh& mesh);

// Returns the picture as RGB; nullopt if the bytes are no picture that can be decoded.
std::optional<Image> DecodeTexture(std::string_view bytes);

// Adds a decoded picture to the textures and returns its index; where there is none, returns -1 and
// warns of `what`, as the message calls it.
int32_t AddTexture(const std::filesystem::path& mesh_path, std::string_view what,
                   std::optional<Image> picture, RawMesh& mesh);

// Returns whether a file that the mesh file names may be read, and warns where it may not.
bool IsBelow(const std::filesystem::path& mesh_path, std::string_view what,
             const std::string& named, RawMesh& mesh);

// Adds the picture `name`, as the mesh file calls it (relative to the mesh's folder; Windows
// separators are allowed), to the textures and returns its index. Where it cannot be read, adds a
// warning and returns -1: a mesh is of use without its texture.
int32_t AddTextureFile(const std::filesystem::path& mesh_path, const std::string& name,
                       RawMesh& mesh);

// Cutting ears takes cubic time at worst; a polygon beyond this is no surface that was modeled.
inline constexpr size_t kMaxPolygonCorners = 1000;

// Returns the triangles of a (nearly) plane, simple polygon as indices into `corners`, by cutting
// ears; concave polygons are filled correctly. `hole_begins` are the first corners of its holes,
// wound either way, behind the outer ring. A polygon that is not simple, has a corner that is not
// finite or too many of them becomes a fan of the outer ring, which must have at least three
// corners. There are n - 2 triangles and two more per hole, wound as the outer ring.
std::vector<std::array<uint32_t, 3>> TriangulatePolygon(std::span<const Eigen::Vector3d> corners,
                                                        std::span<const uint32_t> hole_begins = {});

}  // namespace raylift
