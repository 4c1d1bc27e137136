// Meshes from files: PLY, OBJ, 3D Tiles, CityJSON, CityGML (all read in double), and whatever else
// assimp reads (GLB/glTF, STL, DAE, FBX, ...; in float).

#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/geometry/geodesy.h"
#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

// What is taken of a tileset (3D Tiles), and where it goes.
struct TileOptions {
  // The finest tiles where it is 0, else the coarsest whose geometric error is no more meters.
  double max_error = 0;
  // Where its earth-centered coordinates are led. Without one they become meters east, north and up
  // of the root's center; others stay as they are.
  std::optional<WorldFrame> world = std::nullopt;
};

// Kinds of files that options are for. A file is of one by its name, JSON by what it holds.
enum class MeshKind { kTileset, kCityModel, kOther };
MeshKind MeshKindOf(const std::filesystem::path& file);

// Returns whether a file is of a tileset whose root's center is at the ground of the earth.
bool IsEarthCentered(const std::filesystem::path& file);

// Throws InputError where a file, one of several meshes, is such a tileset and `options` have no
// world: each would be around a center of its own.
void RequireWorld(const std::filesystem::path& file, const TileOptions& options);

struct MeshReadOptions {
  int threads = 0;  // <= 0: all; never changes the mesh
  TileOptions tiles = {};
  // Of city models: the level of detail, "2" meaning the finest that begins so; the finest up to 3
  // where it is not said.
  std::optional<double> level_of_detail = std::nullopt;
};

// Reads a mesh. Faces with more than three corners are triangulated; triangles with a non-finite
// vertex or no area are removed and counted in `warnings`, vertices that no triangle uses are
// dropped. A texture that cannot be read is a warning. InputError naming the file where it is
// missing, unreadable, has an index out of range (naming the face), or has no triangle left (a
// point cloud says so).
TriangleMesh ReadMesh(const std::filesystem::path& path, const MeshReadOptions& options = {});

// Reads a surface model (DSM, DTM): GeoTIFF files of heights on one grid in a projected system, named
// as ListMeshFiles has it, as the triangles between neighboring heights, x and y the system's, z the
// height. Cells without data are holes; where files overlap, the first counts. `orthophotos` of the
// same system, on a grid of their own, are its texture. InputError naming the file where it does not
// say where its pixels lie, is in degrees, not on the grid of the others, or the two lie in
// different places.
TriangleMesh ReadHeightField(const std::string& files,
                             const std::optional<std::string>& orthophotos = std::nullopt);

// The same from memory. Colors are one per vertex, or none at all. InputError where an index is out
// of range, the counts differ, or no triangle is left.
TriangleMesh MakeMesh(std::vector<Eigen::Vector3d> vertices,
                      std::vector<std::array<uint32_t, 3>> triangles,
                      std::vector<std::array<uint8_t, 3>> colors_rgb = {});

// assimp ends the process where a file of some formats (COLLADA, FBX, ...) is damaged. A program
// may therefore let `trial` read such files first, in a process of its own; it returns whether that
// process has lived on. ReadMesh throws InputError where it has not. To be set before meshes are
// read.
void SetMeshTrial(std::function<bool(const std::filesystem::path&)> trial);

// Scenes that come as several meshes: tiles of a city, a building and its furniture.

// The files that "a.ply+b.obj", "tiles/*.ply" or a folder (its tileset.json, else all mesh files in
// it) name, sorted within each part. A file whose own name holds "+" or "*" is that file.
// InputError where a part names no file.
std::vector<std::filesystem::path> ListMeshFiles(const std::string& files);

// Returns whether the extension, in any case, is one of the mesh files in a folder.
bool IsMeshFileName(const std::filesystem::path& file);

// Reads all of them as one mesh. InputError as RequireWorld() throws it, too.
TriangleMesh ReadMeshes(std::span<const std::filesystem::path> files,
                        const MeshReadOptions& options = {});

// One mesh of all of them, recentered. Vertex colors, texture coordinates and textures stay where
// any mesh has them; the others' vertices are white there.
TriangleMesh MergeMeshes(std::vector<TriangleMesh> meshes);

// Binary PLY with the mesh's vertices (float; double where it has an origin of its own), triangles
// and, where it has them, vertex colors. Textures are left out. OutputError where it cannot be
// written.
void WritePly(const std::filesystem::path& path, const TriangleMesh& mesh);

}  // namespace raylift
