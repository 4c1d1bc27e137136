#include <sstream>
#include <string>
#include <vector>

#include "support/meshes.h"
#include "support/test_data.h"
#include "views/job_files.h"
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "raylift/base/file.h"

namespace raylift {
namespace {

const Camera kCamera(CameraModel::kPinhole, 64, 48, std::vector<double>{60, 60, 32, 24});

TEST(MvsnetCameras, ViewsOfNothingAreLeftOut) {
  const RayCaster scene(std::make_shared<const TriangleMesh>(MakeSphere({0, 0, 0}, 0.1, 8, 16)));
  const std::vector<PosedImage> views = {{"a.jpg", kCamera, LookAt({3, 0, 0}, {0, 0, 0})},
                                         {"b.jpg", kCamera, LookAt({3, 0, 0}, {6, 0, 0})},
                                         {"c.jpg", kCamera, LookAt({3, 0.3, 0}, {0, 0, 0})}};
  const auto folder = TestFolder();
  const auto warnings = WriteMvsnetCameras(folder, scene, views, 1);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_NE(warnings.front().find("b.jpg sees nothing"), std::string::npos);
  EXPECT_TRUE(std::filesystem::exists(folder / "cams" / "00000002_cam.txt"));
  EXPECT_FALSE(std::filesystem::exists(folder / "cams" / "00000001_cam.txt"));
  std::istringstream pairs(ReadFile(folder / "pair.txt"));
  std::string line;
  std::vector<std::string> lines;
  while (std::getline(pairs, line)) lines.push_back(line);
  ASSERT_EQ(lines.size(), 5u);
  EXPECT_EQ(lines[0], "2");
  EXPECT_TRUE(lines[2].starts_with("1 2 ")) << lines[2];
  EXPECT_EQ(lines[3], "2");
}

// A wall straight ahead.
TEST(MvsnetCameras, OneDepthIsARangeToo) {
  TriangleMesh wall;
  wall.vertices = {{-9, -9, 2}, {9, -9, 2}, {0, 18, 2}};
  wall.triangles = {{0, 1, 2}};
  const RayCaster scene(std::make_shared<const TriangleMesh>(wall));
  const auto folder = TestFolder();
  WriteMvsnetCameras(folder, scene, std::vector<PosedImage>{{"a.jpg", kCamera, Rigid3()}}, 1);
  const std::string text = ReadFile(folder / "cams" / "00000000_cam.txt");
  std::istringstream planes(text.substr(text.rfind('\n', text.size() - 2)));
  double low = 0, interval = 0, number = 0, high = 0;
  planes >> low >> interval >> number >> high;
  EXPECT_LT(low, 2);
  EXPECT_GT(interval, 0);
  EXPECT_GT(high, 2);
}

TEST(TransformsJson, NamesNeedNotBeUtf8) {
  const std::vector<RenderTask> tasks = {{{"\xE9.jpg", kCamera, Rigid3()}, "\xE9"}};
  const std::string text =
      TransformsJson(tasks, {.out = "out", .products = {{Product::kColor, "png"}}});
  EXPECT_EQ(nlohmann::json::parse(text).at("frames").size(), 1u);
}

}  // namespace
}  // namespace raylift
