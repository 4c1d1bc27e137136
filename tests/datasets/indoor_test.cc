// The traps of 7-Scenes, 12 Scenes, TUM RGB-D and ScanNet.

#include "datasets/test_input.h"
#include "support/test_data.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/datasets/dataset.h"
#include "raylift/io/image_file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;

const std::string kInfinite =
    "-inf -inf -inf -inf\n-inf -inf -inf -inf\n-inf -inf -inf -inf\n"
    "-inf -inf -inf -inf\n";

std::vector<std::string> NamesOf(const std::vector<PosedImage>& images) {
  std::vector<std::string> names;
  for (const PosedImage& image : images) names.push_back(image.name);
  return names;
}

TEST(SevenScenes, GroupsAreSequencesAndThresholdsItsOwn) {
  const Layout layout = Write7Scenes(TestFolder() / "chess", RandomInput());
  const ImportedScene scene = ImportDataset("7scenes", layout.folder).at(0);
  EXPECT_EQ(scene.name, "chess");
  EXPECT_EQ(scene.thresholds, "7scenes");
  EXPECT_EQ(scene.groups.at(layout.queries[0].name), "seq-03");
  ASSERT_EQ(scene.geometries.size(), 1u);
  EXPECT_EQ(scene.geometries[0].spec, "depth:" + layout.folder.string() + ",preset=7scenes_sensor");
}

// The matrices of kapture_import_7scenes.py and of ACE's setup_7scenes.py: the photograph's pose is
// (published pose) * inverse(d_to_rgb).
TEST(SevenScenes, PosesAreMovedToTheColorCameraUnlessTheyAreWantedRaw) {
  const Layout layout = Write7Scenes(TestFolder() / "chess", RandomInput());
  const std::string row = "seq-01/frame-000000";
  WriteFile(layout.folder / (row + ".pose.txt"),
            "0 -1 0 1\n"
            "1 0 0 2\n"
            "0 0 1 3\n"
            "0 0 0 1\n");
  Eigen::Matrix4d d_to_rgb;
  d_to_rgb << 0.99996518012567637, 0.0026765126468950343, -0.0079041012313000904,
      -0.025558943178152542, -0.00274093112813167, 0.99996302803027592, -0.0081504520778013286,
      0.00010109636268061706, 0.0078819942130445332, 0.0081718328771890631, 0.99993554558014031,
      0.0020318321729487039, 0, 0, 0, 1;
  Eigen::Matrix4d published;
  published << 0, -1, 0, 1, 1, 0, 0, 2, 0, 0, 1, 3, 0, 0, 0, 1;
  const Eigen::Matrix4d expected = published * d_to_rgb.inverse();

  ImportOptions options;
  const ImportedScene color = ImportDataset("7scenes", layout.folder, options).at(0);
  const Rigid3 world_from_cam = color.references[0].cam_from_world.Inverse();
  // The matrix is printed with more digits than its rotation is orthogonal to.
  EXPECT_NEAR((world_from_cam.translation - expected.topRightCorner<3, 1>()).norm(), 0, 1e-6);
  EXPECT_NEAR((world_from_cam.rotation.toRotationMatrix() - expected.topLeftCorner<3, 3>()).norm(),
              0, 1e-6);
  EXPECT_THAT(color.notes, ElementsAre(HasSubstr("moved from the depth camera"),
                                       HasSubstr("registered into the photographs")));
  options.calibration = SensorCalibration::kRaw;
  const ImportedScene raw = ImportDataset("7scenes", layout.folder, options).at(0);
  EXPECT_TRUE(IsNearPose(raw.references[0].cam_from_world.Inverse(),
                         {Eigen::Quaterniond(published.topLeftCorner<3, 3>()), {1, 2, 3}}, 1e-9,
                         1e-9));
  EXPECT_THAT(raw.notes[0], HasSubstr("those of the depth camera"));
  EXPECT_NEAR((raw.references[0].cam_from_world.OriginInSource() -
               color.references[0].cam_from_world.OriginInSource())
                  .norm(),
              0.0256, 1e-4);
}

// Rows as in github.com/tsattler/visloc_pseudo_gt_limitations, pgt/sfm/7scenes.
TEST(SevenScenes, PseudoGroundTruthHasPosesAndFocalLengthsOfThePhotographs) {
  LayoutInput input = RandomInput(2, 1);
  input.width_px = 640;
  input.height_px = 480;
  const Layout layout = Write7Scenes(TestFolder() / "heads", input);
  const fs::path pgt = layout.folder / "pgt";
  const std::string pose = "0.806216 0.0204293 -0.55204 -0.211778 0.274901 0.044219 -0.258735";
  WriteFile(pgt / "heads_train.txt", "seq-01/frame-000000.color.png " + pose + " 527.745\n");
  WriteFile(pgt / "heads_test.txt", "seq-03/frame-000000.color.png " + pose + " 527.745\n");
  ImportOptions options;
  options.pseudo_ground_truth = pgt;
  const ImportedScene scene = ImportDataset("7scenes", layout.folder, options).at(0);
  ASSERT_EQ(scene.references.size(), 1u);
  EXPECT_EQ(scene.references[0].camera.ToString(), "SIMPLE_PINHOLE 640 480 527.745 320 240");
  EXPECT_EQ(scene.references[0].cam_from_world.translation,
            Eigen::Vector3d(0.274901, 0.044219, -0.258735));
  EXPECT_EQ(scene.queries.at(0).camera, scene.references[0].camera);
  EXPECT_THAT(scene.warnings, ElementsAre(HasSubstr("lack it (first: seq-02/frame-000001")));
  EXPECT_THAT(scene.notes[0], HasSubstr("heads_train.txt"));

  // pgt/dslam holds the data set's own poses in the same form.
  const Rigid3 own =
      ImportDataset("7scenes", layout.folder, {.calibration = SensorCalibration::kRaw})
          .at(0)
          .references[0]
          .cam_from_world;
  WritePoseFile(pgt / "heads_train.txt", {{"seq-01/frame-000000.color.png", own}});
  std::string row = ReadFile(pgt / "heads_train.txt");
  WriteFile(pgt / "heads_train.txt", row.substr(0, row.size() - 1) + " 525.0\n");
  EXPECT_THAT(ImportDataset("7scenes", layout.folder, options).at(0).warnings,
              Contains(HasSubstr("the data set's own poses")));

  const auto fails = [&](const std::string& text, const std::vector<std::string>& parts) {
    WriteFile(pgt / "heads_train.txt", text);
    return FailsWithInputError([&] { ImportDataset("7scenes", layout.folder, options); }, parts);
  };
  EXPECT_TRUE(fails("a " + pose + "\n", {"heads_train.txt: line 1: focal length"}));
  EXPECT_TRUE(fails("a " + pose + " 0\n", {"heads_train.txt: line 1: focal length", "positive"}));
  EXPECT_TRUE(fails("a 2 0 0 0 0 0 0 525\n", {"line 1: quaternion"}));
  EXPECT_TRUE(fails("a " + pose + " 525\na " + pose + " 525\n", {"line 2", "stands twice"}));
  options.pseudo_ground_truth = layout.folder;
  EXPECT_TRUE(FailsWithInputError([&] { ImportDataset("7scenes", layout.folder, options); },
                                  {"heads_train.txt"}));
}

TEST(SevenScenes, TheCameraIsThePublishedOne) {
  LayoutInput input = RandomInput(2, 1);
  input.width_px = 640;
  input.height_px = 480;
  const Layout layout = Write7Scenes(TestFolder(), input);
  const ImportedScene scene = ImportDataset("7scenes", layout.folder).at(0);
  EXPECT_EQ(scene.queries[0].camera.ToString(), "SIMPLE_PINHOLE 640 480 525 320 240");
}

TEST(SevenScenes, FramesWithoutPoseOrPhotographAreCounted) {
  const Layout layout = Write7Scenes(TestFolder(), RandomInput());
  WriteFile(layout.folder / "seq-01/frame-000002.pose.txt", kInfinite);
  fs::remove(layout.folder / "seq-01/frame-000004.color.png");
  const ImportedScene scene = ImportDataset("7scenes", layout.folder).at(0);
  EXPECT_EQ(scene.references.size(), 4u);
  EXPECT_THAT(scene.warnings, ElementsAre("1 image is skipped: the photograph is missing (first: "
                                          "seq-01/frame-000004.color.png)",
                                          "1 image is skipped: the pose is not finite (first: "
                                          "seq-01/frame-000002.color.png)"));
}

TEST(SevenScenes, WrongFilesAreNamed) {
  const Layout layout = Write7Scenes(TestFolder(), RandomInput());
  const auto fails = [&](const std::string& file, const std::string& text,
                         const std::vector<std::string>& parts) {
    const std::string before = ReadFile(layout.folder / file);
    WriteFile(layout.folder / file, text);
    const auto result =
        FailsWithInputError([&] { ImportDataset("7scenes", layout.folder); }, parts);
    WriteFile(layout.folder / file, before);
    return result;
  };
  const std::string pose = "seq-01/frame-000000.pose.txt";
  EXPECT_TRUE(fails(pose, "1 0 0 0\n", {pose, "expected 4 rows"}));
  EXPECT_TRUE(fails(pose, "1 0 0\n", {pose, "line 1: expected 4 numbers, found 3"}));
  EXPECT_TRUE(fails(pose, "1 0 0 x\n", {pose, "line 1: expected a number, found \"x\""}));
  EXPECT_TRUE(fails(pose, "2 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", {pose, "expected a rotation"}));
  EXPECT_TRUE(fails(pose, "1 0 0 0\n0 1 0 0\n0 0 -1 0\n0 0 0 1\n", {pose, "expected a rotation"}));
  EXPECT_TRUE(fails(pose, "1 0 0 0\n0 1 0 0\n0 0 1 0\n1 0 0 1\n", {pose, "expected a rotation"}));
  EXPECT_TRUE(fails("TestSplit.txt", "the last\n", {"TestSplit.txt", "line 1", "\"the last\""}));
  EXPECT_TRUE(fails("TestSplit.txt", "sequence9\n", {"seq-09", "no such folder"}));
  EXPECT_TRUE(fails("TestSplit.txt", "\n", {"no queries are left"}));
}

TEST(TwelveScenes, FramesWithInfinitePosesAreCounted) {
  const Layout layout = Write12Scenes(TestFolder(), RandomInput());
  const std::string row = "-1.#INF -1.#INF -1.#INF -1.#INF\n";
  WriteFile(layout.folder / "data/frame-000000.pose.txt", row + row + row + row);
  WriteFile(layout.folder / "data/frame-000003.pose.txt", kInfinite);
  const ImportedScene scene = ImportDataset("12scenes", layout.folder).at(0);
  EXPECT_EQ(scene.references.size(), 5u);
  EXPECT_EQ(scene.queries.size(), 1u);
  EXPECT_THAT(scene.warnings, ElementsAre("2 images are skipped: the pose is not finite (first: "
                                          "data/frame-000000.color.jpg)"));
  EXPECT_EQ(scene.geometries[0].spec, "depth:" + layout.folder.string() + ",preset=12scenes");
}

// pgt/sfm/12scenes of github.com/tsattler/visloc_pseudo_gt_limitations.
TEST(TwelveScenes, PseudoGroundTruthIsFoundByPlaceAndRoom) {
  LayoutInput input = RandomInput(2, 1);
  input.width_px = 648;
  input.height_px = 484;
  const fs::path folder = TestFolder(), pgt = folder / "pgt";
  const Layout layout = Write12Scenes(folder / "apt1" / "kitchen", input);
  WriteFile(pgt / "apt1_kitchen_test.txt",
            "data/frame-000000.color.jpg 0.398052 0.637407 0.5916 -0.29202 2.817093 2.562918 "
            "-0.871785 1167.8\n");
  WriteFile(pgt / "apt1_kitchen_train.txt",
            "data/frame-000001.color.jpg 0.397116 0.635827 0.593334 -0.293219 2.806906 2.568302 "
            "-0.884880 1167.8\n");
  ImportOptions options;
  options.pseudo_ground_truth = pgt;
  const ImportedScene scene = ImportDataset("12scenes", layout.folder, options).at(0);
  ASSERT_EQ(scene.references.size(), 1u);
  EXPECT_EQ(scene.references[0].name, "data/frame-000001.color.jpg");
  // Of photographs of half the size.
  EXPECT_EQ(scene.queries.at(0).camera.ToString(), "SIMPLE_PINHOLE 648 484 583.9 324 242");
  EXPECT_EQ(scene.ground_truth.at(0).cam_from_world.translation,
            Eigen::Vector3d(2.817093, 2.562918, -0.871785));
  EXPECT_THAT(scene.warnings, ElementsAre(HasSubstr("lack it (first: data/frame-000002")));
}

TEST(TwelveScenes, WrongFilesAreNamed) {
  const Layout layout = Write12Scenes(TestFolder(), RandomInput());
  const auto fails = [&](const std::string& file, const std::string& text,
                         const std::vector<std::string>& parts) {
    const std::string before = ReadFile(layout.folder / file);
    WriteFile(layout.folder / file, text);
    const auto result =
        FailsWithInputError([&] { ImportDataset("12scenes", layout.folder); }, parts);
    WriteFile(layout.folder / file, before);
    return result;
  };
  const std::string size = "m_colorWidth = 64\nm_colorHeight = 48\n";
  const std::string key = "m_calibrationColorIntrinsic";
  EXPECT_TRUE(fails("info.txt", size, {"info.txt", key, "missing"}));
  EXPECT_TRUE(fails("info.txt", size + key + " = 1 0 x", {"info.txt", key, "\"x\""}));
  EXPECT_TRUE(fails("info.txt", size + key + " = 1 0 2", {"info.txt", key, "expected 7 numbers"}));
  EXPECT_TRUE(fails("info.txt", key + " = 50 0 32 0 0 50 24 0", {"m_colorWidth", "missing"}));
  EXPECT_TRUE(fails("split.txt", "sequence0\n", {"split.txt", "line 1", "frames=N"}));
  EXPECT_TRUE(fails("split.txt", "a [frames=x]\n", {"split.txt", "line 1: frames"}));
}

TEST(Tum, TimesAreThoseOfThePhotographs) {
  const Layout layout = WriteTum(TestFolder(), RandomInput());
  ImportOptions options;
  options.query_every = layout.query_every;
  const ImportedScene scene = ImportDataset("tum", layout.folder, options).at(0);
  ASSERT_EQ(scene.times.size(), 7u);
  EXPECT_NEAR(scene.times.at(layout.queries[0].name), 1305031102.175304 + 1.5, 1e-6);
}

// Ground truth is measured at other times than photographs are taken.
TEST(Tum, PosesAreInterpolatedAcrossSmallGapsOnly) {
  const Layout layout = WriteTum(TestFolder(), RandomInput());
  WriteFile(layout.folder / "groundtruth.txt",
            "# timestamp tx ty tz qx qy qz qw\n"
            "1305031102.170000 1 0 0 0 0 0 1\n"
            "1305031102.180000 2 0 0 0 0 0.019998666693333084 0.99980000666657776\n"
            "1305031102.420000 nan nan nan 0 0 0 1\n"
            "1305031102.600000 5 0 0 0 0 0 1\n");
  ImportOptions options;
  options.query_every = 2;
  WriteFile(layout.folder / "rgb.txt",
            "1305031102.175000 rgb/1305031102.175304.png\n"
            "1305031102.182000 rgb/1305031102.425304.png\n"
            "1305031102.590000 rgb/1305031102.675304.png\n"
            "1305031102.610000 rgb/1305031102.925304.png\n"
            "1305031102.700000 rgb/1305031103.175304.png\n");
  const ImportedScene scene = ImportDataset("tum", layout.folder, options).at(0);
  // Between 0.17 and 0.18; 0.182 lies in a gap of 0.42 s, as does 0.59; 0.61 is near the end.
  ASSERT_EQ(scene.references.size(), 1u);
  const Rigid3 pose = scene.references[0].cam_from_world.Inverse();
  EXPECT_NEAR(pose.translation.x(), 1.5, 1e-4);
  EXPECT_NEAR(AngleBetweenDeg(pose.rotation, RotationFromVector({0, 0, 0.02})), 0, 2e-3);
  ASSERT_EQ(scene.ground_truth.size(), 1u);
  EXPECT_NEAR(scene.ground_truth[0].cam_from_world.OriginInSource().x(), 5, 1e-12);
  EXPECT_THAT(scene.warnings, ElementsAre(HasSubstr("3 images are skipped: groundtruth.txt has "
                                                    "no pose near its time")));
}

TEST(Tum, CamerasFollowTheFoldersName) {
  LayoutInput input = RandomInput(2, 1);
  input.width_px = 640;
  input.height_px = 480;
  const Layout layout = WriteTum(TestFolder(), input);
  ImportOptions options;
  options.query_every = 2;
  const auto camera = [&](const std::string& name) {
    const fs::path folder = layout.folder.parent_path() / name;
    fs::copy(layout.folder, folder, fs::copy_options::recursive);
    const ImportedScene scene = ImportDataset("tum", folder, options).at(0);
    EXPECT_EQ(scene.warnings.size(), name == "other" ? 1u : 0u);
    return scene.queries.at(0).camera.ToString();
  };
  // Published with pixel centers at whole numbers: half a pixel less than here.
  EXPECT_TRUE(camera("rgbd_dataset_freiburg1_desk")
                  .starts_with("FULL_OPENCV 640 480 517.306408 516.469215 319.14304 255.813989 "
                               "0.262383 -0.953104 -0.005358 0.002628 1.163314 0 0 0"));
  EXPECT_TRUE(camera("rgbd_dataset_freiburg2_desk").starts_with("FULL_OPENCV 640 480 520.90862"));
  EXPECT_EQ(camera("other"), "PINHOLE 640 480 525 525 320 240");
}

TEST(Tum, WrongLinesAreNamed) {
  const Layout layout = WriteTum(TestFolder(), RandomInput());
  const auto fails = [&](const std::string& text, const std::vector<std::string>& parts) {
    WriteFile(layout.folder / "groundtruth.txt", text);
    return FailsWithInputError([&] { ImportDataset("tum", layout.folder); }, parts);
  };
  EXPECT_TRUE(fails("1 2 3\n", {"groundtruth.txt: line 1", "found 3 tokens"}));
  EXPECT_TRUE(fails("1 2 3 4 0 0 0 x\n", {"line 1", "\"x\""}));
  EXPECT_TRUE(fails("1 2 3 4 0 0 0 0.5\n", {"line 1", "quaternion of length 1"}));
  EXPECT_TRUE(fails("1 2 3 4 0 0 0 1\n", {"0 frames", "no pose near its time (first: rgb/"}));
}

TEST(ScanNet, FramesAreInTheOrderOfTheirNumbers) {
  const Layout layout = WriteScanNet(TestFolder(), RandomInput(11, 1));
  WriteFile(layout.folder / "pose/3.txt", kInfinite);
  WriteFile(layout.folder / "scene0000_00_vh_clean_2.ply", "");
  fs::create_directories(layout.folder / "depth");
  ImportOptions options;
  options.query_every = 11;
  const ImportedScene scene = ImportDataset("scannet", layout.folder, options).at(0);
  EXPECT_THAT(
      NamesOf(scene.references),
      ElementsAre("color/0.jpg", "color/1.jpg", "color/2.jpg", "color/4.jpg", "color/5.jpg",
                  "color/6.jpg", "color/7.jpg", "color/8.jpg", "color/9.jpg", "color/10.jpg"));
  EXPECT_EQ(scene.queries.at(0).name, "color/11.jpg");
  EXPECT_THAT(scene.warnings, ElementsAre(HasSubstr("1 image is skipped: the pose is not finite")));
  ASSERT_EQ(scene.geometries.size(), 2u);
  EXPECT_EQ(scene.geometries[0].spec, "depth:" + layout.folder.string() + ",preset=scannet");
  EXPECT_EQ(scene.geometries[1].name, "mesh");
}

// saveToImages() of SensReader/c++/src/sensorData.h: files of six digits and _info.txt.
TEST(ScanNet, TheExportOfTheOtherReaderIsRead) {
  const fs::path parent = TestFolder(), folder = parent / "scene0001_00";
  const Layout layout = WriteScanNet(parent, RandomInput());
  for (size_t i = 0; i < 7; ++i) {
    const std::string stem = "frame-00000" + std::to_string(i);
    fs::create_directories(folder);
    fs::copy_file(layout.folder / "color" / (std::to_string(i) + ".jpg"),
                  folder / (stem + ".color.jpg"));
    fs::copy_file(layout.folder / "pose" / (std::to_string(i) + ".txt"),
                  folder / (stem + ".pose.txt"));
    WriteFile(folder / (stem + ".depth.pgm"), "");
  }
  WriteFile(folder / "_info.txt",
            "m_versionNumber = 4\nm_sensorName = StructureSensor\nm_colorWidth = 64\n"
            "m_colorHeight = 48\nm_depthWidth = 64\nm_depthHeight = 48\nm_depthShift = 1000\n"
            "m_calibrationColorIntrinsic = 57 0 31.6 0 0 58 23.2 0 0 0 1 0 0 0 0 1 \n"
            "m_calibrationColorExtrinsic = 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 \n"
            "m_frames.size = 7\n");
  ImportOptions options;
  options.query_every = 7;
  const ImportedScene scene = ImportDataset("scannet", folder, options).at(0);
  ASSERT_EQ(scene.references.size(), 6u);
  EXPECT_EQ(scene.references[0].name, "frame-000000.color.jpg");
  EXPECT_EQ(scene.references[0].camera, layout.references[0].camera);
  EXPECT_TRUE(IsNearPose(scene.references[5].cam_from_world, layout.references[5].cam_from_world,
                         1e-9, 1e-9));
  EXPECT_EQ(scene.queries.at(0).name, "frame-000006.color.jpg");
  EXPECT_EQ(scene.geometries.at(0).spec, "depth:" + folder.string() + ",preset=scannet");
  EXPECT_THAT(scene.warnings, testing::IsEmpty());
}

TEST(ScanNet, IntrinsicsOfAnotherSizeAreToldOf) {
  const Layout layout = WriteScanNet(TestFolder(), RandomInput());
  WriteFile(layout.folder / "intrinsic/intrinsic_color.txt",
            "1170.187988 0 647.75 0\n0 1170.187988 483.75 0\n0 0 1 0\n0 0 0 1\n");
  ImportOptions options;
  options.query_every = 2;
  EXPECT_THAT(ImportDataset("scannet", layout.folder, options).at(0).warnings,
              ElementsAre(HasSubstr("axis is at (648, 484) of 64 x 48")));
}

TEST(ScanNet, WrongIntrinsicsAreNamed) {
  const Layout layout = WriteScanNet(TestFolder(), RandomInput());
  const fs::path file = layout.folder / "intrinsic/intrinsic_color.txt";
  WriteFile(file, "-5 0 1 0\n0 5 1 0\n0 0 1 0\n0 0 0 1\n");
  EXPECT_TRUE(FailsWithInputError([&] { ImportDataset("scannet", layout.folder); },
                                  {"intrinsic_color.txt"}));
  WriteFile(file, kInfinite);
  EXPECT_TRUE(FailsWithInputError([&] { ImportDataset("scannet", layout.folder); },
                                  {"intrinsic_color.txt", "finite"}));
}

}  // namespace
}  // namespace raylift
