// Meshes with their materials and textures.

#include <algorithm>
#include <array>
#include <csignal>

#include "fuzz/fuzz_targets.h"
#include "pictures/codecs.h"
#include <assimp/Exporter.hpp>
#include <assimp/Importer.hpp>
#include <assimp/scene.h>
#include <sys/wait.h>
#include <unistd.h>

#include "raylift/base/error.h"
#include "raylift/io/image_file.h"
#include "raylift/scene/image.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

// What all who use a mesh rely on.
void CheckMesh(const TriangleMesh& mesh) {
  const size_t count = mesh.vertices.size();
  for (const auto& triangle : mesh.triangles) {
    for (const uint32_t corner : triangle) RAYLIFT_CHECK(corner < count);
  }
  for (const Eigen::Vector3f& vertex : mesh.vertices) RAYLIFT_CHECK(vertex.allFinite());
  const auto is_all_or_none = [](size_t size, size_t all) { return size == 0 || size == all; };
  RAYLIFT_CHECK(is_all_or_none(mesh.vertex_colors_rgb.size(), count));
  RAYLIFT_CHECK(is_all_or_none(mesh.texture_coordinates.size(), count));
  RAYLIFT_CHECK(is_all_or_none(mesh.triangle_textures.size(), mesh.triangles.size()));
  for (const int32_t texture : mesh.triangle_textures) {
    RAYLIFT_CHECK(texture < static_cast<int32_t>(mesh.textures.size()));
  }
}

template <size_t N>
void ReadSurfaceAs(const char (&name)[N], std::string_view bytes) {
  CheckMesh(ReadMesh(PutFile(name, bytes), {.threads = 1}));
}

template <typename... Values>
std::string Bytes(const Values&... values) {
  std::string bytes;
  (bytes.append(reinterpret_cast<const char*>(&values), sizeof(values)), ...);
  return bytes;
}

std::string PicturePng() {
  const auto file = ScratchFolder() / "seed.png";
  WriteImage(file, Image{2, 2, 3, std::vector<uint8_t>(12, 100)});
  return TakeFile(file);
}

constexpr std::string_view kPlyVertices = "property float x\nproperty float y\nproperty float z\n";

std::vector<std::string> PlySeeds() {
  const std::string counts(kPlyVertices);
  return {
      "ply\nformat ascii 1.0\ncomment TextureFile t.png\nelement vertex 4\n" + counts +
          "property uchar red\nproperty uchar green\nproperty uchar blue\n"
          "element face 1\nproperty list uchar int vertex_indices\n"
          "property list uchar float texcoord\nend_header\n"
          "0 0 0 1 2 3\n1 0 0 4 5 6\n1 1 0 7 8 9\n0 1 0 1 1 1\n4 0 1 2 3 8 0 0 1 0 1 1 0 1\n",
      "ply\nformat binary_little_endian 1.0\nelement vertex 3\n" + counts +
          "element face 1\nproperty list uchar int vertex_indices\nend_header\n" +
          Bytes(0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 1.f, 0.f, uint8_t{3}, 0, 1, 2),
  };
}

// Two triangles.
std::string StlSeed() {
  const uint16_t attribute = 0;
  const std::string first = Bytes(0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 1.f, 0.f);
  const std::string second = Bytes(0.f, 0.f, 1.f, 1.f, 1.f, 0.f, 1.f, 0.f, 0.f, 0.f, 1.f, 1.f);
  return std::string(80, ' ') + Bytes(uint32_t{2}) + first + Bytes(attribute) + second +
         Bytes(attribute);
}

constexpr std::string_view kAsciiStl =
    "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
    "endloop\nendfacet\nendsolid s\n";

// A triangle; its positions are `buffer`, a member of JSON.
std::string GltfText(const std::string& buffer) {
  return R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],)"
         R"("meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],)"
         R"("accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3",)"
         R"("min":[0,0,0],"max":[1,1,0]}],"bufferViews":[{"buffer":0,"byteLength":36}],)"
         R"("buffers":[{"byteLength":36)" +
         buffer + "}]}";
}

std::vector<std::string> GltfSeeds() {
  return {
      GltfText(",\"uri\":\"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAA"
               "AAAAAAgD8AAAAA\"")};
}

std::vector<std::string> GlbSeeds() {
  std::string json = GltfText("");
  json.resize((json.size() + 3) / 4 * 4, ' ');
  const std::string data = Bytes(0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f, 1.f, 0.f);
  const auto size = [](const std::string& text) { return static_cast<uint32_t>(text.size()); };
  return {"glTF" + Bytes(uint32_t{2}, 28 + size(json) + size(data), size(json)) + "JSON" + json +
          Bytes(size(data)) + std::string("BIN\0", 4) + data};
}

// By assimp's exporter of that name.
std::vector<std::string> AssimpSeeds(const char* format) {
  const std::string off = "OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 2 3\n";
  Assimp::Importer importer;
  const aiScene* scene = importer.ReadFileFromMemory(off.data(), off.size(), 0, "off");
  RAYLIFT_CHECK(scene != nullptr);
  Assimp::Exporter exporter;
  const aiExportDataBlob* blob = exporter.ExportToBlob(scene, format);
  RAYLIFT_CHECK(blob != nullptr);
  return {std::string(static_cast<const char*>(blob->data), blob->size)};
}

constexpr auto kObjFiles = std::to_array<std::string_view>({"mesh.obj", "mesh.mtl", "t.png"});

void ReadObjFolder(std::string_view bytes) {
  CheckMesh(ReadMesh(SplitFiles(bytes, "obj", kObjFiles) / "mesh.obj", {.threads = 1}));
}

std::vector<std::string> ObjSeeds() {
  PutFile("obj_seed/mesh.obj",
          "mtllib mesh.mtl\nv 0 0 0\nv 1 0 0 1 0.5 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 1\n"
          "usemtl a\nf 1/1 2/2 3/1 -1/2\nusemtl b\nf 1//1 2//1 3//1\n");
  PutFile("obj_seed/mesh.mtl", "newmtl a\nKd 1 0 0\nmap_Kd -s 1 1 1 t.png\nnewmtl b\nKd 0 1 0\n");
  PutFile("obj_seed/t.png", PicturePng());
  return {JoinFiles(ScratchFolder() / "obj_seed", kObjFiles)};
}

constexpr auto kHeightFieldFiles = std::to_array<std::string_view>({"dsm.tif", "dsm.tfw"});

void ReadHeightFieldFolder(std::string_view bytes) {
  CheckMesh(ReadHeightField(SplitFiles(bytes, "dsm", kHeightFieldFiles) / "dsm.tif"));
}

std::vector<std::string> HeightFieldSeeds() {
  const std::vector<float> heights = {1, 2, 3, 4, -9999, 6};
  PutFile("dsm_seed/dsm.tif", EncodeTiffPlane({3, 2}, heights));
  PutFile("dsm_seed/dsm.tfw", "0.5\n0\n0\n-0.5\n400000.25\n5000000\n");
  return {JoinFiles(ScratchFolder() / "dsm_seed", kHeightFieldFiles)};
}

constexpr auto kTilesetFiles =
    std::to_array<std::string_view>({"tileset.json", "tile.b3dm", "inner.json", "tree.subtree"});

void ReadTilesetFolder(std::string_view bytes) {
  MeshReadOptions options;
  options.threads = 1;
  CheckMesh(ReadMesh(SplitFiles(bytes, "tiles", kTilesetFiles) / "tileset.json", options));
}

// An explicit tile, and implicit ones of all three kinds of content.
std::vector<std::string> TilesetSeeds() {
  const std::string glb = GlbSeeds()[0];
  const std::string features = R"({"BATCH_LENGTH":0,"RTC_CENTER":[1,2,3]} )";
  const auto size = [](size_t bytes) { return static_cast<uint32_t>(bytes); };
  const std::string b3dm = "b3dm" +
                           Bytes(uint32_t{1}, size(28 + features.size() + glb.size()),
                                 size(features.size()), uint32_t{0}, uint32_t{0}, uint32_t{0}) +
                           features + glb;
  const std::string rest = Bytes(uint32_t{2}) + b3dm + glb;
  const std::string tiles = "cmpt" + Bytes(uint32_t{1}, size(12 + rest.size())) + rest;
  const std::string begin =
      R"({"asset":{"version":"1.1"},"root":{"boundingVolume":{"sphere":[0,0,0,9]},)"
      R"("geometricError":8,"refine":"ADD",)";
  PutFile("tiles_seed/tileset.json",
          begin + R"("transform":[1,0,0,0,0,1,0,0,0,0,1,0,9,9,9,1],"content":{"uri":"tile.b3dm"},)"
                  R"("children":[{"boundingVolume":{"box":[0,0,0,1,0,0,0,1,0,0,0,1]},)"
                  R"("geometricError":0,"content":{"uri":"inner.json"}}]}})");
  PutFile("tiles_seed/tile.b3dm", tiles);
  PutFile("tiles_seed/inner.json",
          begin + R"("content":{"uri":"tile.b3dm"},"implicitTiling":{"subdivisionScheme":)"
                  R"("QUADTREE","subtreeLevels":2,"availableLevels":2,)"
                  R"("subtrees":{"uri":"tree.subtree"}}}})");
  const std::string json =
      R"({"buffers":[{"byteLength":1}],"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":1}],)"
      R"("tileAvailability":{"constant":1},"contentAvailability":[{"bitstream":0}],)"
      R"("childSubtreeAvailability":{"constant":0}})";
  PutFile("tiles_seed/tree.subtree",
          "subt" + Bytes(uint32_t{1}, uint64_t{json.size()}) + Bytes(uint64_t{1}) + json + '\x15');
  return {JoinFiles(ScratchFolder() / "tiles_seed", kTilesetFiles)};
}

std::vector<std::string> CityJsonSeeds() {
  return {R"({"type":"CityJSON","version":"2.0","transform":{"scale":[0.01,0.01,0.01],)"
          R"("translate":[500000,5900000,0]},"metadata":{"referenceSystem":"EPSG:25832"},)"
          R"("CityObjects":{"a":{"type":"Building","children":["b"],"geometry":[{"type":"Solid",)"
          R"("lod":"2.2","boundaries":[[[[0,1,2,3],[4,5,6]]]]}]},"b":{"type":"Plant","geometry":[)"
          R"({"type":"GeometryInstance","template":0,"boundaries":[2],"transformationMatrix":)"
          R"([2,0,0,0,0,2,0,0,0,0,2,5,0,0,0,1]}]}},"geometry-templates":{"templates":[{"type":)"
          R"("MultiSurface","lod":"2","boundaries":[[[0,1,2]]]}],"vertices-templates":[[0,0,0],)"
          R"([1,0,0],[0,1,0]]},"vertices":[[0,0,0],[900,0,0],[900,900,0],[0,900,0],[100,100,0],)"
          R"([100,200,0],[200,100,0]]})"};
}

std::vector<std::string> CityGmlSeeds() {
  return {
      "<CityModel><boundedBy><Envelope srsName=\"EPSG:25832\"/></boundedBy><cityObjectMember>"
      "<Building gml:id=\"b\"><lod2Solid><Solid><exterior><CompositeSurface><surfaceMember "
      "xlink:href=\"#p\"/></CompositeSurface></exterior></Solid></lod2Solid><boundedBy><Roof>"
      "<lod2MultiSurface><MultiSurface><surfaceMember><Polygon gml:id=\"p\"><exterior><LinearRing>"
      "<posList>500000 5900000 1 500009 5900000 1 500009 5900009 1 500000 5900009 1 500000 5900000 "
      "1</posList></LinearRing></exterior><interior><LinearRing><pos>500001 5900001 1</pos><pos>"
      "500001 5900002 1</pos><pos>500002 5900001 1</pos></LinearRing></interior></Polygon>"
      "</surfaceMember></MultiSurface></lod2MultiSurface></Roof></"
      "boundedBy><consistsOfBuildingPart>"
      "<BuildingPart/></consistsOfBuildingPart></Building></cityObjectMember></CityModel>"};
}

// As the program does it, but that the process that tries the file is a copy of this one.
bool SurvivesInChild(const std::filesystem::path& file) {
  const pid_t child = fork();
  if (child == 0) {
    for (const int number : {SIGABRT, SIGBUS, SIGFPE, SIGILL, SIGSEGV}) signal(number, SIG_DFL);
    SetMeshTrial(nullptr);
    try {
      ReadMesh(file, {.threads = 1});
    } catch (const std::exception&) {  // is told by the process that goes on
    }
    _exit(0);
  }
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status);
}

}  // namespace

std::vector<FuzzTarget> MeshFuzzTargets() {
  SetMeshTrial(&SurvivesInChild);
  return {
      {"mesh_ply", [](std::string_view bytes) { ReadSurfaceAs("mesh.ply", bytes); }, PlySeeds,
       "ply format ascii binary_little_endian binary_big_endian element vertex face property list "
       "uchar char short ushort int uint float double vertex_indices texcoord texnumber red green "
       "blue nx ny nz u v end_header comment TextureFile obj_info 18446744073709551615 nan 1e308 "
       "4294967295"},
      {"mesh_obj", ReadObjFolder, ObjSeeds,
       "=FILE= v vt vn f usemtl mtllib newmtl Kd map_Kd -1 / // nan 1e308 2147483648"},
      {"mesh_stl", [](std::string_view bytes) { ReadSurfaceAs("mesh.stl", bytes); },
       [] {
         return std::vector<std::string>{StlSeed(), std::string(kAsciiStl)};
       },
       "solid facet normal outer loop vertex endloop endfacet endsolid nan 1e308"},
      {"mesh_gltf", [](std::string_view bytes) { ReadSurfaceAs("mesh.gltf", bytes); }, GltfSeeds,
       "\"nodes\" \"children\" \"mesh\" \"accessors\" \"bufferView\" \"byteOffset\" \"byteStride\" "
       "\"count\" \"indices\" \"sparse\" \"TEXCOORD_0\" \"COLOR_0\" \"materials\" \"textures\" "
       "\"images\" \"skin\" \"matrix\" -1 4294967295 5121 5123 5125 VEC4 MAT4 SCALAR"},
      {"mesh_glb", [](std::string_view bytes) { ReadSurfaceAs("mesh.glb", bytes); }, GlbSeeds,
       "glTF JSON BIN \"nodes\" \"children\" \"byteOffset\" \"byteStride\" \"sparse\" \"indices\" "
       "-1 4294967295"},
      {"mesh_dae", [](std::string_view bytes) { ReadSurfaceAs("mesh.dae", bytes); },
       [] { return AssimpSeeds("collada"); },
       "<node> <instance_geometry url=\"# <source <float_array count= <accessor stride= offset= "
       "<triangles <polylist <vcount> <p> <input semantic= <matrix> <controller <skin 4294967295 "
       "-1"},
      {"mesh_fbx", [](std::string_view bytes) { ReadSurfaceAs("mesh.fbx", bytes); },
       [] { return AssimpSeeds("fbxa"); },
       "Vertices: PolygonVertexIndex: Connections: C: Objects: Geometry: Model: *4294967295 -1 a:"},
      {"mesh_tiles", ReadTilesetFolder, TilesetSeeds,
       "=FILE= b3dm cmpt i3dm subt glTF \"children\" \"contents\" \"uri\" \"transform\" \"refine\" "
       "\"region\" \"box\" \"constant\" \"bitstream\" \"bufferView\" \"implicitTiling\" OCTREE "
       "{level} {x} {y} inner.json ../ http:// 4294967295 -1 1e308"},
      {"mesh_city_json", [](std::string_view bytes) { ReadSurfaceAs("mesh.city.json", bytes); },
       CityJsonSeeds,
       "\"lod\" \"children\" \"template\" \"boundaries\" \"MultiSolid\" \"CompositeSurface\" "
       "\"GeometryInstance\" \"referenceSystem\" -1 4294967295 1e308 [[ ]]"},
      {"mesh_city_gml", [](std::string_view bytes) { ReadSurfaceAs("mesh.gml", bytes); },
       CityGmlSeeds,
       "<OrientableSurface orientation=\"-\"> <tin> <Triangle> <coordinates> lod1Solid "
       "lod3Geometry "
       "xlink:href=\"#b\" srsDimension=\"2\" <interiorRoom> <!DOCTYPE <![CDATA[ nan 1e308"},
      {"mesh_dsm", ReadHeightFieldFolder, HeightFieldSeeds, "=FILE= II* MM II+ -9999 nan 1e308"},
  };
}

}  // namespace raylift
