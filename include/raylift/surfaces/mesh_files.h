// Reads meshes: PLY, OBJ, 3D Tiles, CityJSON, CityGML (all in double), and whatever else assimp
// reads (GLB/glTF, STL, DAE, FBX, ...; in float).

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

// Options for a tileset (3D Tiles): its level of detail and its frame.
struct TileOptions {
  // With 0 the finest tiles are read, else the coarsest whose geometric error is at most this, in
  // meters.
  double max_error = 0;
  // Its earth-centered coordinates are transformed into this world. With nullopt they become meters
  // east, north and up of the root's center; coordinates that are not earth-centered stay as they
  // are.
  std::optional<WorldFrame> world = std::nullopt;
};

// The kinds of files that have options of their own. The kind follows from a file's name, for JSON
// from its content.
enum class MeshKind { kTileset, kCityModel, kOther };
MeshKind MeshKindOf(const std::filesystem::path& file);

// Returns whether a file is a tileset whose root's center is near the ground of the earth.
bool IsEarthCentered(const std::filesystem::path& file);

// Throws InputError where a file, one of several meshes, is such a tileset and `options` have no
// world: each would be in a frame about its own center.
void RequireWorld(const std::filesystem::path& file, const TileOptions& options);

struct MeshReadOptions {
  int threads = 0;  // <= 0: all; never changes the mesh
  TileOptions tiles = {};
  // This level of detail of city models is read; "2" means the finest that begins with 2. With
  // nullopt the finest up to 3 is read.
  std::optional<double> level_of_detail = std::nullopt;
};

// Reads a mesh. Faces with more than three corners are triangulated; triangles with a non-finite
// vertex or no area are removed and counted in `warnings`, vertices that no triangle uses are
// dropped. A texture that cannot be read is a warning. Throws InputError naming the file where it
// is missing, unreadable, has an index out of range (naming the face), or has no triangle left (a
// point cloud says so).
TriangleMesh ReadMesh(const std::filesystem::path& path, const MeshReadOptions& options = {});

// Reads a surface model (DSM, DTM): GeoTIFF files of heights on one grid in a projected system,
// named as ListMeshFiles() does, as the triangles between neighboring heights; x and y are the
// system's, z is the height. Cells without data are holes; where files overlap, the first counts.
// `orthophotos` of the same system, on a grid of their own, are its texture. Throws InputError
// naming the file where it does not say where its pixels lie, is in degrees, is not on the grid of
// the others, or where heights and orthophotos lie in different places.
TriangleMesh ReadHeightField(const std::string& files,
                             const std::optional<std::string>& orthophotos = std::nullopt);

// Makes a mesh from arrays in memory. Colors are one per vertex, or none at all. Throws InputError
// where an index is out of range, the counts differ, or no triangle is left.
TriangleMesh MakeMesh(std::vector<Eigen::Vector3d> vertices,
                      std::vector<std::array<uint32_t, 3>> triangles,
                      std::vector<std::array<uint8_t, 3>> colors_rgb = {});

// Sets a trial for mesh files. assimp ends the process where a file of some formats (COLLADA, FBX,
// ...) is damaged; a program may therefore let `trial` read such files first, in a process of its
// own, and return whether that process survived. ReadMesh() throws InputError where it did not. To
// be called before meshes are read.
void SetMeshTrial(std::function<bool(const std::filesystem::path&)> trial);

// Reads scenes that come as several meshes: tiles of a city, a building and its furniture.

// Returns the files that "a.ply+b.obj", "tiles/*.ply" or a folder (its tileset.json, else all mesh
// files in it) name, sorted within each part. A file whose own name holds "+" or "*" is that file.
// Throws InputError where a part names no file.
std::vector<std::filesystem::path> ListMeshFiles(const std::string& files);

// Returns whether the extension, in any case, is one of the mesh files in a folder.
bool IsMeshFileName(const std::filesystem::path& file);

// Reads all of them as one mesh. Throws InputError also as RequireWorld() does.
TriangleMesh ReadMeshes(std::span<const std::filesystem::path> files,
                        const MeshReadOptions& options = {});

// Joins meshes into one, recentered. Vertex colors, texture coordinates and textures stay where any
// mesh has them; vertices of the others are white there.
TriangleMesh MergeMeshes(std::vector<TriangleMesh> meshes);

// Writes a binary PLY with the mesh's vertices (float; double where it has an origin of its own),
// triangles and, where it has them, vertex colors. Textures are left out. Throws OutputError where
// it cannot be written.
void WritePly(const std::filesystem::path& path, const TriangleMesh& mesh);

}  // namespace raylift
