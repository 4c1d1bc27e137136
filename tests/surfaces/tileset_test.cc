// ReadMesh on 3D Tiles.

#include <algorithm>
#include <array>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "mesh_files.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include "tileset_files.h"
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include "raylift/base/file.h"
#include "raylift/geometry/geodesy.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

using Eigen::Affine3d;
using Eigen::Vector3d;
using std::filesystem::path;

constexpr const char* kSphere = R"("boundingVolume":{"sphere":[0,0,0,100]},"geometricError":)";

std::string TilesetJson(const std::string& root) {
  return R"({"asset":{"version":"1.1"},"geometricError":500,"root":{)" + root + "}}";
}

// A tileset of one tile in a folder.
path WriteTileset(const std::string& root) {
  const path file = TestFolder() / "tileset.json";
  WriteFile(file, TilesetJson(root));
  return file;
}

// East, north and up at a point near Hamburg to earth-centered coordinates.
Affine3d EarthFromLocal() {
  const Vector3d place = CrsTransform(Crs("EPSG:4979"), Crs("EPSG:4978"))({9.9, 53.55, 52.25});
  Affine3d earth_from_local = Affine3d::Identity();
  earth_from_local.linear() = LocalFrameAt(Crs("EPSG:4978"), place).Axes();
  earth_from_local.translation() = place;
  return earth_from_local;
}

TriangleMesh MeshOf(const TilePatch& patch) {
  std::vector<Vector3d> vertices;
  for (const Eigen::Vector3f& vertex : patch.vertices) vertices.push_back(vertex.cast<double>());
  return MakeMesh(std::move(vertices), patch.triangles);
}

// The largest difference of two meshes' depth in a view from above, at an angle.
double MaxDepthDifference(TriangleMesh mesh, TriangleMesh expected) {
  const Camera camera(CameraModel::kPinhole, 320, 240, std::vector<double>{250, 250, 160, 120});
  const Eigen::Quaterniond down(Eigen::AngleAxisd(2.6, Vector3d(1, 0.2, 0.1).normalized()));
  const Rigid3 view{down, Vector3d(1, 2, 30)};
  std::array<DepthMap, 2> maps;
  for (TriangleMesh* each : {&mesh, &expected}) {
    const RayCaster caster(std::make_shared<const TriangleMesh>(std::move(*each)));
    maps[each == &mesh ? 0 : 1] = RenderDepth(caster, camera, view, 1);
  }
  double largest = 0;
  size_t num_seen = 0;
  for (size_t i = 0; i < maps[0].z.size(); ++i) {
    if ((maps[0].z[i] == 0) != (maps[1].z[i] == 0)) continue;  // at its border
    largest = std::max(largest, std::abs(double{maps[0].z[i]} - double{maps[1].z[i]}));
    num_seen += maps[0].z[i] > 0 ? 1 : 0;
  }
  EXPECT_GT(num_seen, maps[0].z.size() / 2);
  return largest;
}

// The issue's bar is 1 mm at 6.4e6 m from the earth's center.
constexpr double kMillimeter = 1e-3;

TEST(ReadTileset, AnEarthCenteredTransformIsTakenInDouble) {
  const TilePatch hills = HillPatch({0, 0});
  const Vector3d center(512, -256, 16);
  const Affine3d root = EarthFromLocal() * Eigen::Translation3d(-center);
  const path file = WriteTileset(fmt::format(
      R"("transform":{},"boundingVolume":{{"box":[512,-256,16,20,0,0,0,20,0,0,0,5]}},
"geometricError":0,"refine":"ADD","content":{{"uri":"a%20b.b3dm"}})",
      ColumnsOf(root)));
  WriteFile(file.parent_path() / "a b.b3dm", B3dm(TileGlb(hills), center));
  const TriangleMesh mesh = ReadMesh(file);
  ASSERT_EQ(mesh.warnings.size(), 1u);
  EXPECT_NE(mesh.warnings[0].find("east, north and up of 9.900000000 53.550000000 52.2500"),
            std::string::npos)
      << mesh.warnings[0];
  EXPECT_LT(MaxDepthDifference(mesh, MeshOf(hills)), kMillimeter);
  EXPECT_LT(MaxCornerDistance(mesh, Corners(MeshOf(hills))), 1e-5);
}

// Of all ways to say where a tile is: the axes are the earth's, so that the mesh is turned.
TEST(ReadTileset, CentersAndNodesFarAwayAreTakenInDouble) {
  const Affine3d earth_from_local = EarthFromLocal();
  const Vector3d place = earth_from_local.translation();
  const TilePatch hills = HillPatch({0, 0});
  TilePatch turned = hills;
  for (Eigen::Vector3f& vertex : turned.vertices) {
    vertex = (earth_from_local.linear() * vertex.cast<double>()).cast<float>();
  }
  const auto numbers = [](double x, double y, double z) {
    return fmt::format("[{:.17g},{:.17g},{:.17g}]", x, y, z);
  };
  const std::string in_node =
      fmt::format(R"(,"translation":{})", numbers(place.x(), place.z(), -place.y()));
  const std::string in_extension = fmt::format(
      R"(,"extensionsRequired":["CESIUM_RTC"],"extensions":{{"CESIUM_RTC":{{"center":{}}}}})",
      numbers(place.x(), place.y(), place.z()));
  const path file = WriteTileset(fmt::format(
      R"("boundingVolume":{{"sphere":[{:.17g},{:.17g},{:.17g},30]}},"geometricError":0,
"refine":"REPLACE","content":{{"uri":"tile"}})",
      place.x(), place.y(), place.z()));
  for (const std::string& tile : {B3dm(TileGlb(turned), place), TileGlb(turned, in_node),
                                  TileGlb(turned, "", in_extension)}) {
    WriteFile(file.parent_path() / "tile", tile);
    // Turned vertices are floats at 30 m: 2e-6 m.
    EXPECT_LT(MaxCornerDistance(ReadMesh(file), Corners(MeshOf(hills))), 1e-5);
    EXPECT_LT(MaxDepthDifference(ReadMesh(file), MeshOf(hills)), kMillimeter);
  }
}

TEST(ReadTileset, ItsCoordinatesAreLedToTheSystemThatIsAskedFor) {
  const Affine3d earth_from_local = EarthFromLocal();
  const TilePatch hills = HillPatch({0, 0});
  const path file = WriteTileset(
      fmt::format(R"("transform":{},{}0,"refine":"ADD","content":{{"uri":"tile.glb"}})",
                  ColumnsOf(earth_from_local), kSphere));
  WriteFile(file.parent_path() / "tile.glb", TileGlb(hills));
  const Vector3d origin(559000, 5934000, 50);
  std::vector<Vector3d> on_map = Corners(MeshOf(hills)), on_earth = on_map;
  const CrsTransform transform(Crs("EPSG:4978"), Crs("EPSG:25832"));
  for (Vector3d& corner : on_earth) corner = earth_from_local * corner;
  for (size_t i = 0; i < on_map.size(); ++i) on_map[i] = transform(on_earth[i]) - origin;
  MeshReadOptions options;
  options.tiles.world = WorldFrame::Parse("EPSG:25832@559000,5934000,50");
  EXPECT_LT(MaxCornerDistance(ReadMesh(file, options), on_map), 1e-4);  // floats at 1 km
  options.tiles.world = WorldFrame::Parse("EPSG:4978");
  EXPECT_LT(MaxCornerDistance(ReadMesh(file, options), on_earth), 1e-5);
}

// A tile of instances. `gltf_format`: 1, glTF follows; 0, the name of its file.
std::string I3dm(std::string features, std::string binary, const std::string& gltf,
                 uint32_t gltf_format = 1) {
  while ((32 + features.size()) % 8 != 0) features += ' ';
  while (binary.size() % 8 != 0) binary += '\0';
  std::string rest;
  for (const size_t size : {features.size(), binary.size(), size_t{0}, size_t{0}}) {
    AppendBytes(rest, static_cast<uint32_t>(size));
  }
  AppendBytes(rest, gltf_format);
  return Tile("i3dm", rest + features + binary + gltf);
}

template <typename T>
std::string BytesOf(const std::vector<T>& numbers) {
  std::string bytes;
  for (const T number : numbers) AppendBytes(bytes, number);
  return bytes;
}

// What each way of saying it makes of the corners of the instances' mesh.
TEST(ReadTileset, InstancesStandWhereTheTileSays) {
  const TilePatch hills = HillPatch({0, 0});
  const std::vector<Vector3d> corners = Corners(MeshOf(hills));
  const path file =
      WriteTileset(kSphere + std::string(R"(0,"refine":"ADD","content":{"uri":"tile.i3dm"})"));
  const auto expect = [&](const std::string& tile, const std::vector<Affine3d>& places,
                          double tolerance) {
    WriteFile(file.parent_path() / "tile.i3dm", tile);
    std::vector<Vector3d> expected;
    for (const Affine3d& place : places) {
      for (const Vector3d& corner : corners) expected.push_back(place * corner);
    }
    EXPECT_LT(MaxCornerDistance(ReadMesh(file), expected), tolerance) << tile.substr(0, 300);
  };
  const auto at = [](double x, double y, double z) {
    return Affine3d(Eigen::Translation3d(x, y, z));
  };
  const std::string places = BytesOf<float>({100, 0, 5, 0, 300, 0});
  const std::string scaled =
      R"({"INSTANCES_LENGTH":2,"RTC_CENTER":[7,8,9],"POSITION":{"byteOffset":0},"SCALE":{"byteOffset":24}})";
  const std::vector<Affine3d> twice = {at(107, 8, 14) * Eigen::Scaling(2.0),
                                       at(7, 308, 9) * Eigen::Scaling(0.5)};
  expect(I3dm(scaled, places + BytesOf<float>({2, 0.5}), TileGlb(hills)), twice, 1e-4);
  WriteFile(file.parent_path() / "a tree.glb", TileGlb(hills));
  for (const std::string name : {"a%20tree.glb", "a tree.glb?v=1  "}) {
    expect(I3dm(scaled, places + BytesOf<float>({2, 0.5}), name, 0), twice, 1e-4);
  }

  // Up is where y goes, right is where x goes.
  Affine3d turned = at(100, 0, 5);
  turned.linear() << 0, 0, 1, 1, 0, 0, 0, 1, 0;
  expect(I3dm(R"({"INSTANCES_LENGTH":1,"POSITION":{"byteOffset":0},"NORMAL_UP":{"byteOffset":12},
"NORMAL_RIGHT":{"byteOffset":24}})",
              BytesOf<float>({100, 0, 5, 0, 0, 1, 0, 1, 0}), TileGlb(hills)),
         {turned}, 1e-4);
  // An octahedron's corners: up is at the middle of the square, right at the end of its y.
  expect(I3dm(R"({"INSTANCES_LENGTH":1,"POSITION_QUANTIZED":{"byteOffset":0},
"QUANTIZED_VOLUME_OFFSET":[50,0,5],"QUANTIZED_VOLUME_SCALE":[100,1,1],
"NORMAL_UP_OCT32P":{"byteOffset":8},"NORMAL_RIGHT_OCT32P":{"byteOffset":12}})",
              BytesOf<uint16_t>({32768, 0, 0, 0, 32768, 32768, 32768, 65535}), TileGlb(hills)),
         {turned}, 5e-3);

  // On the equator, where the meridian of 90 degrees meets it: east is -x, up is y.
  Affine3d on_earth = at(0, 6378137, 0);
  on_earth.linear() << -1, 0, 0, 0, 0, 1, 0, 1, 0;
  WriteTileset(kSphere + std::string(R"(0,"refine":"ADD","content":{"uri":"tile.i3dm"})"));
  expect(I3dm(R"({"INSTANCES_LENGTH":1,"EAST_NORTH_UP":true,"POSITION":{"byteOffset":0}})",
              BytesOf<float>({0, 6378137, 0}), TileGlb(hills)),
         {on_earth}, 1e-3);
}

TEST(ReadTileset, InstancesOfManyMeshesHaveAnEnd) {
  constexpr size_t kEach = 2100;  // 4.4 million of both
  std::string nodes;
  std::vector<size_t> all(kEach);
  for (size_t i = 0; i < kEach; ++i) {
    nodes += R"({"mesh":0},)";
    all[i] = i;
  }
  nodes.pop_back();
  const std::string glb =
      GlbOf(fmt::format(
                R"({{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[{}]}}],"nodes":[{}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],"buffers":[{{"byteLength":36}}],
"bufferViews":[{{"buffer":0,"byteLength":36}}],
"accessors":[{{"bufferView":0,"componentType":5126,"type":"VEC3","count":3}}]}})",
                fmt::join(all, ","), nodes),
            BytesOf<float>({0, 0, 0, 1, 0, 0, 0, 1, 0}));
  const path file =
      WriteTileset(kSphere + std::string(R"(0,"refine":"ADD","content":{"uri":"tile.i3dm"})"));
  WriteFile(file.parent_path() / "tile.i3dm",
            I3dm(fmt::format(R"({{"INSTANCES_LENGTH":{},"POSITION":{{"byteOffset":0}}}})", kEach),
                 BytesOf(std::vector<float>(3 * kEach, 0)), glb));
  EXPECT_TRUE(FailsWithInputError([&] { ReadMesh(file); },
                                  {"tile.i3dm", "place more than 4194304 meshes"}));
}

TEST(ReadTileset, ALocalOneStaysAsItIs) {
  const TilePatch hills = HillPatch({0, 0});
  const path file =
      WriteTileset(kSphere + std::string(R"(0,"refine":"ADD","content":{"url":"tile.cmpt"})"));
  WriteFile(file.parent_path() / "tile.cmpt",
            Cmpt({B3dm(TileGlb(hills)), Tile("pnts", "1234"), Cmpt({TileGlb(hills)})}));
  const TriangleMesh mesh = ReadMesh(file);
  EXPECT_EQ(mesh.triangles.size(), 2 * hills.triangles.size());
  EXPECT_EQ(mesh.warnings.size(), 1u);  // of the points
  std::vector<Vector3d> twice = Corners(MeshOf(hills));
  twice.insert(twice.end(), twice.begin(),
               twice.begin() + static_cast<std::ptrdiff_t>(twice.size()));
  EXPECT_LT(MaxCornerDistance(mesh, twice), 1e-6);
  MeshReadOptions options;
  options.tiles.world = WorldFrame::Parse("EPSG:25832");
  EXPECT_TRUE(FailsWithInputError([&] { ReadMesh(file, options); },
                                  {"tileset.json", "root.boundingVolume", "earth-centered"}));
}

// A root of 1 triangle, children of 2 and 4, a grandchild of 8: which are shown is their sum.
size_t TrianglesShown(const std::string& root_refine, const std::string& child_refine,
                      double max_error) {
  const std::string leaf = std::string("{") + kSphere + R"(0,"content":{"uri":"8.glb"}})";
  const std::string children = fmt::format(
      R"([{{{0}10,"refine":"{1}","content":{{"uri":"2.glb"}},"children":[{2}]}},
{{{0}0,"contents":[{{"uri":"4.glb"}}]}}])",
      kSphere, child_refine, leaf);
  const path file =
      WriteTileset(fmt::format(R"({}100,"refine":"{}","content":{{"uri":"1.glb"}},"children":{})",
                               kSphere, root_refine, children));
  for (const size_t count : {1, 2, 4, 8}) {
    TilePatch patch = HillPatch({0, 0});
    patch.triangles.resize(count);
    WriteFile(file.parent_path() / fmt::format("{}.glb", count), TileGlb(patch));
  }
  MeshReadOptions options;
  options.tiles.max_error = max_error;
  return ReadMesh(file, options).triangles.size();
}

TEST(ReadTileset, TheFinestTilesAreShownOrThoseThatAreFineEnough) {
  EXPECT_EQ(TrianglesShown("REPLACE", "REPLACE", 0), 8u + 4);
  EXPECT_EQ(TrianglesShown("ADD", "REPLACE", 0), 1u + 8 + 4);
  EXPECT_EQ(TrianglesShown("REPLACE", "ADD", 0), 2u + 8 + 4);
  EXPECT_EQ(TrianglesShown("ADD", "ADD", 0), 15u);
  EXPECT_EQ(TrianglesShown("REPLACE", "REPLACE", 9), 8u + 4);
  EXPECT_EQ(TrianglesShown("REPLACE", "REPLACE", 10), 2u + 4);
  EXPECT_EQ(TrianglesShown("ADD", "ADD", 10), 1u + 2 + 4);
  EXPECT_EQ(TrianglesShown("REPLACE", "ADD", 100), 1u);
}

TEST(ReadTileset, TilesetsInFoldersOfTheirOwnStandUnderTheTransformOfTheirTile) {
  const TilePatch hills = HillPatch({0, 0});
  const Affine3d moved(Eigen::Translation3d(1, 2, 3));
  const path file = WriteTileset(fmt::format(
      R"({0}9,"refine":"REPLACE","transform":{1},"children":[{{{0}5,"content":{{"uri":"inner/tiles.json"}}}}])",
      kSphere, ColumnsOf(moved)));
  WriteFile(file.parent_path() / "inner/tiles.json",
            TilesetJson(fmt::format(
                R"({}0,"transform":{},"refine":"ADD","content":{{"uri":"../tile.glb?v=1"}})",
                kSphere, ColumnsOf(Affine3d(Eigen::Scaling(2.0))))));
  WriteFile(file.parent_path() / "tile.glb", TileGlb(hills));
  std::vector<Vector3d> expected = Corners(MeshOf(hills));
  for (Vector3d& corner : expected) corner = 2 * corner + Vector3d(1, 2, 3);
  EXPECT_LT(MaxCornerDistance(ReadMesh(file), expected), 1e-5);
}

// A quadtree of three levels in subtrees of two: of the root, the tile (1, 0) of level 1, and below
// it all four of level 2. Tiles have as many triangles as their names say.
TEST(ReadTileset, ImplicitTilesAreThoseOfTheBits) {
  const path file = WriteTileset(
      kSphere +
      std::string(R"(16,"refine":"ADD","content":{"uri":"{level}/{x}_{y}.glb"},"implicitTiling":
{"subdivisionScheme":"QUADTREE","subtreeLevels":2,"availableLevels":3,"subtrees":{"uri":"s/{level}.{x}.{y}.subtree"}})"));
  const path folder = file.parent_path();
  // Tiles 0 and 2 of five, contents of the same, subtrees 4 to 7 of sixteen; the bits are separate.
  std::string json =
      R"({"buffers":[{"byteLength":8},{"uri":"bits.bin","byteLength":2}],"bufferViews":[
{"buffer":0,"byteOffset":0,"byteLength":1},{"buffer":1,"byteOffset":0,"byteLength":2}],
"tileAvailability":{"bitstream":0},"contentAvailability":[{"bitstream":0}],"childSubtreeAvailability":{"bitstream":1}})";
  while (json.size() % 8 != 0) json += ' ';
  std::string subtree = "subt";
  AppendBytes(subtree, uint32_t{1});
  AppendBytes(subtree, uint64_t{json.size()});
  AppendBytes(subtree, uint64_t{8});
  WriteFile(folder / "s/0.0.0.subtree", subtree + json + '\5' + std::string(7, '\0'));
  WriteFile(folder / "s/bits.bin", std::string("\xf0\0", 2));
  const std::string leaf =
      R"({"tileAvailability":{"bitstream":0},"contentAvailability":[{"bitstream":0}],
"childSubtreeAvailability":{"constant":0},"buffers":[{"uri":"leaf.bin","byteLength":1}],
"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":1}]})";
  WriteFile(folder / "s/leaf.bin", "\1");
  size_t count = 1, sum = 0;
  const auto write = [&](const std::string& name) {
    TilePatch patch = HillPatch({0, 0});
    patch.triangles.resize(count);
    sum += count;
    count *= 2;
    WriteFile(folder / name, TileGlb(patch));
  };
  write("0/0_0.glb");
  write("1/1_0.glb");
  for (const int x : {2, 3}) {
    for (const int y : {0, 1}) {
      WriteFile(folder / fmt::format("s/2.{}.{}.subtree", x, y), leaf);
      write(fmt::format("2/{}_{}.glb", x, y));
    }
  }
  EXPECT_EQ(ReadMesh(file).triangles.size(), sum);
  MeshReadOptions options;
  options.tiles.max_error = 8;  // that of level 1
  EXPECT_EQ(ReadMesh(file, options).triangles.size(), 1u + 2);
  const std::string last =
      R"({"tileAvailability":{"constant":1},"childSubtreeAvailability":{"constant":0})";
  WriteFile(folder / "s/2.3.1.subtree", last + "}");  // without contents
  EXPECT_EQ(ReadMesh(file).triangles.size(), sum - count / 2);
  WriteFile(folder / "s/2.3.1.subtree",
            last + R"(,"contentAvailability":[{"constant":1},{"constant":0}]})");
  EXPECT_TRUE(FailsWithInputError(
      [&] { ReadMesh(file); },
      {"2.3.1.subtree: contentAvailability", "expected it of 1 contents, found it of 2"}));
  std::filesystem::remove(folder / "s/2.3.1.subtree");
  EXPECT_TRUE(
      FailsWithInputError([&] { ReadMesh(file); },
                          {"tileset.json: root.implicitTiling: s/2.3.1.subtree: no such file"}));
}

size_t PeakMemoryBytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<size_t>(usage.ru_maxrss) * 1024;
}

// Each of 200 contents has its bit in a buffer of 5 MB, beside the JSON or in a file.
TEST(ReadTileset, OfABufferOnlyTheBitsAreKept) {
  constexpr size_t kBytes = 5'000'000, kContents = 200;
  std::vector<std::string> uris, bits;
  for (size_t i = 0; i < kContents; ++i) {
    uris.push_back(fmt::format(R"({{"uri":"{}.glb"}})", i == 0 ? "tile" : "gone"));
    bits.push_back(fmt::format(R"({{"bitstream":{}}})", i == 0 ? 0 : 1));
  }
  const path file =
      WriteTileset(kSphere + fmt::format(R"(0,"refine":"ADD","contents":[{}],"implicitTiling":
{{"subdivisionScheme":"QUADTREE","subtreeLevels":1,"availableLevels":1,"subtrees":{{"uri":"s"}}}})",
                                         fmt::join(uris, ",")));
  const path folder = file.parent_path();
  WriteFile(folder / "tile.glb", TileGlb(HillPatch({0, 0})));
  WriteFile(folder / "bits", std::string(1, '\1') + std::string(kBytes - 1, '\0'));
  for (const std::string where : {R"("uri":"bits",)", ""}) {
    const std::string json = fmt::format(
        R"({{"tileAvailability":{{"constant":1}},"childSubtreeAvailability":{{"constant":0}},
"contentAvailability":[{0}],"buffers":[{{{1}"byteLength":{2}}}],"bufferViews":[
{{"buffer":0,"byteOffset":0,"byteLength":{2}}},{{"buffer":0,"byteOffset":1,"byteLength":{3}}}]}})",
        fmt::join(bits, ","), where, kBytes, kBytes - 1);
    std::string subtree = "subt";
    AppendBytes(subtree, uint32_t{1});
    AppendBytes(subtree, uint64_t{json.size()});
    AppendBytes(subtree, uint64_t{kBytes});
    WriteFile(folder / "s", subtree + json + ReadFile(folder / "bits"));
    const size_t before = PeakMemoryBytes();
    EXPECT_FALSE(ReadMesh(file).triangles.empty());
    EXPECT_LT(PeakMemoryBytes() - before, 10 * kBytes);  // it was 200 times
  }
}

TEST(ReadTileset, ATileOfSliversIsLeftOut) {
  const path file = WriteTileset(
      kSphere + std::string(R"(0,"refine":"ADD","contents":[{"uri":"a.glb"},{"uri":"b.glb"}])"));
  TilePatch sliver = HillPatch({0, 0});
  sliver.triangles = {{0, 0, 1}, {5, 5, 5}};
  WriteFile(file.parent_path() / "a.glb", TileGlb(sliver));
  WriteFile(file.parent_path() / "b.glb", TileGlb(HillPatch({0, 0})));
  const TriangleMesh mesh = ReadMesh(file);
  EXPECT_EQ(mesh.triangles.size(), HillPatch({0, 0}).triangles.size());
  ASSERT_EQ(mesh.warnings.size(), 1u);
  EXPECT_EQ(mesh.warnings[0],
            file.string() + ": 1 tiles are left out, as none of their triangles has an area");
  WriteFile(file.parent_path() / "b.glb", TileGlb(sliver));
  EXPECT_TRUE(FailsWithInputError(
      [&] { ReadMesh(file); },
      {"tileset.json: expected tiles with triangles, found none; 2 tiles are left out"}));
}

TEST(ReadTileset, ASystemOfOtherPlacesIsAWarning) {
  const path file = WriteTileset(
      fmt::format(R"("transform":{},{}0,"refine":"ADD","content":{{"uri":"tile.glb"}})",
                  ColumnsOf(EarthFromLocal()), kSphere));
  WriteFile(file.parent_path() / "tile.glb", TileGlb(HillPatch({0, 0})));
  const auto warnings = [&](const char* crs) {
    MeshReadOptions options;
    options.tiles.world = WorldFrame::Parse(crs);
    return fmt::format("{}", fmt::join(ReadMesh(file, options).warnings, "\n"));
  };
  EXPECT_EQ(warnings("EPSG:25832@559000,5934000,50"), "");
  const std::string british = warnings("EPSG:27700");
  EXPECT_NE(british.find("is not where EPSG:27700"), std::string::npos) << british;
  EXPECT_NE(british.find(file.string() + ": crs: "), std::string::npos) << british;
}

TEST(ReadTileset, TheCenterOfARegionIsBetweenItsHeights) {
  const path file = WriteTileset(
      R"("boundingVolume":{"region":[0.17,0.93,0.171,0.931,-50,400]},"geometricError":0,
"refine":"ADD","content":{"uri":"tile.glb"})");
  WriteFile(file.parent_path() / "tile.glb", TileGlb(HillPatch({0, 0})));
  const TriangleMesh mesh = ReadMesh(file);
  ASSERT_EQ(mesh.warnings.size(), 1u);
  EXPECT_NE(mesh.warnings[0].find(" 175.0000 (longitude, latitude, height"), std::string::npos)
      << mesh.warnings[0];
}

TEST(ReadTileset, ImplicitTreesWithoutEndAreAnError) {
  for (const auto& [levels, message] :
       {std::pair(15, "more than 1048576 tiles"), std::pair(31, "more than 1000 tiles name")}) {
    const path file = WriteTileset(
        kSphere + fmt::format(R"(16,"refine":"ADD","implicitTiling":{{"subdivisionScheme":"OCTREE",
"subtreeLevels":15,"availableLevels":{},"subtrees":{{"uri":"s.json"}}}})",
                              levels));
    WriteFile(file.parent_path() / "s.json",
              R"({"tileAvailability":{"constant":1},"childSubtreeAvailability":{"constant":1}})");
    EXPECT_TRUE(FailsWithInputError([&] { ReadMesh(file); }, {message}));
  }
}

TEST(ReadTileset, WhatIsWrongIsNamedInOneLine) {
  const auto content = [](const std::string& uri) {
    return kSphere + fmt::format(R"(0,"refine":"ADD","content":{{"uri":"{}"}})", uri);
  };
  const std::vector<std::pair<std::string, std::string>> wrong = {
      {content("gone.glb"), "root.content.uri: gone.glb: no such file"},
      {content("."), "root.content.uri: .: no such file"},
      {content("tileset.json"), "root.content.uri: the tileset includes itself"},
      {content("../tile.glb"), "root.content.uri: expected a file below the tileset's folder"},
      {content("%2e%2e/tile.glb"), "found ../tile.glb"},
      {content("a/../../tile.glb"), "expected a file below the tileset's folder"},
      {content("/etc/passwd"), "found /etc/passwd"},
      {content("https://tiles.example/a.glb"), "an address on a network, https://tiles.example"},
      {content("//tiles.example/a.glb"), "an address on a network"},
      {content(""), "expected a file below the tileset's folder"},
      {R"("geometricError":0)", "root: the member \"boundingVolume\" is missing"},
      {R"("boundingVolume":{"sphere":[0,0,1]},"geometricError":0)", "expected 4 elements"},
      {R"("boundingVolume":{},"geometricError":0)", "expected a box, a region or a sphere"},
      {R"("boundingVolume":{"region":[9,53,10,54,0,1]},"geometricError":0)", "expected radians"},
      {R"("boundingVolume":{"sphere":[0,0,0,1]})", "the member \"geometricError\" is missing"},
      {kSphere + std::string("-1"), "root.geometricError: expected 0 or more"},
      {kSphere + std::string("\"1\""), "root.geometricError: expected a number"},
      {kSphere + std::string(R"(0,"refine":"BOTH")"), "root.refine: expected ADD or REPLACE"},
      {kSphere + std::string(R"(0,"transform":[1,2,3])"), "root.transform: expected 16 elements"},
      {kSphere + std::string(R"(0,"transform":[1,0,0,0,1,0,0,0,0,0,1,0,0,0,0,1])"),
       "root.transform: expected a 4 x 4 matrix"},
      {kSphere + std::string(R"(0,"children":{})"), "root.children: expected an array"},
      {kSphere + std::string("0"), "expected tiles with triangles, found none"},
      {kSphere + std::string(R"(0,"implicitTiling":{"subdivisionScheme":"QUADTREE",
"subtreeLevels":16,"availableLevels":1,"subtrees":{"uri":"s"}})"),
       "subtreeLevels: expected a number up to 15"}};
  for (const auto& [root, message] : wrong) {
    const path file = WriteTileset(root);
    EXPECT_TRUE(FailsWithInputError([&] { ReadMesh(file); }, {"tileset.json: ", message})) << root;
  }
  for (
      const auto& [text, message] : std::vector<std::pair<std::string, std::string>>{
          {"{", "line 1"},
          {"[]", "expected an object"},
          {R"({"asset":{"version":"0.0"}})", "asset.version: expected 1.0 or 1.1"},
          {R"({"asset":{"version":"1.0"},"extensionsRequired":["3DTILES_draco_point_compression"]})",
           "requires 3DTILES_draco_point_compression, which is not read"}}) {
    const path file = TestFolder() / "tileset.json";
    WriteFile(file, text);
    EXPECT_TRUE(FailsWithInputError([&] { ReadMesh(file); }, {"tileset.json: ", message})) << text;
  }
}

TEST(ReadTileset, TilesThatAreDamagedAreNamed) {
  const path file =
      WriteTileset(kSphere + std::string(R"(0,"refine":"ADD","content":{"uri":"tile"})"));
  const path tile = file.parent_path() / "tile";
  const std::string good = Cmpt({B3dm(TileGlb(HillPatch({0, 0})), {1, 2, 3})});
  WriteFile(tile, good);
  EXPECT_NO_THROW(ReadMesh(file));
  for (size_t size = 0; size < 200; ++size) {
    WriteFile(tile, good.substr(0, size));
    EXPECT_TRUE(FailsWithInputError([&] { ReadMesh(file); }, {"tile: "})) << size;
  }
  const auto external = R"(,"buffers":[{"uri":"other.bin","byteLength":4}])";
  for (
      const auto& [contents, message] : std::vector<std::pair<std::string, std::string>>{
          {"nothing of the kind", "that begins with \"noth\""},
          {Tile("b3dm", std::string(16, '\0') + "glTX"), "expected binary glTF"},
          {B3dm(Tile("glTF", std::string(8, '\0'))), "version: expected glTF 2, found 1"},
          {Tile("cmpt", std::string("\xff\xff\xff\xff", 4)), "damaged or truncated"},
          {Tile("i3dm", ""), "damaged or truncated"},
          {I3dm(R"({"INSTANCES_LENGTH":2})", "", TileGlb(HillPatch({0, 0}))), "expected POSITION"},
          {I3dm(
               R"({"INSTANCES_LENGTH":2,"POSITION":{"byteOffset":4}})", std::string(24, '\0'),
               TileGlb(HillPatch({0, 0}))),
           "POSITION.byteOffset: expected 6 numbers in 24 bytes"},
          {I3dm(
               R"({"INSTANCES_LENGTH":1,"POSITION":{"byteOffset":0}})", std::string(12, '\0'),
               "../other.glb", 0),
           "expected a file below the tileset's folder"},
          {I3dm(
               R"({"INSTANCES_LENGTH":1,"POSITION":{"byteOffset":0},"NORMAL_UP":{"byteOffset":0}})",
               std::string(12, '\0'), TileGlb(HillPatch({0, 0}))),
           "expected NORMAL_UP and NORMAL_RIGHT"},
          {I3dm(R"({"INSTANCES_LENGTH":-3})", "", TileGlb(HillPatch({0, 0}))),
           "INSTANCES_LENGTH: expected a number of instances"},
          {I3dm("{}", "", "x.glb", 7), "INSTANCES_LENGTH\" is missing"},
          {B3dm(TileGlb(HillPatch({0, 0}), "", external)),
           "buffers[0].uri: expected the bytes in"}}) {
    WriteFile(tile, contents);
    EXPECT_TRUE(FailsWithInputError([&] { ReadMesh(file); }, {message})) << message;
  }
  std::string nested = B3dm(TileGlb(HillPatch({0, 0})));
  for (int i = 0; i < 18; ++i) nested = Cmpt({nested});
  WriteFile(tile, nested);
  EXPECT_TRUE(FailsWithInputError([&] { ReadMesh(file); }, {"nested more than 16 deep"}));
}

TEST(ReadTileset, AFileIsNamedALimitedNumberOfTimes) {
  std::string children;
  for (int i = 0; i < 1001; ++i) {
    children += (i > 0 ? ",{" : "{") + std::string(kSphere) + R"(0,"content":{"uri":"tile.glb"}})";
  }
  const path file = WriteTileset(kSphere + (R"(0,"refine":"ADD","children":[)" + children + "]"));
  WriteFile(file.parent_path() / "tile.glb", TileGlb(HillPatch({0, 0})));
  EXPECT_TRUE(FailsWithInputError([&] { ReadMesh(file); },
                                  {"root.children[1000].content.uri: more than 1000 tiles name"}));
}

TEST(ReadTileset, TheMeshIsTheSameForAnyNumberOfThreads) {
  std::string children;
  const path file = TestFolder() / "tileset.json";
  for (int i = 0; i < 9; ++i) {
    children += (i > 0 ? ",{" : "{") + std::string(kSphere) +
                fmt::format(R"(0,"content":{{"uri":"{}.glb"}}}})", i);
    WriteFile(file.parent_path() / fmt::format("{}.glb", i),
              TileGlb(HillPatch({40.0 * (i % 3), 40.0 * (i / 3)})));
  }
  WriteFile(file, TilesetJson(fmt::format(R"("transform":{},{}0,"refine":"ADD","children":[{}])",
                                          ColumnsOf(EarthFromLocal()), kSphere, children)));
  MeshReadOptions options;
  options.tiles.world = WorldFrame::Parse("EPSG:25832@559000,5934000,50");
  options.threads = 1;
  const TriangleMesh one = ReadMesh(file, options);
  options.threads = 4;
  const TriangleMesh four = ReadMesh(file, options);
  EXPECT_EQ(one.triangles, four.triangles);
  EXPECT_EQ(one.origin_in_world, four.origin_in_world);
  EXPECT_EQ(one.vertices, four.vertices);
}

}  // namespace
}  // namespace raylift
