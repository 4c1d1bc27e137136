// The traps of Cambridge Landmarks, Aachen Day-Night and Extended CMU Seasons.

#include "datasets/test_input.h"
#include "support/test_data.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/datasets/dataset.h"
#include "raylift/io/colmap_model.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr const char* kCambridgeHeader =
    "Visual Landmark Dataset V1\nImageFile, Camera Position [X Y Z W P Q R]\n\n";

// A quarter turn about y, world to camera: what lies along x of the world lies behind the camera.
TEST(Cambridge, RowsHoldTheCameraCenter) {
  const Layout layout = WriteCambridge(TestFolder(), RandomInput());
  const std::string half = "0.70710678118654757";
  WriteFile(layout.folder / "dataset_test.txt",
            std::string(kCambridgeHeader) + "seq2/frame00000.png 1 2 3 " + half + " 0 " + half +
                " 0\nseq2/frame00001.png 4 5 6 1 0 0 0\n");
  const ImportedScene scene = ImportDataset("cambridge", layout.folder).at(0);
  ASSERT_EQ(scene.ground_truth.size(), 2u);
  const Rigid3& turned = scene.ground_truth[0].cam_from_world;
  EXPECT_NEAR((turned.OriginInSource() - Eigen::Vector3d(1, 2, 3)).norm(), 0, 1e-12);
  EXPECT_NEAR((turned * Eigen::Vector3d(2, 2, 3) - Eigen::Vector3d(0, 0, -1)).norm(), 0, 1e-12);
  EXPECT_NEAR((turned.translation - Eigen::Vector3d(-3, -2, 1)).norm(), 0, 1e-12);
  // W of exactly 1 is no rotation.
  EXPECT_EQ(scene.ground_truth[1].cam_from_world.translation, Eigen::Vector3d(-4, -5, -6));
}

TEST(Cambridge, FocalLengthsAreThoseOfTheNvm) {
  const Layout layout = WriteCambridge(TestFolder(), RandomInput(6, 2));
  std::string nvm = ReadFile(layout.folder / "reconstruction.nvm");
  const size_t at = nvm.find("seq2/frame00001.jpg");
  nvm.replace(at, 19, "seq2/frame00009.jpg");
  const size_t distorted = nvm.rfind(" 0 0\n");
  nvm.replace(distorted, 5, " 0.1 0\n");
  WriteFile(layout.folder / "reconstruction.nvm", nvm);
  fs::remove(layout.folder / layout.references[0].name);
  const ImportedScene scene = ImportDataset("cambridge", layout.folder).at(0);
  EXPECT_EQ(scene.references.size(), 5u);
  EXPECT_NE(scene.references[0].camera, scene.references[1].camera);
  EXPECT_EQ(scene.queries.size(), 1u);
  EXPECT_EQ(scene.groups.at("seq2/frame00000.png"), "seq2");
  EXPECT_THAT(scene.warnings,
              ElementsAre(HasSubstr("does not hold its focal length (first: seq2/frame00001.png)"),
                          HasSubstr("photograph is missing (first: seq1/frame00000.png)")));
}

// VisualSFM's r brings the measured pixel m (in focal lengths from the center) to m (1 + r |m|^2);
// the row is `name f qw qx qy qz cx cy cz r 0` (ccwu.me/vsfm/doc.html#nvm). Up to the order of r^2
// the camera must put a point there.
TEST(Cambridge, VisualSfmsDistortionIsUndone) {
  LayoutInput input = RandomInput();
  input.width_px = 1920;
  input.height_px = 1080;
  const Layout layout = WriteCambridge(TestFolder(), input);
  std::string nvm = ReadFile(layout.folder / "reconstruction.nvm");
  const double r = 0.02;
  nvm.replace(nvm.find(" 0 0\n"), 5, " 0.02 0\n");
  WriteFile(layout.folder / "reconstruction.nvm", nvm);
  const ImportedScene scene = ImportDataset("cambridge", layout.folder).at(0);
  EXPECT_THAT(scene.warnings, IsEmpty());
  EXPECT_THAT(scene.notes, ElementsAre(HasSubstr("radial distortion r of 1 images")));
  const Camera& camera = scene.references[0].camera;
  const double focal_px = camera.focal_x_px();
  EXPECT_EQ(camera.model(), CameraModel::kSimpleRadial);
  const Eigen::Vector2d measured = Eigen::Vector2d(-900, 500) / focal_px;
  const Eigen::Vector2d undistorted = measured * (1 + r * measured.squaredNorm());
  const Eigen::Vector2d pixel = *camera.ImgFromCam(undistorted.homogeneous());
  const Eigen::Vector2d expected = focal_px * measured + Eigen::Vector2d(960, 540);
  EXPECT_LT((pixel - expected).norm(), 0.4);
  // Without it, or with the other sign, the corner would be pixels away.
  EXPECT_GT((focal_px * undistorted + Eigen::Vector2d(960, 540) - expected).norm(), 6);
}

TEST(Cambridge, WrongFilesAreNamed) {
  const Layout layout = WriteCambridge(TestFolder(), RandomInput());
  const auto fails = [&](const std::string& file, const std::string& text,
                         const std::vector<std::string>& parts) {
    const std::string before = ReadFile(layout.folder / file);
    WriteFile(layout.folder / file, text);
    const auto result =
        FailsWithInputError([&] { ImportDataset("cambridge", layout.folder); }, parts);
    WriteFile(layout.folder / file, before);
    return result;
  };
  const std::string train = "dataset_train.txt", nvm = "reconstruction.nvm";
  const std::string header = kCambridgeHeader;
  EXPECT_TRUE(fails(train, header + "a.png 1 2 3 1 0 0\n", {train, "line 4: quaternion"}));
  EXPECT_TRUE(fails(train, header + "a.png 1 2 x 1 0 0 0\n", {train, "line 4: camera position"}));
  EXPECT_TRUE(fails(train, header + "a.png 1 2 3 0 0 0 0\n", {train, "line 4: quaternion"}));
  EXPECT_TRUE(fails(train, header, {"no references are left"}));
  EXPECT_TRUE(fails(nvm, "NVM\n", {nvm, "NVM_V3"}));
  EXPECT_TRUE(fails(nvm, "NVM_V3\n\n2\na.jpg 50 1 0 0 0 1 2 3 0 0\n", {nvm, "expected 2 cameras"}));
  EXPECT_TRUE(fails(nvm, "NVM_V3\n\n1\na.jpg 0 1 0 0 0 1 2 3 0 0\n", {nvm, "focal length"}));
  fs::remove(layout.folder / nvm);
  EXPECT_TRUE(FailsWithInputError([&] { ImportDataset("cambridge", layout.folder); },
                                  {nvm, "give the camera"}));
}

TEST(Aachen, GroupsAreDayAndNight) {
  const Layout layout = WriteAachen(TestFolder(), RandomInput(6, 3));
  fs::remove(layout.images / layout.queries[1].name);
  const ImportedScene scene = ImportDataset("aachen", layout.folder).at(0);
  EXPECT_EQ(scene.queries.size(), 2u);
  EXPECT_EQ(scene.groups.at(layout.queries[0].name), "day");
  EXPECT_EQ(scene.groups.at(layout.queries[2].name), "night");
  EXPECT_EQ(scene.thresholds, "aachen");
  EXPECT_THAT(scene.ground_truth, IsEmpty());
  EXPECT_THAT(scene.notes, ElementsAre(HasSubstr("not public")));
  EXPECT_THAT(scene.warnings, ElementsAre(HasSubstr("1 image is skipped: the photograph")));
  // The model is used where it is.
  EXPECT_EQ(scene.reference_model, layout.folder / "3D-models" / "aachen_v_1_1");
  EXPECT_THAT(scene.references, IsEmpty());
}

TEST(Aachen, MissingPartsAreNamed) {
  const Layout layout = WriteAachen(TestFolder(), RandomInput());
  fs::remove(layout.folder / "queries" / "night_time_queries_with_intrinsics.txt");
  const ImportedScene by_day = ImportDataset("aachen", layout.folder).at(0);
  EXPECT_EQ(by_day.queries.size(), 1u);
  EXPECT_THAT(by_day.warnings, ElementsAre(HasSubstr("no queries of the night")));
  fs::remove(layout.folder / "queries" / "day_time_queries_with_intrinsics.txt");
  EXPECT_TRUE(FailsWithInputError([&] { ImportDataset("aachen", layout.folder); },
                                  {"no queries are left", "no queries of the day"}));
  fs::remove(layout.folder / "3D-models" / "aachen_v_1_1" / "images.bin");
  EXPECT_TRUE(FailsWithInputError([&] { ImportDataset("aachen", layout.folder); },
                                  {"3D-models/aachen_v_1_1", "cameras.bin"}));
}

TEST(Cmu, CamerasAndTimesFollowTheNames) {
  const Layout layout = WriteCmu(TestFolder(), RandomInput());
  const ImportedScene scene = ImportDataset("cmu", layout.folder).at(0);
  EXPECT_EQ(scene.name, "slice2");
  EXPECT_EQ(scene.folder, "slice2");
  EXPECT_EQ(scene.references[0].name, "img_00000_c0_1303398474000000us.jpg");
  EXPECT_NE(scene.references[0].camera, scene.references[1].camera);
  EXPECT_EQ(scene.references[0].camera, scene.references[2].camera);
  EXPECT_NEAR(scene.times.at(scene.references[1].name), 1303398475.0, 1e-6);
  EXPECT_EQ(scene.groups.at(scene.queries[0].name), "slice2");
  EXPECT_EQ(scene.thresholds, "cmu");
}

TEST(Cmu, ListsHoldTheCameraCenter) {
  const Layout layout = WriteCmu(TestFolder(), RandomInput());
  WriteFile(layout.folder / "slice2/camera-poses/a.txt",
            layout.queries[0].name + " 0 1 0 0 10 20 30\nelsewhere.jpg 1 0 0 0 1 2 3\n");
  fs::remove(layout.folder / "slice2/camera-poses/slice-2-day.txt");
  const ImportedScene scene = ImportDataset("cmu", layout.folder).at(0);
  ASSERT_EQ(scene.ground_truth.size(), 1u);
  // Half a turn about x.
  EXPECT_EQ(scene.ground_truth[0].cam_from_world.translation, Eigen::Vector3d(-10, 20, 30));
  EXPECT_THAT(scene.notes, ElementsAre("poses of 1 of 2 queries are public"));
}

TEST(Cmu, ASlicesModelIsUsedWhereItIs) {
  const Layout layout = WriteCmu(TestFolder(), RandomInput());
  ColmapModel model;
  for (const PosedImage& view : layout.references) {
    const auto id = static_cast<uint32_t>(model.images.size() + 1);
    model.cameras.emplace(id, view.camera);
    model.images[id].name = view.name;
    model.images[id].camera_id = id;
    model.images[id].SetCamFromWorld(view.cam_from_world);
  }
  const fs::path slice = layout.folder / "slice2";
  WriteColmapModel(slice / "sparse", model, ColmapForm::kBinary);
  const auto import = [&] { return ImportDataset("cmu", slice).at(0); };
  EXPECT_EQ(import().reference_model, slice / "sparse");
  EXPECT_EQ(import().geometries.at(0).spec, "sfm");
  EXPECT_EQ(import().times.size(), 8u);
  EXPECT_EQ(import().folder, "");
  EXPECT_THAT(import().warnings, IsEmpty());
  model.images[1].pose.tvec.x() += 1;
  WriteColmapModel(slice / "sparse", model, ColmapForm::kBinary);
  EXPECT_THAT(import().warnings, ElementsAre(HasSubstr("1 of 6 references are elsewhere")));
}

TEST(Cmu, EverySliceIsASceneInTheOrderOfTheNumbers) {
  const Layout layout = WriteCmu(TestFolder(), RandomInput());
  const fs::path slice = layout.folder / "slice10";
  fs::copy(layout.folder / "slice2", slice, fs::copy_options::recursive);
  fs::rename(slice / "test-images-slice2.txt", slice / "test-images-slice10.txt");
  fs::rename(slice / "ground-truth-database-images-slice2.txt",
             slice / "ground-truth-database-images-slice10.txt");
  const auto scenes = ImportDataset("cmu", layout.folder);
  ASSERT_EQ(scenes.size(), 2u);
  EXPECT_EQ(scenes[0].name, "slice2");
  EXPECT_EQ(scenes[1].name, "slice10");
  const fs::path out = layout.folder / "out";
  WriteImportedScene(out, scenes[1], "cmu");
  EXPECT_TRUE(fs::exists(out / "slice10/scene.toml"));
}

TEST(Cmu, WrongFilesAreNamed) {
  const Layout layout = WriteCmu(TestFolder(), RandomInput());
  const auto fails = [&](const std::vector<std::string>& parts) {
    return FailsWithInputError([&] { ImportDataset("cmu", layout.folder); }, parts);
  };
  const fs::path list = layout.folder / "slice2/test-images-slice2.txt";
  WriteFile(list, "img_00001_c7_1us.jpg\n");
  EXPECT_TRUE(fails({"intrinsics.txt", "no camera \"c7\"", "img_00001_c7_1us.jpg"}));
  WriteFile(list, "img.jpg\n");
  EXPECT_TRUE(fails({"intrinsics.txt", "\"img.jpg\""}));
  WriteFile(layout.folder / "intrinsics.txt", "c0 OPENCV 64 48 50\n");
  EXPECT_TRUE(fails({"intrinsics.txt: line 1"}));
  fs::remove(layout.folder / "slice2/ground-truth-database-images-slice2.txt");
  WriteFile(layout.folder / "intrinsics.txt", "c0 PINHOLE 64 48 50 50 32 24\n");
  EXPECT_TRUE(fails({"ground-truth-database-images-slice2.txt", "sparse/"}));
}

}  // namespace
}  // namespace raylift
