// Reads meshes and point clouds, with a reader for each format. `contents` is the whole file;
// `path` is for messages and for files beside it.

#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "surfaces/ply_file.h"
#include "surfaces/raw_mesh.h"
#include <Eigen/Geometry>

#include "raylift/surfaces/mesh_files.h"
#include "raylift/surfaces/point_cloud.h"
#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

// Reads PLY, ASCII and binary of both byte orders; unlike assimp it keeps double coordinates. Reads
// vertices with colors (red, green, blue) and texture coordinates (u v, s t, texture_u texture_v),
// polygon faces with per-corner `texcoord` lists and `texnumber`, pictures from the header's
// `comment TextureFile NAME`; normals (nx ny nz) where there are no faces. Skips other elements and
// properties.
RawMesh ReadPly(const std::filesystem::path& path, const PlyHeader& header,
                std::string_view contents);

// Reads nearly all large meshes fast: binary PLY files of this machine's byte order whose faces are
// triangles, read from the mapped file straight into the mesh, in parallel. Returns what
// FinishMesh(ReadPly(...)) does, but with vertices in the file's order; nullopt if the file needs
// the general reader: another layout, textures, polygons, anything wrong that it will name.
std::optional<TriangleMesh> ReadPlyTriangles(const std::filesystem::path& path,
                                             const PlyHeader& header, std::string_view contents,
                                             int threads);

// Reads Wavefront OBJ with its MTL materials; unlike assimp it keeps double coordinates. Takes v
// (with colors where six numbers are given), vt, f, o, g, usemtl and mtllib; from materials Kd and
// map_Kd.
RawMesh ReadObj(const std::filesystem::path& path);

// Reads every other format through assimp, whose coordinates are float: all meshes of the file's
// node graph, in the root's frame.
RawMesh ReadWithAssimp(const std::filesystem::path& path);

// Says where glTF stands: in a file, which may name others, or as binary glTF within one.
enum class GltfPlace { kFile, kPartOfFile };

// Reads glTF 2, text or binary, in the frame that it states: the meshes of all nodes that are
// shown, with instances (EXT_mesh_gpu_instancing), compressed (Draco, meshoptimizer) and quantized
// ones; the places of nodes stay double. `z_up_from_gltf` is how its axes are turned later, as
// CESIUM_RTC's center is in those. Throws InputError naming the file and the JSON path of what is
// wrong, and where the file requires an extension that is not read. `copies` are the places, in its
// own axes, at which the whole of it stands; if there are none, it stands once as it is.
RawMesh ReadGltf(const std::filesystem::path& path, std::string_view contents, GltfPlace place,
                 const Eigen::Matrix3d& z_up_from_gltf,
                 std::span<const Eigen::Affine3d> copies = {});

// Returns the rotation from glTF's axes, y up and z toward the viewer, to z up.
Eigen::Matrix3d ZUpFromYUp();

// Reads 3D Tiles, the root's JSON: all tiles that show it as one mesh. Throws InputError naming the
// tileset's or the tile's file where one is missing, damaged, or not below the root's folder.
TriangleMesh ReadTileset(const std::filesystem::path& path, const MeshReadOptions& options);

// Read city models (surfaces/city_model.h): CityJSON 1.0 to 2.0 and CityGML 1 and 2. They take the
// level of detail of each object that ChooseLevel() says, without textures; coordinates stay
// double.
RawMesh ReadCityJson(const std::filesystem::path& path, std::string_view contents,
                     std::optional<double> level);
RawMesh ReadCityGml(const std::filesystem::path& path, std::string_view contents,
                    std::optional<double> level);

// Read point clouds, which may hold points that are not finite, and no point at all.
PointCloud ReadLasCloud(const std::filesystem::path& path, std::string_view contents);
PointCloud ReadPcdCloud(const std::filesystem::path& path, std::string_view contents);
PointCloud ReadTextCloud(const std::filesystem::path& path, std::string_view contents);

}  // namespace raylift
