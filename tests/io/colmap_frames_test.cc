// Rigs and frames: COLMAP poses the images by them.
#include "io/colmap_test_models.h"
#include "support/test_data.h"
#include <fmt/format.h>
#include <gmock/gmock.h>

#include "raylift/base/file.h"
#include "raylift/io/colmap_model.h"

namespace raylift {
namespace {

// Images 5 and 9 are the two cameras of a rig at one moment, image 1 is alone.
struct RigScene {
  ColmapModel model;
  Rigid3 rig_from_world;
  Rigid3 second_from_rig;
};

RigScene MakeRigScene(Rng& rng) {
  RigScene scene{SmallColmapModel(rng), RandomRigid3(rng, 5), RandomRigid3(rng, 1)};
  ColmapModel& model = scene.model;
  model.cameras[8] = model.cameras[7];
  model.images[9].camera_id = 8;
  model.rigs[3] = {ColmapSensor{0, 7},
                   {{{0, 8}, ColmapPose::Of(scene.second_from_rig)}, {{1, 4}, {}}}};
  model.rigs[1] = {ColmapSensor{0, 2}, {}};
  model.frames[6] = {
      3, ColmapPose::Of(scene.rig_from_world), {{{0, 7}, 5}, {{0, 8}, 9}, {{1, 4}, 77}}};
  model.frames[2] = {1, ColmapPose::Of(model.images[1].CamFromWorld()), {{{0, 2}, 1}}};
  model.rig_order = {3, 1};
  model.frame_order = {6, 2};
  model.images[5].SetCamFromWorld(scene.rig_from_world);
  model.images[9].SetCamFromWorld(scene.second_from_rig * scene.rig_from_world);
  return scene;
}

TEST(ColmapFrames, ConsistentModelsSurviveBothForms) {
  Rng rng = TestRng();
  const auto folder = TestFolder();
  const RigScene scene = MakeRigScene(rng);
  WriteColmapModel(folder / "a", scene.model, ColmapForm::kBinary);
  const ColmapModel model = ReadColmapModel(folder / "a");
  EXPECT_TRUE(model.warnings.empty());
  WriteColmapModel(folder / "text", model, ColmapForm::kText);
  WriteColmapModel(folder / "b", ReadColmapModel(folder / "text"), ColmapForm::kBinary);
  for (const char* name : {"cameras", "images", "points3D", "rigs", "frames"}) {
    const std::string file = std::string(name) + ".bin";
    EXPECT_EQ(ReadFile(folder / "a" / file), ReadFile(folder / "b" / file)) << file;
  }
}

// The layout as COLMAP's reconstruction_io_binary.cc writes it, packed here by python.
TEST(ColmapFrames, FilesPackedByPythonAreRead) {
  if (!HasProgram("/usr/bin/python3")) GTEST_SKIP() << "python3 is not installed";
  const auto folder = TestFolder();
  WriteFile(folder / "write.py", R"(
import struct, sys, os
os.chdir(sys.argv[1])
pose = lambda *p: struct.pack('<7d', *p)
open('cameras.bin', 'wb').write(struct.pack('<QIiQQ4d', 1, 1, 1, 4, 3, 5, 6, 2, 1.5))
open('images.bin', 'wb').write(struct.pack('<Q', 2)
    + struct.pack('<I', 1) + pose(1, 0, 0, 0, 1, 2, 3) + struct.pack('<I', 1) + b'a\0' + struct.pack('<Q', 0)
    + struct.pack('<I', 2) + pose(1, 0, 0, 0, 0, 0, 0) + struct.pack('<I', 1) + b'b\0' + struct.pack('<Q', 0))
open('points3D.bin', 'wb').write(struct.pack('<Q', 0))
open('rigs.bin', 'wb').write(struct.pack('<QIIiI', 1, 1, 2, 0, 1) + struct.pack('<iIB', 0, 2, 1) + pose(0, 1, 0, 0, 10, 0, 0))
open('frames.bin', 'wb').write(struct.pack('<QII', 1, 1, 1) + pose(1, 0, 0, 0, 1, 2, 3)
    + struct.pack('<IiIQiIQ', 2, 0, 1, 1, 0, 2, 2))
)");
  RunProgram("/usr/bin/python3 " + (folder / "write.py").string() + " " + folder.string());
  const ColmapModel model = ReadColmapModel(folder);
  // Half a turn about x, then the shift: (1, 2, 3) -> (1, -2, -3) -> (11, -2, -3).
  const Rigid3 expected{Eigen::Quaterniond(0, 1, 0, 0), {11, -2, -3}};
  EXPECT_TRUE(IsNearPose(model.images.at(2).CamFromWorld(), expected, 1e-12, 1e-12));
  EXPECT_EQ(model.images.at(1).pose.tvec, Eigen::Vector3d(1, 2, 3));
  ASSERT_EQ(model.warnings.size(), 1u);
  EXPECT_THAT(model.warnings[0], testing::HasSubstr("poses of 1 of 2 images differ"));
  EXPECT_THAT(model.warnings[0], testing::HasSubstr("is 11 (\"b\")"));
}

TEST(ColmapFrames, TextOfColmapIsRead) {
  const auto folder = TestFolder();
  WriteFile(folder / "cameras.txt", "1 PINHOLE 4 3 5 6 2 1.5\n");
  WriteFile(folder / "images.txt", "1 1 0 0 0 0 0 0 1 a\n\n2 1 0 0 0 1 0 0 1 b\n\n");
  WriteFile(folder / "rigs.txt",
            "# Rig calib list with one line of data per calib:\n"
            "1 2 CAMERA 1 CAMERA 2 1 1 0 0 0 1 0 0\n2 2 CAMERA 5 IMU 6 0\n");
  WriteFile(folder / "frames.txt", "1 1 1 0 0 0 0 0 0 2 CAMERA 1 1 CAMERA 2 2\n");
  const ColmapModel model = ReadColmapModel(folder);
  EXPECT_TRUE(model.warnings.empty()) << model.warnings.front();
  EXPECT_EQ(model.rigs.at(1).sensors[0].first, (ColmapSensor{0, 2}));
  EXPECT_EQ(model.rigs.at(2).sensors[0].first, (ColmapSensor{1, 6}));
  EXPECT_FALSE(model.rigs.at(2).sensors[0].second);
}

TEST(ColmapFrames, ImagesWithoutFrameKeepTheirPoseWithAWarning) {
  Rng rng = TestRng();
  const auto folder = TestFolder();
  RigScene scene = MakeRigScene(rng);
  scene.model.frames.erase(2);
  WriteColmapModel(folder, scene.model, ColmapForm::kBinary);
  const ColmapModel model = ReadColmapModel(folder);
  EXPECT_EQ(model.images.at(1).pose.qvec_wxyz, scene.model.images.at(1).pose.qvec_wxyz);
  ASSERT_EQ(model.warnings.size(), 1u);
  EXPECT_THAT(model.warnings[0], testing::HasSubstr("1 of 3 images have no frame"));
}

TEST(ColmapFrames, WrongReferencesAreNamed) {
  Rng rng = TestRng();
  const auto folder = TestFolder();
  const RigScene scene = MakeRigScene(rng);
  ColmapModel model = scene.model;
  model.frames[6].rig_id = 99;
  WriteColmapModel(folder, model, ColmapForm::kText);
  EXPECT_TRUE(FailsWithInputError([&] { ReadColmapModel(folder); },
                                  {"frames.txt: frame 6: refers to rig 99"}));
  model = scene.model;
  model.frames[6].data[1].sensor.id = 55;
  WriteColmapModel(folder, model, ColmapForm::kText);
  EXPECT_TRUE(FailsWithInputError([&] { ReadColmapModel(folder); },
                                  {"frames.txt: frame 6: sensor 55 of type 0 is not in its rig"}));
}

TEST(ColmapFrames, ModelsWithoutFramesRemoveStaleFrames) {
  Rng rng = TestRng();
  const auto folder = TestFolder();
  RigScene scene = MakeRigScene(rng);
  WriteColmapModel(folder, scene.model, ColmapForm::kBinary);
  scene.model.frames.clear();
  WriteColmapModel(folder, scene.model, ColmapForm::kBinary);
  EXPECT_FALSE(std::filesystem::exists(folder / "frames.bin"));
  EXPECT_FALSE(std::filesystem::exists(folder / "rigs.bin"));
}

}  // namespace
}  // namespace raylift
