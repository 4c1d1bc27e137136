#include "raylift/lifting/depth_source.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <memory>

#include "lifting/depth_convention.h"
#include "support/matchers.h"
#include "support/meshes.h"
#include "support/test_data.h"

#include "raylift/base/file.h"
#include "raylift/base/parallel.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/depth_file.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/lifting/mesh_source.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

std::shared_ptr<const RayCaster> MakeCaster(TriangleMesh mesh) {
  return std::make_shared<const RayCaster>(std::make_shared<const TriangleMesh>(std::move(mesh)));
}

Camera MakeCamera() {
  const double params[] = {500, 510, 322, 238};
  return {CameraModel::kPinhole, 640, 480, params};
}

// The largest distance, in a second view, between points lifted from the mesh and from its rendered
// depth map, where the mesh is smooth around the keypoint.
double LargestDifferencePx(const RayCaster& caster, const std::shared_ptr<const RayCaster>& shared,
                           const PosedImage& reference, const PosedImage& other, Rng& rng) {
  const DepthMap map = RenderDepth(caster, reference.camera, reference.cam_from_world, 1);
  const auto pixels = RandomPixels(reference.camera, 4000, rng);
  const MeshSource mesh("mesh", shared,
                        {.limits = {.max_incidence_deg = 75, .max_depth_jump = 0.002}});
  const auto expected = mesh.Lift(reference, pixels);
  const auto lifted = LiftByDepthMap(map, reference, pixels);
  double largest = 0;
  int compared = 0;
  for (size_t i = 0; i < pixels.size(); ++i) {
    if (!expected[i]) continue;
    EXPECT_TRUE(lifted[i]);
    if (!lifted[i]) continue;
    const auto a = other.camera.ImgFromCam(other.cam_from_world * expected[i]->point_in_world);
    const auto b = other.camera.ImgFromCam(other.cam_from_world * lifted[i]->point_in_world);
    if (!a || !b) continue;
    largest = std::max(largest, (*a - *b).norm());
    const auto own =
        reference.camera.ImgFromCam(reference.cam_from_world * lifted[i]->point_in_world);
    EXPECT_LT((*own - pixels[i]).norm(), 1e-6) << "on the keypoint's ray";
    EXPECT_NEAR(lifted[i]->incidence_deg, expected[i]->incidence_deg, 2);
    ++compared;
  }
  EXPECT_GT(compared, 500);
  return largest;
}

TEST(DepthSource, LiftsAsTheMeshOfWhichTheMapIsAView) {
  Rng rng = TestRng();
  const std::vector<TriangleMesh> meshes = {
      MakePlane({Eigen::Quaterniond::Identity(), {0, 0, 0}}, 60, 30),
      MakeSphere({0, 0, 0}, 2.5, 400, 800), MakeBox({0, 0, 0}, {6, 5, 4.5})};
  for (const TriangleMesh& mesh : meshes) {
    const auto caster = MakeCaster(mesh);
    const bool inside = mesh.triangles.size() == 12;
    const Eigen::Vector3d eye(0.4, -0.7, inside ? -3 : -5);
    const PosedImage reference{"r", MakeCamera(), LookAt(eye, {0.5, 0.3, 0})};
    const PosedImage other{"o", MakeCamera(),
                           LookAt(eye + Eigen::Vector3d(1, 0.3, 0.2), {0.5, 0.3, 0})};
    EXPECT_LT(LargestDifferencePx(*caster, caster, reference, other, rng), 0.01);
  }
}

TEST(DepthSource, LiftsThroughDistortionFromMapsOfHalfTheSize) {
  Rng rng = TestRng();
  const auto caster = MakeCaster(MakePlane({Eigen::Quaterniond::Identity(), {0, 0, 0}}, 60, 1));
  const double params[] = {500, 510, 322, 238, -0.1, 0.02, 0.001, -0.002};
  const Camera camera(CameraModel::kOpenCv, 640, 480, params);
  const PosedImage reference{"r", camera, LookAt({0.4, -0.7, -5}, {1.5, 0.3, 0})};
  const DepthMap half = RenderDepth(*caster, camera.Scaled(320, 240), reference.cam_from_world, 1);
  const MeshSource mesh("mesh", caster);
  const auto pixels = RandomPixels(camera, 2000, rng);
  const auto expected = mesh.Lift(reference, pixels);
  const auto lifted = LiftByDepthMap(half, reference, pixels);
  for (size_t i = 0; i < pixels.size(); ++i) {
    ASSERT_TRUE(expected[i] && lifted[i]);
    // Distortion bends 1/z within a pixel of the map by second order.
    EXPECT_NEAR(lifted[i]->depth_z, expected[i]->depth_z, 2e-5 * expected[i]->depth_z);
    EXPECT_GT(lifted[i]->normal_in_world.dot(expected[i]->normal_in_world), 1 - 1e-5);
  }
}

TEST(DepthSource, NoPointAtASilhouetteLiesBetweenTheSurfaces) {
  // A box, seen obliquely, before a wall.
  Rng rng = TestRng();
  const auto caster =
      MakeCaster(MergeMeshes({MakeBox({0, 0, 0}, {1, 1, 1}),
                              MakePlane({Eigen::Quaterniond::Identity(), {0, 0, 3}}, 60, 1)}));
  const PosedImage reference{"r", MakeCamera(), LookAt({2.5, -2, -5}, {0, 0, 0})};
  const DepthMap map = RenderDepth(*caster, reference.camera, reference.cam_from_world, 1);
  const auto pixels = RandomPixels(reference.camera, 40000, rng);
  const auto lifted = LiftByDepthMap(map, reference, pixels);
  int at_silhouette = 0;
  for (size_t i = 0; i < pixels.size(); ++i) {
    ASSERT_TRUE(lifted[i]);
    const Eigen::Vector3d& p = lifted[i]->point_in_world;
    const double from_wall = std::abs(p.z() - 3);
    const double from_box = std::abs(p.cwiseAbs().maxCoeff() - 1);
    // A surface goes on to the border of its pixel, up to 0.7 px beyond its silhouette: 1 cm
    // across the view, and more along a side seen obliquely.
    EXPECT_LT(std::min(from_wall, from_box), 0.03) << pixels[i].transpose();
    at_silhouette += lifted[i]->depth_jump > 0.1 ? 1 : 0;
  }
  EXPECT_GT(at_silhouette, 100);
}

// Three references whose maps are 2, 3 and 4 away, written as `write` says.
struct Wall {
  std::filesystem::path folder = TestFolder();
  std::vector<PosedImage> references;

  explicit Wall(const std::vector<std::string>& names) {
    for (const std::string& name : names) references.push_back({name, MakeCamera(), Rigid3()});
  }
  DepthMap Map(size_t index) const {
    return {64, 48, std::vector<float>(size_t{64} * 48, 2.0f + static_cast<float>(index))};
  }
};

double LiftedDepth(const GeometrySource& source, const PosedImage& reference) {
  const Eigen::Vector2d pixel(321.3, 200.7);
  const auto point = source.Lift(reference, {&pixel, 1})[0];
  return point ? point->depth_z : 0;
}

TEST(DepthSource, PresetsFindTheFilesOfTheirWriters) {
  struct Case {
    const char* preset;
    const char* image;
    const char* file;
    float stored;  // for a depth of 2
  };
  for (const Case& c : std::initializer_list<Case>{
           {"colmap", "a/b.jpg", "stereo/depth_maps/a/b.jpg.geometric.bin", 2},
           {"metric3d", "a/b.jpg", "a/b.npy", 2},
           {"7scenes", "seq-01/frame-000000.color.png", "seq01_frame-000000.pose.depth.tiff", 2000},
           {"7scenes", "seq-01/frame-000000.color.png", "seq-01/frame-000000.depth.png", 2000},
           {"12scenes", "frame-000000.color.jpg", "data/frame-000000.depth.png", 2000},
           {"scannet", "color/17.jpg", "depth/17.png", 2000},
           {"tum", "rgb/1305031102.175304.png", "depth/1305031102.160407.png", 10000},
           {"meshloc", "db/x.color.jpg", "db/x_depth.npz", 2},
           {"meshloc", "db/x.color.jpg", "db_x_depth.npz", 2},
           {"lamar", "a/b.jpg", "a/b.png", 2000},
           {"moge", "a/b.jpg", "a/b/depth.exr", 2},
           {"unidepth", "a/b.jpg", "a/b.npz", 2},
           {"depthpro", "a/b.jpg", "a/b.npz", 2}}) {
    Wall wall({c.image});
    const DepthMap map{64, 48, std::vector<float>(size_t{64} * 48, c.stored)};
    WriteDepthFile(wall.folder / c.file, map, {.png_step = 1});
    const NamedGeometry geometry = MakeGeometrySource(
        "depth:" + wall.folder.string() + ",preset=" + c.preset, {.references = wall.references});
    EXPECT_TRUE(geometry.warnings.empty()) << c.file;
    EXPECT_NEAR(LiftedDepth(*geometry.source, wall.references[0]), 2, 1e-6) << c.file;
  }
}

TEST(DepthSource, HeaderlessMapsHaveTheImagesSizeOrTheGivenOne) {
  Wall wall({"images/b.jpg"});
  const auto write = [&](const std::string& name, size_t count) {
    const std::vector<float> values(count, 2.0f);
    WriteFile(wall.folder / name,
              {reinterpret_cast<const char*>(values.data()), count * sizeof(float)});
  };
  write("images/b.depth", size_t{64} * 48);
  write("ground_truth_depth/images/b.jpg", size_t{640} * 480);
  const std::string folder = "depth:" + wall.folder.string();
  const GeometryContext context{.references = wall.references};
  EXPECT_NEAR(LiftedDepth(*MakeGeometrySource(folder + ",preset=eth3d", context).source,
                          wall.references[0]),
              2, 1e-6);
  EXPECT_NEAR(
      LiftedDepth(*MakeGeometrySource(folder + ",preset=kapture,size=64x48", context).source,
                  wall.references[0]),
      2, 1e-6);
  EXPECT_TRUE(FailsWithInputError([&] { MakeGeometrySource(folder + ",preset=kapture", context); },
                                  {"b.depth", "640 x 480 floats"}));
}

// As tools/kapture_import_7scenes.py names and fills them, and the older files of kapture's own
// sample: 65535 mm, 7-Scenes' "none", divided by 1000 like any other.
TEST(DepthSource, KapturesSevenScenesHasRegisteredMapsAndHoles) {
  Wall wall({"seq-01/frame-000000.color.jpg"});
  const auto write = [&](const std::string& name, float value) {
    const std::vector<float> values(size_t{64} * 48, value);
    WriteFile(wall.folder / name,
              {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float)});
  };
  const std::string spec = "depth:" + wall.folder.string() + ",preset=kapture,size=64x48";
  const auto lifted = [&] {
    return LiftedDepth(*MakeGeometrySource(spec, {.references = wall.references}).source,
                       wall.references[0]);
  };
  write("sensors/records_data/seq-01/frame-000000.depth", 2);
  EXPECT_NEAR(lifted(), 2, 1e-6);
  write("seq-01/frame-000000.depth", 3);
  EXPECT_NEAR(lifted(), 3, 1e-6);
  write("seq-01/frame-000000.depth.reg", 4);
  EXPECT_NEAR(lifted(), 4, 1e-6);
  write("seq-01/frame-000000.depth.reg", 65.535f);
  const std::vector<Eigen::Vector2d> pixels = {{321.3, 200.7}};
  EXPECT_FALSE(MakeGeometrySource(spec, {.references = wall.references})
                   .source->Lift(wall.references[0], pixels)[0]);
}

TEST(DepthSource, NerfactosDepthIsAlongTheRayAndSplatfactosIsNot) {
  Wall wall({"train/b.jpg"});
  const Camera map_camera = MakeCamera().Scaled(64, 48);
  std::vector<float> ray_t;
  for (const float z : RayZOfPixels(map_camera)) ray_t.push_back(2 / z);
  WriteDepthFile(wall.folder / "b.npy", {64, 48, ray_t});
  if (!HasProgram("gzip")) GTEST_SKIP() << "gzip is not on this machine";
  std::filesystem::create_directories(wall.folder / "raw-depth/train");
  RunProgram("gzip -c " + (wall.folder / "b.npy").string() + " > " +
             (wall.folder / "raw-depth/train/b.npy.gz").string());
  const std::string spec = "depth:" + wall.folder.string() + ",preset=nerfstudio";
  const GeometryContext context{.references = wall.references};
  EXPECT_NEAR(LiftedDepth(*MakeGeometrySource(spec, context).source, wall.references[0]), 2, 1e-5);
  const double wrong =
      LiftedDepth(*MakeGeometrySource(spec + ",kind=z", context).source, wall.references[0]);
  // 1/t bends between the pixels of this coarse map.
  EXPECT_NEAR(wrong, 2 / MakeCamera().RayInCam({321.3, 200.7})->z(), 5e-4);
  EXPECT_GT(wrong, 2.005);
}

TEST(DepthSource, MissingMapsAreCountedAndNoneAtAllIsAnError) {
  Wall wall({"a.jpg", "b.jpg", "c.jpg"});
  WriteDepthFile(wall.folder / "b.npy", wall.Map(1));
  const GeometryContext context{.references = wall.references};
  const NamedGeometry geometry = MakeGeometrySource("depth:" + wall.folder.string(), context);
  ASSERT_EQ(geometry.warnings.size(), 1u);
  EXPECT_NE(geometry.warnings[0].find("2 of 3 references have no depth map, e.g. a.jpg"),
            std::string::npos);
  EXPECT_EQ(geometry.interpretation, "NPY float32 64 x 48, z");
  EXPECT_EQ(LiftedDepth(*geometry.source, wall.references[0]), 0);
  EXPECT_EQ(LiftedDepth(*geometry.source, wall.references[1]), 3);
  EXPECT_TRUE(FailsWithInputError(
      [&] { MakeGeometrySource("depth:" + wall.folder.string() + ",pattern={stem}.exr", context); },
      {wall.folder.string(), "no depth map of any of the 3 references", "{stem}.exr"}));
}

TEST(DepthSource, SuspiciousMapsAreSaidToBe) {
  Wall wall({"a.jpg"});
  const GeometryContext context{.references = wall.references};
  const std::string spec = "depth:" + wall.folder.string();
  WriteDepthFile(wall.folder / "a.png", wall.Map(0), {.png_step = 0.001});
  const NamedGeometry integers = MakeGeometrySource(spec, context);
  ASSERT_EQ(integers.warnings.size(), 1u);
  EXPECT_NE(integers.warnings[0].find("taken as millimeters"), std::string::npos);
  EXPECT_NEAR(LiftedDepth(*integers.source, wall.references[0]), 2, 1e-6);
  EXPECT_TRUE(MakeGeometrySource(spec + ",unit=mm", context).warnings.empty());

  const DepthMap square{48, 48, std::vector<float>(size_t{48} * 48, 2.0f)};
  WriteDepthFile(wall.folder / "a.npy", square);
  const NamedGeometry cropped = MakeGeometrySource(spec + ",pattern={stem}.npy", context);
  ASSERT_EQ(cropped.warnings.size(), 1u);
  EXPECT_NE(cropped.warnings[0].find("48 x 48 is not the shape of its image, 640 x 480"),
            std::string::npos);
}

TEST(DepthSource, ConfidenceMapsMakeHoles) {
  Wall wall({"a.jpg"});
  WriteDepthFile(wall.folder / "a.npy", wall.Map(0));
  const auto lifts = [&](float accumulation, const std::string& keys) {
    const DepthMap map{64, 48, std::vector<float>(size_t{64} * 48, accumulation)};
    WriteDepthFile(wall.folder / "accumulation/a.npy", map);
    const std::string spec = "depth:" + wall.folder.string() +
                             ",pattern={stem}.npy,confidence=accumulation/{stem}.npy" + keys;
    return LiftedDepth(*MakeGeometrySource(spec, {.references = wall.references}).source,
                       wall.references[0]) > 0;
  };
  EXPECT_TRUE(lifts(0.6f, ""));
  EXPECT_FALSE(lifts(0.4f, ""));
  EXPECT_TRUE(lifts(0.4f, ",confidence_threshold=0.3"));
}

TEST(DepthSource, APresetsConfidencesAreInItsBundleAlone) {
  const Wall wall({"a.jpg"});
  WriteDepthFile(wall.folder / "a.npy", wall.Map(0));
  const NamedGeometry geometry =
      MakeGeometrySource("depth:" + wall.folder.string() + ",preset=da3,pattern={stem}.npy",
                         {.references = wall.references});
  EXPECT_FALSE(geometry.maps->HasConfidences());
  EXPECT_EQ(geometry.maps->LoadConfidence(wall.references[0]), nullptr);
  EXPECT_GT(LiftedDepth(*geometry.source, wall.references[0]), 0);
}

TEST(DepthSource, APresetsConfidencesOfAnotherShapeAreNotUsedUnlessAskedFor) {
  const Wall wall({"a.jpg"});
  RunProgram("/usr/bin/python3 -c \"import numpy; numpy.savez('" +
             (wall.folder / "results.npz").string() +
             "', depth=numpy.ones((1, 48, 64)), conf=numpy.ones((3, 48, 64)))\"");
  const std::string spec = "depth:" + wall.folder.string() + ",preset=da3";
  const NamedGeometry geometry = MakeGeometrySource(spec, {.references = wall.references});
  EXPECT_FALSE(geometry.maps->HasConfidences());
  ASSERT_EQ(geometry.warnings.size(), 1u);
  EXPECT_NE(geometry.warnings[0].find("no confidences are used: "), std::string::npos);
  EXPECT_NE(geometry.warnings[0].find("conf"), std::string::npos);
  EXPECT_TRUE(FailsWithInputError(
      [&] {
        MakeGeometrySource(spec + ",confidence_threshold=2", {.references = wall.references});
      },
      {"results.npz", "conf"}));
}

TEST(DepthFolder, ManyThreadsReadEachMapThroughASmallCache) {
  std::vector<std::string> names;
  for (int i = 0; i < 12; ++i) names.push_back("r" + std::to_string(i) + ".jpg");
  const Wall wall(names);
  for (size_t i = 0; i < names.size(); ++i) {
    WriteDepthFile(wall.folder / ("r" + std::to_string(i) + ".npy"), wall.Map(i));
  }
  const size_t bytes_per_map = size_t{64} * 48 * sizeof(float);
  const DepthFolder maps(wall.folder, {}, wall.references, 3 * bytes_per_map);
  std::atomic<int> wrong = 0;
  ParallelFor(400, 4, [&](size_t i) {
    const size_t index = (i * 7) % names.size();
    const auto map = maps.Load(wall.references[index]);
    if (map->z[0] != 2.0f + static_cast<float>(index)) ++wrong;
  });
  EXPECT_EQ(wrong, 0);
  // The last one used is still there, and the same object.
  EXPECT_EQ(maps.Load(wall.references[0]), maps.Load(wall.references[0]));
  // A map that was pushed out is read again: the file is gone by then.
  const auto kept = maps.Load(wall.references[5]);
  for (size_t i = 6; i < 12; ++i) maps.Load(wall.references[i]);
  std::filesystem::remove(wall.folder / "r5.npy");
  EXPECT_TRUE(FailsWithInputError([&] { maps.Load(wall.references[5]); }, {"r5.npy"}));
  EXPECT_EQ(kept->z[0], 7);
}

TEST(DepthFolder, AMapThatCannotBeReadKeepsNoOtherInTheCache) {
  const Wall wall({"a.jpg", "bad.jpg", "b.jpg", "c.jpg", "d.jpg"});
  for (size_t i = 0; i < wall.references.size(); ++i) {
    const std::string name = std::filesystem::path(wall.references[i].name).stem();
    WriteDepthFile(wall.folder / (name + ".npy"), wall.Map(i));
  }
  const auto bad = wall.folder / "bad.npy";
  const std::string whole = ReadFile(bad);
  WriteFile(bad, whole.substr(0, whole.size() / 2));
  const size_t bytes_per_map = size_t{64} * 48 * sizeof(float);
  const DepthFolder maps(wall.folder, {}, wall.references, 2 * bytes_per_map);
  EXPECT_TRUE(FailsWithInputError([&] { maps.Load(wall.references[1]); }, {"bad.npy"}));
  const std::weak_ptr<const DepthMap> first = maps.Load(wall.references[0]);
  EXPECT_FALSE(first.expired());
  maps.Load(wall.references[2]);
  maps.Load(wall.references[3]);
  EXPECT_TRUE(first.expired());
  // Nor is the failure kept.
  WriteFile(bad, whole);
  EXPECT_EQ(maps.Load(wall.references[1])->z[0], 3);
}

struct RealComparison {
  double median_relative = 0;
  double share_within_2_percent = 0;
  double share_lifted = 0;
};

// Points lifted from a folder of rgbd_small's depth maps against its mesh.
RealComparison CompareWithMesh(const std::filesystem::path& data, const std::string& spec) {
  const auto images = ReadColmapModel(data / "model_ref").PosedImages();
  const auto mesh = MakeGeometrySource("mesh:" + (data / "mesh.ply").string() +
                                       ",max_depth_jump=0.02,max_incidence_deg=70");
  const auto depth = MakeGeometrySource(spec, {.references = images});
  EXPECT_TRUE(depth.warnings.empty());
  Rng rng(1);
  std::vector<double> differences;
  size_t on_mesh = 0;
  for (const PosedImage& image : images) {
    const auto pixels = RandomPixels(image.camera, 500, rng);
    const auto expected = mesh.source->Lift(image, pixels);
    const auto lifted = depth.source->Lift(image, pixels);
    for (size_t i = 0; i < pixels.size(); ++i) {
      if (!expected[i]) continue;
      ++on_mesh;
      if (!lifted[i]) continue;
      differences.push_back(std::abs(lifted[i]->depth_z / expected[i]->depth_z - 1));
    }
  }
  std::sort(differences.begin(), differences.end());
  const auto close = std::lower_bound(differences.begin(), differences.end(), 0.02);
  const auto count = static_cast<double>(differences.size());
  return {differences[differences.size() / 2],
          static_cast<double>(close - differences.begin()) / count,
          count / static_cast<double>(on_mesh)};
}

// A plane whose 1/z grows with the column, stored by rows and by columns.
TEST(DepthSource, ReadsSamplesWhereTheSpecificationPutsThem) {
  const std::filesystem::path folder = TestFolder();
  const Camera camera = MakeCamera();
  const std::vector<PosedImage> references = {{"a.png", camera, {}}};
  std::vector<float> by_rows, by_columns;
  for (int y = 0; y < 480; ++y) {
    for (int x = 0; x < 640; ++x) by_rows.push_back(1 / (2.0f + 0.01f * static_cast<float>(x)));
  }
  for (int x = 0; x < 640; ++x) {
    for (int y = 0; y < 480; ++y) by_columns.push_back(1 / (2.0f + 0.01f * static_cast<float>(x)));
  }
  WriteDepthFile(folder / "rows" / "a.npy", FloatPlane(640, 480, by_rows));
  WriteDepthFile(folder / "columns" / "a.npy", FloatPlane(480, 640, by_columns));
  const Eigen::Vector2d pixel(100.5, 60.5);
  const auto inverse_z = [&](const std::string& name) {
    const NamedGeometry geometry =
        MakeGeometrySource("depth:" + (folder / name).string(), {.references = references});
    return 1 / geometry.source->Lift(references[0], {&pixel, 1})[0]->depth_z;
  };
  EXPECT_NEAR(inverse_z("rows"), 2 + 0.01 * 100, 1e-5);
  EXPECT_NEAR(inverse_z("columns,orientation=transposed"), 2 + 0.01 * 100, 1e-5);
  EXPECT_NEAR(inverse_z("rows,orientation=flipped_x"), 2 + 0.01 * 539, 1e-5);
  EXPECT_NEAR(inverse_z("rows,first_sample_px=0"), 2 + 0.01 * 100.5, 1e-5);
  EXPECT_NEAR(inverse_z("rows,first_sample_px=1"), 2 + 0.01 * 99.5, 1e-5);
}

TEST(DepthSource, SensorAndMonocularDepthOfARealRoomLieNearItsMesh) {
  const auto data = FindTestData("rgbd_small");
  if (!data) GTEST_SKIP() << "rgbd_small is not on this machine";
  const RealComparison sensor = CompareWithMesh(
      *data, "depth:" + (*data / "depth_sensor").string() + ",unit=mm,invalid=65535");
  // The mesh is fused from this very depth, in voxels of 1.5 cm.
  EXPECT_LT(sensor.median_relative, 0.005);
  EXPECT_GT(sensor.share_within_2_percent, 0.9);
  EXPECT_GT(sensor.share_lifted, 0.7);
  const RealComparison mono =
      CompareWithMesh(*data, "depth:" + (*data / "depth_mono_sim").string());
  // Simulated with scale errors of 10 %, and dense.
  EXPECT_LT(mono.median_relative, 0.15);
  EXPECT_GT(mono.share_lifted, 0.999);
  RecordProperty("sensor_median_relative", std::to_string(sensor.median_relative));
  RecordProperty("sensor_share_within_2_percent", std::to_string(sensor.share_within_2_percent));
  RecordProperty("sensor_share_lifted", std::to_string(sensor.share_lifted));
  RecordProperty("mono_median_relative", std::to_string(mono.median_relative));
}

}  // namespace
}  // namespace raylift
