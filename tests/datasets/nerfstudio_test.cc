// The traps of transforms.json.

#include "datasets/test_input.h"
#include "support/test_data.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/datasets/dataset.h"
#include "raylift/io/depth_file.h"
#include "raylift/io/image_file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

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
  for (const std::string model : {"SIMPLE_RADIAL", "RADIAL"}) {
    EXPECT_EQ(camera("\"camera_model\": \"" + model + "\", \"fl_x\": 50, \"k1\": 0.01,"),
              "OPENCV 64 48 50 50 32 24 0.01 0 0 0");
  }
  // metashape_to_json() of nerfstudio/process_data/metashape_utils.py for spherical sensors.
  EXPECT_EQ(camera("\"camera_model\": \"EQUIRECTANGULAR\", \"w\": 64, \"h\": 48, \"fl_x\": 32, "
                   "\"fl_y\": 48, \"cx\": 32, \"cy\": 24,"),
            "EQUIRECTANGULAR 64 48 64 48");
  EXPECT_EQ(camera("\"fl_x\": 50, \"camera_angle_y\": 1.0,").substr(0, 28),
            "PINHOLE 64 48 50 43.93170532");
}

// instant-ngp's src/nerf_loader.cu, read_lens() and read_focal_length(); scripts/colmap2nerf.py
// writes is_fisheye.
TEST_F(Nerfstudio, LensesOfInstantNgp) {
  const auto camera = [&](const std::string& all) {
    return Import(all, "").queries.at(0).camera.ToString();
  };
  const std::string lens = "\"fl_x\": 50, \"k1\": 0.01, \"k2\": 0.02, \"k3\": 0.03, \"k4\": 0.04,";
  EXPECT_EQ(camera(lens + "\"is_fisheye\": true,"),
            "OPENCV_FISHEYE 64 48 50 50 32 24 0.01 0.02 0.03 0.04");
  EXPECT_EQ(camera("\"fl_x\": 50, \"k1\": 0.01, \"is_fisheye\": false,"),
            "OPENCV 64 48 50 50 32 24 0.01 0 0 0");
  EXPECT_TRUE(camera("\"x_fov\": 90,").starts_with("PINHOLE 64 48 32.00000"));
  EXPECT_TRUE(Fails(lens + "\"is_fisheye\": true, \"camera_model\": \"OPENCV\",", "", kIdentity,
                    {"frames[0]", "is_fisheye", "OPENCV"}));
  EXPECT_TRUE(Fails(lens + "\"is_fisheye\": 1,", "", kIdentity, {"is_fisheye", "true or false"}));
  for (const std::string key : {"ftheta_p0", "latlong", "equirectangular", "orthographic"}) {
    EXPECT_TRUE(Fails("\"fl_x\": 50, \"" + key + "\": 1,", "", kIdentity, {"frames[0]", key}));
  }
}

// get_distortion_params() of nerfstudio/cameras/camera_utils.py: k1 k2 k3 k4 p1 p2; FISHEYE624's 12
// are those of fisheye624_project() there.
TEST_F(Nerfstudio, DistortionParamsStandForTheSingleOnes) {
  const auto camera = [&](const std::string& all) {
    return Import(all, "").queries.at(0).camera.ToString();
  };
  const std::string model = "\"fl_x\": 50, \"camera_model\": ";
  EXPECT_EQ(camera("\"fl_x\": 50, \"distortion_params\": [0.01, 0.02, 0, 0, 0.003, 0.004],"),
            "OPENCV 64 48 50 50 32 24 0.01 0.02 0.003 0.004");
  EXPECT_EQ(camera(model + "\"OPENCV_FISHEYE\", \"distortion_params\": [0.01, 0.02, 0.03, 0.04, 0, "
                           "0],"),
            "OPENCV_FISHEYE 64 48 50 50 32 24 0.01 0.02 0.03 0.04");
  EXPECT_EQ(camera(model + "\"OPENCV_FISHEYE\", \"distortion_params\": [0.01, 0.02, 0.03, 0.04, "
                           "0.005, 0.006],"),
            "THIN_PRISM_FISHEYE 64 48 50 50 32 24 0.01 0.02 0.005 0.006 0.03 0.04 0 0");
  EXPECT_EQ(camera(model + "\"FISHEYE624\", \"distortion_params\": [0.01, 0.02, 0.03, 0.04, 0.05, "
                           "0.06, 0.007, 0.008, 0.0001, 0.0002, 0.0003, 0.0004],"),
            "RAD_TAN_THIN_PRISM_FISHEYE 64 48 50 50 32 24 0.01 0.02 0.03 0.04 0.05 0.06 0.007 "
            "0.008 1e-04 2e-04 3e-04 4e-04");
  EXPECT_TRUE(Fails("\"fl_x\": 50, \"distortion_params\": [1, 2],", "", kIdentity,
                    {"distortion_params", "found 2"}));
  EXPECT_TRUE(Fails(model + "\"FISHEYE624\",", "", kIdentity, {"frames[0]", "FISHEYE624"}));
}

// radial_and_tangential_undistort() there: 1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8, as Metashape's.
TEST_F(Nerfstudio, TheFourthRadialTermMultipliesTheEighthPower) {
  const Camera camera =
      Import(
          "\"w\": 6000, \"h\": 4000, \"fl_x\": 4100, \"cx\": 3010, \"cy\": 1990, \"k1\": "
          "-0.05, \"k2\": 0.12, \"k3\": -0.09, \"k4\": 0.03, \"p1\": 0.0004, \"p2\": -0.0003,",
          "")
          .queries.at(0)
          .camera;
  ASSERT_EQ(camera.model(), CameraModel::kFullOpenCv);
  double largest_px = 0;
  for (double x = -0.72; x < 0.73; x += 0.04) {
    for (double y = -0.48; y < 0.49; y += 0.04) {
      const double q = x * x + y * y;
      const double radial = 1 + q * (-0.05 + q * (0.12 + q * (-0.09 + q * 0.03)));
      const double dx = x * radial + 2 * 0.0004 * x * y - 0.0003 * (q + 2 * x * x);
      const double dy = y * radial - 2 * 0.0003 * x * y + 0.0004 * (q + 2 * y * y);
      const Eigen::Vector2d expected(4100 * dx + 3010, 4100 * dy + 1990);
      largest_px = std::max(largest_px, (*camera.ImgFromCam({x, y, 1}) - expected).norm());
    }
  }
  EXPECT_LT(largest_px, 0.011);
  EXPECT_TRUE(
      Fails("\"w\": 6000, \"h\": 4000, \"fl_x\": 2000, \"k1\": 1, \"k2\": -3, \"k4\": "
            "40,",
            "", kIdentity, {"frames[0]", "k4", "px"}));
}

TEST_F(Nerfstudio, FramesWithoutAPoseAreCounted) {
  const ImportedScene scene =
      Import("\"fl_x\": 50,", "", "[[null,0,0,1], [0,1,0,2], [0,0,1,3], [0,0,0,1]]");
  EXPECT_EQ(scene.references.size() + scene.queries.size(), 2u);
  EXPECT_THAT(scene.warnings, ElementsAre(HasSubstr("1 image is skipped: the pose is not finite "
                                                    "(first: images/a.png)")));
}

// get_depth_image_from_path() of nerfstudio/data/utils/data_utils.py: every format times the same
// factor, which is 1e-3 unless it is configured.
TEST_F(Nerfstudio, DepthMapsAreThousandthsOfTheScenesUnits) {
  const auto import = [&](const std::string& extension) {
    std::string frames;
    for (const std::string name : {"a", "b"}) {
      if (!frames.empty()) frames += ',';
      frames += "{\"file_path\": \"images/" + name + ".png\", \"depth_file_path\": \"./depth/" +
                name + extension + "\", \"transform_matrix\": " + kIdentity + "}";
    }
    WriteFile(folder_ / "transforms.json",
              "{\"fl_x\": 50, \"applied_scale\": 0.5, \"frames\": [" + frames + "]}");
    ImportOptions options;
    options.query_every = 2;
    return ImportDataset("nerfstudio", folder_ / "transforms.json", options).at(0);
  };
  EXPECT_THAT(import(".png").warnings, ElementsAre(HasSubstr("\"depth/a.png\" is missing")));
  EXPECT_TRUE(import(".png").geometries.empty());
  const DepthMap map{64, 48, std::vector<float>(size_t{64} * 48, 2)};
  for (const std::string extension : {".png", ".npy"}) {
    WriteDepthFile(folder_ / ("depth/a" + extension), map, {});
    const ImportedScene scene = import(extension);
    ASSERT_EQ(scene.geometries.size(), 1u);
    EXPECT_EQ(scene.geometries[0].spec,
              "depth:" + folder_.string() + ",pattern=depth/{stem}" + extension + ",unit=0.002");
    EXPECT_NEAR(
        (scene.references[0].cam_from_world.OriginInSource() - Eigen::Vector3d(2, 4, 6)).norm(), 0,
        1e-12);
    EXPECT_EQ(scene.warnings.size(), extension == ".npy" ? 1u : 0u);
  }
  EXPECT_THAT(import(".npy").warnings,
              ElementsAre(HasSubstr("floats (a.npy: 2), taken as thousandths")));
}

// Files whose names are relative to the folder that a script ran in, or of another computer.
TEST_F(Nerfstudio, PhotographsAreFoundByTheEndsOfTheirNames) {
  const auto import = [&](const std::string& start) {
    std::string frames;
    for (const std::string name : {"a", "b"}) {
      if (!frames.empty()) frames += ',';
      frames +=
          "{\"file_path\": \"" + start + name + "\", \"transform_matrix\": " + kIdentity + "}";
    }
    WriteFile(folder_ / "transforms.json", "{\"fl_x\": 50, \"frames\": [" + frames + "]}");
    ImportOptions options;
    options.query_every = 2;
    return ImportDataset("nerfstudio", folder_, options).at(0);
  };
  EXPECT_THAT(import("images/").warnings, IsEmpty());
  EXPECT_THAT(import("images\\\\").warnings, IsEmpty());
  for (const std::string start :
       {"data/nerf/fox/images/", "/home/me/fox/images/", "../fox/images/"}) {
    const ImportedScene scene = import(start);
    EXPECT_EQ(scene.references.at(0).name, "images/a.png");
    EXPECT_EQ(scene.queries.at(0).name, "images/b.png");
    EXPECT_THAT(scene.warnings,
                ElementsAre(HasSubstr("found in another place than the file says: " + start +
                                      "a as images/a.png")));
  }
  EXPECT_TRUE(FailsWithInputError(
      [&] { import("elsewhere/c"); },
      {"0 frames", "2 images are skipped: the photograph is missing", "elsewhere/ca"}));
}

TEST_F(Nerfstudio, PhotographsMayLieBesideTheFolder) {
  const fs::path below = folder_ / "scene" / "json";
  WriteFile(below / "transforms.json",
            std::string("{\"fl_x\": 50, \"frames\": [{\"file_path\": \"../../images/a.png\", "
                        "\"transform_matrix\": ") +
                kIdentity + "}, {\"file_path\": \"../../images/b.png\", \"transform_matrix\": " +
                kIdentity + "}]}");
  ImportOptions options;
  options.query_every = 2;
  const ImportedScene scene = ImportDataset("nerfstudio", below, options).at(0);
  EXPECT_TRUE(fs::equivalent(scene.images, folder_));
  EXPECT_EQ(scene.references.at(0).name, "images/a.png");
  EXPECT_EQ(scene.references.at(0).camera.ToString(), "PINHOLE 64 48 50 50 32 24");
  EXPECT_THAT(scene.warnings, IsEmpty());
}

// nerfstudio_dataparser.py: "the effective value of applied_transform that was being used before".
TEST_F(Nerfstudio, TheWorldOfOldFilesBesideAColmapModelIsColmaps) {
  fs::create_directories(folder_ / "colmap/sparse/0");
  const ImportedScene scene = Import("\"fl_x\": 50,", "");
  EXPECT_THAT(scene.notes, ElementsAre(HasSubstr("no applied_transform")));
  const Rigid3& pose = scene.references[0].cam_from_world;
  EXPECT_NEAR((pose.OriginInSource() - Eigen::Vector3d(2, 1, -3)).norm(), 0, 1e-12);
  // What lies in front of the camera, at (1, 2, 2) of the file.
  EXPECT_NEAR((pose * Eigen::Vector3d(2, 1, -2) - Eigen::Vector3d(0, 0, 1)).norm(), 0, 1e-12);
}

// The Blender scenes of NeRF: a file per split, names without extension.
TEST_F(Nerfstudio, FilesOfSplitsAreJoined) {
  const auto write = [&](const std::string& split, const std::string& name) {
    WriteFile(
        folder_ / ("transforms_" + split + ".json"),
        "{\"camera_angle_x\": 0.6911112070083618, \"frames\": [{\"file_path\": \"./images/" + name +
            "\", \"rotation\": 0.012566370614359171, \"transform_matrix\": " + kIdentity + "}]}");
  };
  write("train", "a");
  write("val", "b");
  const ImportedScene by_val = ImportDataset("nerfstudio", folder_).at(0);
  EXPECT_EQ(by_val.references.at(0).name, "images/a.png");
  EXPECT_EQ(by_val.queries.at(0).name, "images/b.png");
  write("test", "c");
  const ImportedScene by_test = ImportDataset("nerfstudio", folder_).at(0);
  EXPECT_EQ(by_test.references.size(), 1u);
  EXPECT_EQ(by_test.queries.at(0).name, "images/c.png");
  EXPECT_THAT(by_test.notes, ElementsAre(HasSubstr("transforms_test.json")));
}

TEST_F(Nerfstudio, WrongMembersAreNamed) {
  const std::string fl = "\"fl_x\": 50,";
  EXPECT_TRUE(Fails("", "", kIdentity, {"transforms.json", "frames[0]", "fl_x"}));
  EXPECT_TRUE(Fails("\"fl_x\": -1,", "", kIdentity, {"frames[0]", "focal"}));
  EXPECT_TRUE(Fails(fl + "\"camera_model\": \"EQUIRECTANGULAR\",", "", kIdentity,
                    {"EQUIRECTANGULAR", "fl_x = w / 2"}));
  EXPECT_TRUE(
      Fails(fl + "\"camera_model\": \"VR180_L\",", "", kIdentity, {"camera_model", "VR180_L"}));
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
}

}  // namespace
}  // namespace raylift
