// The traps of transforms.json.

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
using testing::ElementsAre;
using testing::HasSubstr;

constexpr const char* kIdentity = "[[1,0,0,1], [0,1,0,2], [0,0,1,3], [0,0,0,1]]";

class Nerfstudio : public ::testing::Test {
 protected:
  const fs::path folder_ = TestFolder();

  Nerfstudio() {
    for (const char* name : {"images/a.png", "images/b.png", "images/c.png"}) {
      WriteImage(folder_ / name, {64, 48, 1, std::vector<uint8_t>(size_t{64} * 48, 90)});
    }
  }

  // `all` and `frame` are members with a comma after each.
  ImportedScene Import(const std::string& all, const std::string& frame,
                       const std::string& matrix = kIdentity) const {
    std::string text = "{" + all + "\"frames\": [";
    for (const char* name : {"b", "a", "c"}) {
      text += std::string(name[0] == 'b' ? "" : ",") + "{" + frame + "\"file_path\": \"images/" +
              name + ".png\", \"transform_matrix\": " + (name[0] == 'a' ? matrix : kIdentity) + "}";
    }
    WriteFile(folder_ / "transforms.json", text + "]}");
    ImportOptions options;
    options.query_every = 2;
    return ImportDataset("nerfstudio", folder_, options).at(0);
  }
  ::testing::AssertionResult Fails(const std::string& all, const std::string& frame,
                                   const std::string& matrix,
                                   const std::vector<std::string>& parts) const {
    return FailsWithInputError([&] { Import(all, frame, matrix); }, parts);
  }
};

TEST_F(Nerfstudio, CamerasLookAlongMinusZ) {
  const ImportedScene scene = Import("\"fl_x\": 50,", "");
  ASSERT_EQ(scene.references.size(), 2u);
  const Rigid3& pose = scene.references[0].cam_from_world;
  EXPECT_EQ(scene.references[0].name, "images/a.png");
  EXPECT_NEAR((pose.OriginInSource() - Eigen::Vector3d(1, 2, 3)).norm(), 0, 1e-12);
  // In front of the camera, and above its axis.
  EXPECT_NEAR((pose * Eigen::Vector3d(1, 3, -2) - Eigen::Vector3d(0, -1, 5)).norm(), 0, 1e-12);
}

TEST_F(Nerfstudio, SplitsAreThoseOfTheFile) {
  EXPECT_EQ(Import("\"fl_x\": 50,", "").queries.at(0).name, "images/b.png");
  const ImportedScene scene = Import("\"fl_x\": 50, \"test_filenames\": [\"./images/c.png\"],", "");
  ASSERT_EQ(scene.queries.size(), 1u);
  EXPECT_EQ(scene.queries[0].name, "images/c.png");
  EXPECT_EQ(scene.references.size(), 2u);
  EXPECT_EQ(Import("\"fl_x\": 50, \"val_filenames\": [\"images/a.png\"],", "").queries.at(0).name,
            "images/a.png");
}

TEST_F(Nerfstudio, CameraModels) {
  const auto camera = [&](const std::string& all, const std::string& frame = "") {
    return Import(all, frame).queries.at(0).camera.ToString();
  };
  EXPECT_EQ(camera("\"fl_x\": 50,"), "PINHOLE 64 48 50 50 32 24");
  EXPECT_EQ(camera("\"fl_x\": 50,", "\"fl_x\": 60, \"cy\": 25,"), "PINHOLE 64 48 60 60 32 25");
  EXPECT_TRUE(camera("\"camera_angle_x\": 1.0,").starts_with("PINHOLE 64 48 58.57"));
  EXPECT_EQ(
      camera("\"camera_model\": \"OPENCV_FISHEYE\", \"fl_x\": 50, \"k1\": 0.01, \"k4\": 2e-4,"),
      "OPENCV_FISHEYE 64 48 50 50 32 24 0.01 0 0 2e-04");
  EXPECT_EQ(camera("\"fl_x\": 50, \"k1\": 0.01, \"k3\": 0.001,"),
            "FULL_OPENCV 64 48 50 50 32 24 0.01 0 0 0 0.001 0 0 0");
}

TEST_F(Nerfstudio, FramesWithoutAPoseAreCounted) {
  const ImportedScene scene =
      Import("\"fl_x\": 50,", "", "[[null,0,0,1], [0,1,0,2], [0,0,1,3], [0,0,0,1]]");
  EXPECT_EQ(scene.references.size() + scene.queries.size(), 2u);
  EXPECT_THAT(scene.warnings, ElementsAre(HasSubstr("1 image is skipped: the pose is not finite "
                                                    "(first: images/a.png)")));
}

TEST_F(Nerfstudio, DepthMapsAreAGeometryOfTheScenesUnits) {
  WriteFile(folder_ / "transforms.json", "{}");
  const std::string start = "{\"file_path\": \"images/";
  std::string frames;
  for (const std::string name : {"a", "b"}) {
    if (!frames.empty()) frames += ',';
    frames += start;
    frames += name + ".png\", \"depth_file_path\": \"./depth/" + name;
    frames += std::string(".png\", \"transform_matrix\": ") + kIdentity + "}";
  }
  WriteFile(folder_ / "transforms.json",
            "{\"fl_x\": 50, \"applied_scale\": 0.5, \"frames\": [" + frames + "]}");
  ImportOptions options;
  options.query_every = 2;
  const ImportedScene scene =
      ImportDataset("nerfstudio", folder_ / "transforms.json", options).at(0);
  ASSERT_EQ(scene.geometries.size(), 1u);
  EXPECT_EQ(scene.geometries[0].spec,
            "depth:" + folder_.string() + ",pattern=depth/{stem}.png,unit=0.002");
  EXPECT_NEAR(
      (scene.references[0].cam_from_world.OriginInSource() - Eigen::Vector3d(2, 4, 6)).norm(), 0,
      1e-12);
}

TEST_F(Nerfstudio, WrongMembersAreNamed) {
  const std::string fl = "\"fl_x\": 50,";
  EXPECT_TRUE(Fails("", "", kIdentity, {"transforms.json", "frames[0]", "fl_x"}));
  EXPECT_TRUE(Fails("\"fl_x\": -1,", "", kIdentity, {"frames[0]", "focal"}));
  EXPECT_TRUE(Fails(fl + "\"camera_model\": \"EQUIRECTANGULAR\",", "", kIdentity,
                    {"camera_model", "EQUIRECTANGULAR"}));
  EXPECT_TRUE(Fails(fl + "\"w\": 1e9,", "", kIdentity, {"frames[0]", "w, h"}));
  EXPECT_TRUE(Fails(fl, "", "[[1,0,0,1]]", {"frames[1].transform_matrix", "3 or 4 rows"}));
  EXPECT_TRUE(Fails(fl, "", "[[1,0,0], [0,1,0], [0,0,1]]", {"frames[1].transform_matrix[0]"}));
  EXPECT_TRUE(Fails(fl, "", "[[2,0,0,1], [0,1,0,2], [0,0,1,3]]", {"transform_matrix", "rotation"}));
  EXPECT_TRUE(Fails(fl + "\"applied_scale\": 0,", "", kIdentity, {"applied_scale", "positive"}));
  EXPECT_TRUE(Fails(fl + "\"applied_transform\": 3,", "", kIdentity, {"applied_transform"}));
  const fs::path file = folder_ / "transforms.json";
  const auto fails = [&](const std::string& text, const std::vector<std::string>& parts) {
    WriteFile(file, text);
    return FailsWithInputError([&] { ImportDataset("nerfstudio", folder_); }, parts);
  };
  EXPECT_TRUE(fails("{", {"transforms.json", "parse error"}));
  EXPECT_TRUE(fails("{}", {"transforms.json", "\"frames\" is missing"}));
  EXPECT_TRUE(fails("{\"frames\": [{}]}", {"frames[0]", "\"file_path\" is missing"}));
  const std::string outside = "{\"frames\": [{\"file_path\": \"../a.png\"}]}";
  EXPECT_TRUE(fails(outside, {"frames[0].file_path", "below the folder"}));
}

}  // namespace
}  // namespace raylift
