#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

TEST(ViewList, HoldsPosesAndCameras) {
  const auto file = TestFolder() / "views.txt";
  WriteFile(file,
            "# name qw qx qy qz tx ty tz camera\n"
            "a/1.jpg 1 0 0 0 1 2 3 SIMPLE_RADIAL 640 480 500 320 240 0.1\n\n"
            "b.jpg 0 1 0 0 4 5 6 EQUIRECTANGULAR 200 100\n"
            "c.jpg 0 1 0 0 4 5 6 EQUIRECTANGULAR 200 100 200 100\n");
  const std::vector<PosedImage> views = ReadViewList(file);
  ASSERT_EQ(views.size(), 3u);
  EXPECT_EQ(views[2].camera, Camera::Panorama(200, 100));
  EXPECT_EQ(views[0].name, "a/1.jpg");
  EXPECT_EQ(views[0].camera.ToString(), "SIMPLE_RADIAL 640 480 500 320 240 0.1");
  EXPECT_EQ(views[0].cam_from_world.translation, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(views[1].camera, Camera::Panorama(200, 100));
  EXPECT_EQ(views[1].cam_from_world.rotation.x(), 1);
}

TEST(ViewList, WrongLinesAreNamed) {
  const auto file = TestFolder() / "views.txt";
  const auto fails = [&](const std::string& line, const std::string& part) {
    WriteFile(file, "# first\n" + line + "\n");
    return FailsWithInputError([&] { ReadViewList(file); }, {"views.txt", "line 2", part});
  };
  EXPECT_TRUE(fails("a 1 0 0 0 1 2 3", "camera model"));
  EXPECT_TRUE(fails("a 1 0 0 0 1 2 x PINHOLE 4 3 1 1 2 1", "tvec"));
  EXPECT_TRUE(fails("a 2 0 0 0 1 2 3 PINHOLE 4 3 1 1 2 1", "qvec"));
  EXPECT_TRUE(fails("a 1 0 0 0 1 2 3 PINHOLE 4 3 1 1 2", "PINHOLE"));
  EXPECT_TRUE(fails("a 1 0 0 0 1 2 3 EQUIRECTANGULAR 0 3", "width"));
  EXPECT_TRUE(fails("a 1 0 0 0 1 2 3 EQUIRECTANGULAR 4 3 2", ""));
  EXPECT_TRUE(fails("a 1 0 0 0 1 2 3 SPHERE 4 3", "SPHERE"));
  WriteFile(file, "a 1 0 0 0 1 2 3 EQUIRECTANGULAR 4 3\na 1 0 0 0 1 2 3 EQUIRECTANGULAR 4 3\n");
  EXPECT_TRUE(FailsWithInputError([&] { ReadViewList(file); }, {"line 2", "\"a\" stands twice"}));
}

TEST(PointList, HoldsPointsAndNamesWrongLines) {
  const auto file = TestFolder() / "line.txt";
  WriteFile(file, "# x y z\n1 2 3\n\n4 5 -6e1\n");
  const auto points = ReadPointList(file);
  ASSERT_EQ(points.size(), 2u);
  EXPECT_EQ(points[1], Eigen::Vector3d(4, 5, -60));
  WriteFile(file, "1 2\n");
  EXPECT_TRUE(FailsWithInputError([&] { ReadPointList(file); }, {"line.txt", "line 1", "point"}));
  WriteFile(file, "1 2 3 4\n");
  EXPECT_TRUE(FailsWithInputError([&] { ReadPointList(file); }, {"line.txt", "line 1"}));
}

TEST(ParseCamera, TakesWhatListsHold) {
  EXPECT_EQ(ParseCamera("--camera", " PINHOLE 64 48  50 51 32 24").ToString(),
            "PINHOLE 64 48 50 51 32 24");
  EXPECT_TRUE(FailsWithInputError([] { ParseCamera("--camera", "PINHOLE 64"); }, {"--camera"}));
}

}  // namespace
}  // namespace raylift
