#include "lifting/mesh_spec.h"

#include "renderers/splat_blend.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <Eigen/Geometry>
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

using BuildQuality = RayCasterOptions::BuildQuality;

std::string OptionErrorOf(const std::string& spec, MeshUse use) {
  try {
    ParseMeshSpec(spec, use);
  } catch (const OptionError& error) {
    return error.what();
  }
  return "no OptionError";
}

TEST(ParseMeshSpec, TakesEveryKey) {
  const MeshSpec mesh = ParseMeshSpec(
      "mesh:a.ply+b.ply,near=1,far=9,max_incidence_deg=70,max_depth_jump=0.5,jump_radius_px=3,"
      "back_faces=drop,build=medium",
      MeshUse::kLift);
  EXPECT_EQ(mesh.files, "a.ply+b.ply");
  EXPECT_EQ(mesh.options.limits.near_z, 1);
  EXPECT_EQ(mesh.options.limits.far_z, 9);
  EXPECT_EQ(mesh.options.limits.max_incidence_deg, 70);
  EXPECT_EQ(mesh.options.limits.max_depth_jump, 0.5);
  EXPECT_EQ(mesh.options.jump_radius_px, 3);
  EXPECT_EQ(mesh.options.limits.back_faces, SurfaceLimits::BackFaces::kDrop);
  EXPECT_EQ(mesh.build, BuildQuality::kMedium);
}

TEST(ParseMeshSpec, LeavesTheBuildToTheUseWhereNoneIsSaid) {
  for (const MeshUse use : {MeshUse::kLift, MeshUse::kRender}) {
    EXPECT_FALSE(ParseMeshSpec("mesh:a.ply", use).build);
    EXPECT_EQ(ParseMeshSpec("mesh:a.ply,build=low", use).build, BuildQuality::kLow);
  }
}

TEST(ParseMeshSpec, RefusesToRenderWithKeysOfLifting) {
  for (const std::string key : {"near=1", "far=9", "max_incidence_deg=70", "max_depth_jump=0.5",
                                "jump_radius_px=3", "back_faces=drop"}) {
    EXPECT_EQ(
        OptionErrorOf("mesh:a.ply," + key, MeshUse::kRender),
        "geometry = mesh:a.ply," + key + ": the key " + key.substr(0, key.find('=')) +
            " says which points are lifted, but here all there is is rendered; there is "
            "scale, axes (as in x/-z/y), shift=X/Y/Z, matrix (3 x 4 or 4 x 4), build=low|medium; "
            "of city models lod; of 3D Tiles error=METERS, crs=EPSG:N[@X/Y/Z]");
  }
}

TEST(ParseMeshSpec, SaysWhereTheMeshBelongs) {
  for (const MeshUse use : {MeshUse::kLift, MeshUse::kRender}) {
    const MeshPlacement placement =
        ParseMeshSpec("mesh:a.ply,scale=0.5,axes=x/-z/y,shift=1/2/-3", use).placement;
    EXPECT_EQ(placement * Eigen::Vector3d(2, 4, 6), Eigen::Vector3d(2, -1, -1));
    EXPECT_EQ(KeysOf(placement), "scale=0.5,axes=x/-z/y,shift=1/2/-3");
  }
  const MeshPlacement by_matrix =
      ParseMeshSpec("mesh:a.ply,matrix=0/2/0/7/2/0/0/8/0/0/2/9", MeshUse::kLift).placement;
  EXPECT_EQ(by_matrix * Eigen::Vector3d(1, 2, 3), Eigen::Vector3d(11, 10, 15));
  EXPECT_TRUE(by_matrix.IsMirror());
}

TEST(ParseMeshSpec, TakesAWholeMatrixAndMakesItsRowsOrthogonal) {
  const MeshPlacement placement =
      ParseMeshSpec("mesh:a.ply,matrix=0/-1/0/7/1/0/0/8/0/0/1/9/0/0/0/1", MeshUse::kLift).placement;
  EXPECT_EQ(placement * Eigen::Vector3d(1, 2, 3), Eigen::Vector3d(5, 9, 12));
  const MeshPlacement rounded =
      ParseMeshSpec("mesh:a.ply,matrix=0.86603/-0.5/0/0/0.5/0.86603/0/0/0/0/1/0", MeshUse::kLift)
          .placement;
  EXPECT_TRUE((rounded.axes * rounded.axes.transpose()).isIdentity(1e-12));
}

TEST(MeshPlacement, InverseUndoesItExactlyEnough) {
  const MeshPlacement placement{
      .scale = 1000, .axes = *AxesFromName("x/-z/y"), .shift = {1, 0.2, -3}};
  EXPECT_TRUE((placement * Inverse(placement)).IsIdentity());
  EXPECT_TRUE((Inverse(placement) * placement).IsIdentity());
  const MeshPlacement other{.scale = 0.5, .axes = *AxesFromName("-x/y/z"), .shift = {0, 7, 0}};
  const Eigen::Vector3d point(1, 2, 3);
  EXPECT_LT(((placement * other) * point - placement * (other * point)).norm(), 1e-9);
}

TEST(MeshPlacement, DescribesMirrorsByTheirTurn) {
  const Eigen::AngleAxisd turn(0.5, Eigen::Vector3d(1, 2, 3).normalized());
  const MeshPlacement mirror{.axes = -turn.toRotationMatrix()};
  EXPECT_NE(Describe(mirror).find("28.65 deg"), std::string::npos) << Describe(mirror);
}

TEST(ParseMeshSpec, RefusesPlacesThatAreNone) {
  for (const std::string keys :
       {"scale=0", "scale=inf", "axes=x/y", "axes=x/x/z", "axes=x/y/w", "shift=1/2",
        "shift=1/2/nan", "matrix=1/2/3", "matrix=1/0/0/0/0/2/0/0/0/0/1/0",
        "matrix=0/0/0/0/0/0/0/0/0/0/0/0", "matrix=1/0/0/0/0/1/0/0/0/0/1/0/0/0/0/2",
        "matrix=1/0/0/0/0/1/0/0/0/0/1/0,scale=2"}) {
    EXPECT_NE(OptionErrorOf("mesh:a.ply," + keys, MeshUse::kLift), "no OptionError") << keys;
  }
}

TEST(MeshPlacement, AShiftIsTakenOffTheOriginOfTheSystem) {
  TriangleMesh mesh = MakeMesh({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}});
  mesh.crs = "EPSG:25832";
  const MeshPlacement shift{.shift = {-500000, -5900000, 0.5}};
  EXPECT_EQ(Placed(mesh, shift).crs, "EPSG:25832@500000,5900000,-0.5");
  EXPECT_EQ(Placed(Placed(mesh, shift), shift).crs, "EPSG:25832@1000000,11800000,-1");
  EXPECT_EQ(Placed(mesh, {.scale = 0.001}).crs, "") << "of no known system";
}

// What an eye sees of splats does not depend on the frame that both are in.
TEST(MeshPlacement, SplatsLookTheSameWhereverTheyArePlaced) {
  Rng rng = TestRng();
  Splats splats;
  splats.degree = 3;
  for (int i = 0; i < 50; ++i) {
    splats.means.emplace_back(static_cast<float>(rng.Uniform(-1, 1)),
                              static_cast<float>(rng.Uniform(-1, 1)),
                              static_cast<float>(rng.Uniform(2, 4)));
    splats.rotations.push_back(RandomRigid3(rng, 0).rotation.cast<float>());
    splats.scales.emplace_back(0.4f, 0.2f, 0.1f);
    splats.opacities.push_back(0.7f);
    for (int k = 0; k < 16; ++k) {
      splats.harmonics.emplace_back(Eigen::Vector3f::Constant(static_cast<float>(rng.Normal())));
    }
  }
  const auto look = [](const Splats& seen, const Ray& ray) {
    const RayCaster caster(std::make_shared<const Splats>(seen), SplatDepth::kMedian);
    SplatLook found;
    caster.LookAtSplats({&ray, 1}, SplatColors(seen, ray.origin_in_world, 1), {&found, 1});
    return found;
  };
  for (const bool mirrored : {false, true}) {
    MeshPlacement placement{.scale = 2.5,
                            .axes = RandomRigid3(rng, 0).rotation.toRotationMatrix(),
                            .shift = {1000, -20, 3}};
    if (mirrored) placement.axes = -placement.axes;
    const Splats placed = Placed(splats, placement);
    int hits = 0;
    for (int i = 0; i < 50; ++i) {
      const Ray ray{{0, 0, 0}, {rng.Uniform(-0.3, 0.3), rng.Uniform(-0.3, 0.3), 1}};
      const Ray placed_ray{placement * ray.origin_in_world,
                           placement.axes * ray.direction_in_world};
      const SplatLook before = look(splats, ray);
      const SplatLook after = look(placed, placed_ray);
      EXPECT_NEAR(after.transmittance, before.transmittance, 1e-5);
      EXPECT_NEAR((after.color_rgb - before.color_rgb).norm(), 0, 1e-4);
      ASSERT_EQ(after.hit.has_value(), before.hit.has_value());
      if (!before.hit) continue;
      ++hits;
      EXPECT_NEAR(after.hit->ray_t, 2.5 * before.hit->ray_t, 1e-4);
      EXPECT_NEAR(after.hit->sigma, 2.5 * before.hit->sigma, 1e-4);
    }
    EXPECT_GT(hits, 10);
  }
}

TEST(ParseMeshSpec, TilesetsHaveKeysOfTheirOwn) {
  const MeshSpec tiles =
      ParseMeshSpec("mesh:a/tileset.json,error=2.5,crs=EPSG:25832@1/2/3", MeshUse::kRender);
  EXPECT_EQ(tiles.tiles.max_error, 2.5);
  EXPECT_EQ(tiles.tiles.world.value().text, "EPSG:25832@1,2,3");
  for (const std::string wrong : {"crs=EPSG:25832@1/2", "crs=EPSG:4326", "crs=", "error=a"}) {
    EXPECT_NE(OptionErrorOf("mesh:tileset.json," + wrong, MeshUse::kLift), "no OptionError");
  }
}

// A file of a tileset at a center, which holds no tiles, as a specification.
std::string TilesetSpec(const std::filesystem::path& file, std::string_view center) {
  WriteFile(file, fmt::format(R"({{"asset":{{"version":"1.0"}},"root":{{"boundingVolume":
{{"sphere":[{},9]}},"geometricError":0}}}})",
                              center));
  return "mesh:" + file.string();
}
constexpr std::string_view kOnEarth = "3741100,652926,5107187", kNearby = "3741200,652926,5107187";

TEST(FilesOf, KeysAreForTheirKindOfFile) {
  const std::filesystem::path folder = TestFolder();
  const std::string tiles = TilesetSpec(folder / "tileset.json", kOnEarth);
  const std::string city = "mesh:" + (folder / "own.json").string();
  WriteFile(folder / "own.json", R"({"type":"CityJSON"})");
  const auto files = [](const std::string& spec) {
    return FilesOf(ParseMeshSpec(spec, MeshUse::kLift));
  };
  EXPECT_EQ(files(tiles + ",error=1,crs=EPSG:25832").size(), 1u);
  EXPECT_EQ(files(city + ",lod=2").size(), 1u);
  EXPECT_EQ(files("mesh:a.gml+b.ply,lod=2").size(), 2u);
  for (const auto& [spec, message] : std::vector<std::pair<std::string, std::string>>{
           {tiles + ",lod=2", "tileset.json: lod: is a key of city models"},
           {"mesh:a.ply,lod=2", "a.ply: lod: is a key of city models"},
           {"mesh:a.ply,error=1", "a.ply: error: is a key of 3D Tiles"},
           {city + ",error=1", "own.json: error: is a key of 3D Tiles"},
           {city + ",crs=EPSG:25832", "own.json: crs: is a key of 3D Tiles"}}) {
    EXPECT_TRUE(FailsWithInputError([&] { files(spec); }, {message})) << spec;
  }
}

TEST(FilesOf, AFolderOfATilesetIsThatTileset) {
  const std::filesystem::path folder = TestFolder();
  TilesetSpec(folder / "A" / "tileset.json", kOnEarth);
  WriteFile(folder / "A" / "tile.glb", "");
  WriteFile(folder / "B" / "b.ply", "");
  const auto files = FilesOf(ParseMeshSpec(
      "mesh:" + (folder / "A").string() + "+" + (folder / "B").string(), MeshUse::kLift));
  EXPECT_EQ(files,
            (std::vector<std::filesystem::path>{folder / "A/tileset.json", folder / "B/b.ply"}));
}

TEST(OpenMesh, EarthCenteredTilesBesideOthersNeedTheirSystem) {
  const std::filesystem::path folder = TestFolder();
  const std::string a = TilesetSpec(folder / "A/tileset.json", kOnEarth);
  TilesetSpec(folder / "B/tileset.json", kNearby);
  WriteFile(folder / "plain.ply", "");
  for (const char* other : {"B/tileset.json", "B", "plain.ply"}) {
    const std::string spec = a + "+" + (folder / other).string();
    EXPECT_TRUE(FailsWithInputError(
        [&] { OpenMesh(ParseMeshSpec(spec, MeshUse::kLift), 1); },
        {"A/tileset.json: earth-centered 3D Tiles beside other meshes", "expected crs=EPSG:N"}));
    EXPECT_TRUE(FailsWithInputError(
        [&] { OpenMesh(ParseMeshSpec(spec + ",crs=EPSG:25832", MeshUse::kLift), 1); },
        {"A/tileset.json: expected tiles with triangles"}));
  }
}

TEST(InWorld, OneOfSeveralFilesOnTheEarthIsEnough) {
  const std::filesystem::path folder = TestFolder();
  const std::string a = TilesetSpec(folder / "A/tileset.json", kOnEarth);
  const std::string b = TilesetSpec(folder / "B/tileset.json", "10,20,30").substr(5);
  const std::string plain = (folder / "plain.ply").string();
  const std::vector<std::string> specs = {a + "+" + plain, "mesh:" + b + "+" + a.substr(5),
                                          "mesh:" + (folder / "*/tileset.json").string(),
                                          "mesh:" + (folder / "A").string(), "mesh:" + b};
  const auto led = InWorld(specs, WorldFrame::Parse("EPSG:25832@1,2,-3"));
  for (size_t i = 0; i < 4; ++i) EXPECT_EQ(led[i], specs[i] + ",crs=EPSG:25832@1/2/-3");
  EXPECT_EQ(led[4], specs[4]);
}

TEST(InWorld, TilesOnTheEarthAreLedToItUnlessTheySayWhere) {
  const std::filesystem::path folder = TestFolder();
  const std::string on_earth = TilesetSpec(folder / "earth.json", kOnEarth);
  const std::string local = TilesetSpec(folder / "local.json", "10,20,30");
  WriteFile(folder / "city.json", "{}");
  const std::vector<std::string> specs = {
      on_earth,     local, on_earth + ",crs=EPSG:4978", "mesh:" + (folder / "city.json").string(),
      "mesh:a.ply", "sfm"};
  EXPECT_EQ(InWorld(specs, std::nullopt), specs);
  std::vector<std::string> led = specs;
  led[0] += ",crs=EPSG:25832@1/2/-3";
  EXPECT_EQ(InWorld(specs, WorldFrame::Parse("EPSG:25832@1,2,-3")), led);
}

TEST(ParseMeshSpec, WhatIsNoMeshSaysWhatIsWanted) {
  for (const std::string spec : {"depth:maps", "a.ply", "mesh:", "mesh:,build=low"}) {
    EXPECT_EQ(
        OptionErrorOf(spec, MeshUse::kLift),
        "geometry = " + spec + ": expected mesh:PATH[,key=value...] or dsm:FILE[,key=value...]");
    EXPECT_EQ(
        OptionErrorOf(spec, MeshUse::kRender),
        "geometry = " + spec +
            ": expected mesh:PATH[,key=value...], dsm:FILE[,key=value...], "
            "cloud:PATH[,key=value...] or splat:FILE[,key=value...]; nothing else is rendered");
  }
}

}  // namespace
}  // namespace raylift
