// The traps of ScanNet++, ETH3D and LaMAR: photographs of scenes that lasers have scanned.

#include "datasets/test_input.h"
#include "support/test_data.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/datasets/dataset.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

TEST(ScanNetPp, TheTelephonesFramesAreASecondScene) {
  const Layout layout = WriteScanNetPp(TestFolder() / "7b6477cb95", RandomInput(3, 2));
  const auto scenes = ImportDataset("scannetpp", layout.folder);
  ASSERT_EQ(scenes.size(), 2u);
  EXPECT_EQ(scenes[0].name, "7b6477cb95_dslr");
  EXPECT_THAT(scenes[0].warnings, IsEmpty());
  EXPECT_EQ(scenes[1].folder, "iphone");
  EXPECT_EQ(scenes[1].references.size(), 3u);
  ASSERT_EQ(scenes[1].queries.size(), 2u);
  EXPECT_EQ(scenes[1].queries[1].name, "frame_000010.jpg");
  EXPECT_EQ(scenes[1].queries[1].camera.model(), CameraModel::kOpenCv);
  EXPECT_EQ(scenes[1].images, layout.images);
  EXPECT_EQ(scenes[1].query_images, layout.folder / "iphone/rgb");
  EXPECT_TRUE(IsNearPose(scenes[1].ground_truth[1].cam_from_world, layout.queries[1].cam_from_world,
                         1e-9, 1e-9));
  for (const ImportedScene& scene : scenes) {
    ASSERT_EQ(scene.geometries.size(), 1u);
    EXPECT_EQ(scene.geometries[0].spec,
              "mesh:" + (layout.folder / "scans/mesh_aligned_0.05.ply").string());
  }
}

TEST(ScanNetPp, WhatIsMissingIsSaid) {
  const Layout layout = WriteScanNetPp(TestFolder(), RandomInput(3, 2));
  fs::remove(layout.images / layout.references[0].name);
  fs::remove_all(layout.folder / "iphone/rgb");
  fs::remove_all(layout.folder / "scans");
  const auto scenes = ImportDataset("scannetpp", layout.folder);
  ASSERT_EQ(scenes.size(), 1u);
  EXPECT_EQ(scenes[0].references.size(), 2u);
  EXPECT_THAT(scenes[0].warnings, ElementsAre(HasSubstr("mesh_aligned_0.05.ply is missing"),
                                              HasSubstr("1 image is skipped: the photograph is "
                                                        "missing (first: DSC01752.JPG)")));
  EXPECT_THAT(scenes[0].notes, ElementsAre(HasSubstr("rgb.mp4")));
  const auto fails = [&](const std::string& lists, const std::vector<std::string>& parts) {
    WriteFile(layout.folder / "dslr/train_test_lists.json", lists);
    return FailsWithInputError([&] { ImportDataset("scannetpp", layout.folder); }, parts);
  };
  EXPECT_TRUE(fails(R"({"train": []})", {"train_test_lists.json", "\"test\" is missing"}));
  EXPECT_TRUE(fails(R"({"train": [1], "test": []})", {"train[0]", "string"}));
  EXPECT_TRUE(fails(R"({"train": [], "test": ["DSC01755.JPG"]})", {"no references are left"}));
  EXPECT_TRUE(fails(R"({"train": ["DSC01753.JPG"], "test": []})", {"no queries are left"}));
  fs::remove_all(layout.folder / "dslr/colmap");
  EXPECT_TRUE(fails(R"({"train": [], "test": []})", {"colmap"}));
}

TEST(Eth3d, DepthMapsAreOfThePhotographsAsTheyWereTaken) {
  const Layout layout = WriteEth3d(TestFolder() / "courtyard", RandomInput());
  fs::create_directories(layout.folder / "ground_truth_depth/dslr_images");
  WriteFile(layout.folder / "occlusion/surface_mesh.ply", "");
  fs::create_directories(layout.folder / "dslr_scan_eval");
  const ImportOptions options{.query_every = layout.query_every};
  const ImportedScene taken = ImportDataset("eth3d", layout.folder, options).at(0);
  ASSERT_EQ(taken.geometries.size(), 2u);
  EXPECT_EQ(taken.geometries[0].spec,
            "mesh:" + (layout.folder / "occlusion/surface_mesh.ply").string());
  EXPECT_EQ(taken.geometries[1].spec, "depth:" + layout.folder.string() + ",preset=eth3d");
  EXPECT_THAT(taken.notes, ElementsAre(HasSubstr("scan_alignment.mlp")));

  // Those that were undistorted beforehand, alone.
  fs::rename(layout.folder / "dslr_calibration_jpg",
             layout.folder / "dslr_calibration_undistorted");
  const ImportedScene undistorted = ImportDataset("eth3d", layout.folder, options).at(0);
  EXPECT_EQ(undistorted.references.size(), taken.references.size());
  EXPECT_EQ(undistorted.geometries.size(), 1u);
  EXPECT_THAT(undistorted.notes, Contains(HasSubstr("ground_truth_depth is left out")));
}

TEST(Eth3d, TheCalibrationWithPhotographsIsTaken) {
  const Layout layout = WriteEth3d(TestFolder(), RandomInput());
  fs::copy(layout.folder / "dslr_calibration_jpg", layout.folder / "dslr_calibration_undistorted");
  const ImportOptions options{.query_every = 2};
  EXPECT_THAT(ImportDataset("eth3d", layout.folder, options).at(0).warnings, IsEmpty());
  fs::remove(layout.images / layout.references[0].name);
  EXPECT_THAT(ImportDataset("eth3d", layout.folder, options).at(0).warnings,
              ElementsAre(HasSubstr("the photograph is missing")));
  fs::remove_all(layout.images);
  EXPECT_TRUE(FailsWithInputError([&] { ImportDataset("eth3d", layout.folder, options); },
                                  {"dslr_calibration", "0 frames", "the photograph is missing"}));
  fs::remove_all(layout.folder / "dslr_calibration_jpg");
  fs::remove_all(layout.folder / "dslr_calibration_undistorted");
  EXPECT_TRUE(FailsWithInputError([&] { ImportDataset("eth3d", layout.folder, options); },
                                  {"dslr_calibration_jpg or dslr_calibration_undistorted"}));
}

class LamarSession : public ::testing::Test {
 protected:
  ImportedScene Import() const { return ImportDataset("lamar", layout_.folder).at(0); }

  Layout layout_ = WriteLamar(TestFolder() / "HGE", RandomInput(3, 3));
  fs::path map_ = layout_.folder / "sessions/map";
  fs::path query_ = layout_.folder / "sessions/query_val_phone";
};

TEST_F(LamarSession, IsAScene) {
  const ImportedScene scene = Import();
  EXPECT_EQ(scene.name, "HGE_query_val_phone");
  EXPECT_EQ(scene.folder, "query_val_phone");
  EXPECT_THAT(scene.notes, ElementsAre("all images of the session are queries",
                                       HasSubstr("the map has no mesh")));
  EXPECT_NEAR(scene.times.at(layout_.queries[1].name), 1638000000.04, 1e-6);
}

// Poses are sensor to world, those in rigs.txt sensor to rig (CAPTURE.md): kapture's the other way
// round. The camera at (1, 2, 3) looks along the world's x axis.
TEST_F(LamarSession, PosesAreOfTheSensorInTheWorld) {
  WriteFile(query_ / "trajectories.txt",
            "# timestamp, device_id, qw, qx, qy, qz, tx, ty, tz, *covar\n"
            "1638000000000000, ios_0/cam, 0.5, -0.5, 0.5, -0.5, 1, 2, 3, 0.1, 0.2\n");
  const ImportedScene scene = Import();
  ASSERT_EQ(scene.ground_truth.size(), 1u);
  const Rigid3 world_from_cam = scene.ground_truth[0].cam_from_world.Inverse();
  EXPECT_EQ(world_from_cam.translation, Eigen::Vector3d(1, 2, 3));
  EXPECT_NEAR(
      (world_from_cam.rotation * Eigen::Vector3d::UnitZ() - Eigen::Vector3d::UnitX()).norm(), 0,
      1e-12);
  EXPECT_THAT(scene.notes, Contains("poses of 1 of 3 queries are public"));

  // Where a session was aligned to the map, its own poses are of another world.
  WriteFile(query_ / "proc/alignment_trajectories.txt",
            "1638000000000000, ios_0/cam, 1, 0, 0, 0, 4, 5, 6\n");
  EXPECT_EQ(Import().ground_truth.at(0).cam_from_world.OriginInSource(), Eigen::Vector3d(4, 5, 6));
}

TEST_F(LamarSession, AListSaysWhichImagesAreQueries) {
  WriteFile(query_ / "proc/queries.txt", "1638000000040000, ios_1/cam\n");
  const ImportedScene scene = Import();
  ASSERT_EQ(scene.queries.size(), 1u);
  EXPECT_EQ(scene.queries[0].name, layout_.queries[1].name);
  EXPECT_THAT(scene.notes, Contains(HasSubstr("proc/queries.txt")));
  // A rig stands for its cameras.
  WriteFile(query_ / "rigs.txt", "rig, ios_2/cam, 1, 0, 0, 0, 0, 0, 0\n");
  WriteFile(query_ / "queries.txt", "1638000000080000, rig\n");
  EXPECT_EQ(Import().queries.at(0).name, layout_.queries[2].name);
  WriteFile(query_ / "queries.txt", "now, rig\n");
  EXPECT_TRUE(FailsWithInputError([&] { Import(); }, {"queries.txt: line 1", "timestamp"}));
}

TEST_F(LamarSession, MeshesOfTheMapAreGeometries) {
  WriteFile(map_ / "proc/meshes/mesh_simplified.ply", "");
  const ImportedScene scene = Import();
  ASSERT_EQ(scene.geometries.size(), 1u);
  EXPECT_EQ(scene.geometries[0].name, "mesh_simplified");
}

TEST_F(LamarSession, WhatIsMissingIsSaid) {
  fs::remove(layout_.images / layout_.references[0].name);
  const std::string text = ReadFile(map_ / "trajectories.txt");
  WriteFile(map_ / "trajectories.txt", text.substr(0, text.rfind("1638000000080000")));
  const ImportedScene scene = Import();
  EXPECT_EQ(scene.references.size(), 1u);
  EXPECT_THAT(scene.warnings,
              ElementsAre(HasSubstr("1 image is skipped: the photograph is missing"),
                          HasSubstr("1 image is skipped: it has no pose")));
  fs::rename(query_, layout_.folder / "sessions/other");
  EXPECT_TRUE(FailsWithInputError([&] { Import(); }, {"sessions", "begins with query"}));
  fs::remove_all(layout_.folder / "sessions");
  EXPECT_TRUE(FailsWithInputError([&] { Import(); }, {"sessions", "no such folder"}));
}

}  // namespace
}  // namespace raylift
