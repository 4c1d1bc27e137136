#include "io/colmap_test_models.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

ColmapImage ImageWithPoints(const std::string& name, const std::vector<uint64_t>& ids) {
  ColmapImage image;
  image.name = name;
  image.camera_id = 1;
  for (const uint64_t id : ids) image.points2d.push_back({{1, 2}, id});
  return image;
}

// Images 1 to 3; point 10 is seen by all, 11 by the first two, 12 by the last alone.
ColmapModel ThreeImages() {
  ColmapModel model;
  model.cameras.emplace(1, Camera());
  model.images.emplace(1, ImageWithPoints("a", {10, 11}));
  model.images.emplace(2, ImageWithPoints("b", {11, 10}));
  model.images.emplace(3, ImageWithPoints("c", {10, 12}));
  model.image_order = {3, 1, 2};
  model.points3d[10] = {{1, 2, 3}, {}, 0.5, {{1, 0}, {2, 1}, {3, 0}}};
  model.points3d[11] = {{4, 5, 6}, {}, 0.5, {{1, 1}, {2, 0}}};
  model.points3d[12] = {{7, 8, 9}, {}, 0.5, {{3, 1}}};
  model.point3d_order = {12, 11, 10};
  return model;
}

TEST(RemoveImages, DropsPointsThatFewerThanTwoImagesStillSee) {
  ColmapModel model = ThreeImages();
  RemoveImages(model, std::vector<std::string>{"b", "not there"});
  EXPECT_EQ(model.images.size(), 2u);
  EXPECT_EQ(model.image_order, (std::vector<uint32_t>{3, 1}));
  ASSERT_EQ(model.points3d.size(), 2u);
  // Where it was, with the observations that are left.
  EXPECT_EQ(model.points3d.at(10).position_in_world, Eigen::Vector3d(1, 2, 3));
  ASSERT_EQ(model.points3d.at(10).track.size(), 2u);
  EXPECT_EQ(model.points3d.at(10).track[1].image_id, 3u);
  EXPECT_FALSE(model.points3d.contains(11));
  EXPECT_TRUE(model.points3d.contains(12));  // has lost nothing
  EXPECT_EQ(model.point3d_order, (std::vector<uint64_t>{12, 10}));
  EXPECT_EQ(model.images.at(1).points2d[0].point3d_id, 10u);
  EXPECT_FALSE(model.images.at(1).points2d[1].point3d_id.has_value());
}

TEST(RemoveImages, LeavesOthersAsTheyAre) {
  Rng rng = TestRng();
  ColmapModel model = SmallColmapModel(rng);
  const ColmapModel before = model;
  RemoveImages(model, std::vector<std::string>{"not there"});
  EXPECT_EQ(model.images.size(), before.images.size());
  EXPECT_EQ(model.points3d.size(), before.points3d.size());
  EXPECT_EQ(model.image_order, before.image_order);
}

TEST(RemoveImages, TakesThemOutOfFrames) {
  ColmapModel model = ThreeImages();
  model.rigs[1].reference_sensor = ColmapSensor{0, 1};
  for (const uint32_t id : {1u, 2u, 3u}) {
    model.frames[id].rig_id = 1;
    model.frames[id].data = {{{0, 1}, id}};
  }
  model.frame_order = {1, 2, 3};
  RemoveImages(model, std::vector<std::string>{"b"});
  EXPECT_EQ(model.frames.size(), 2u);
  EXPECT_EQ(model.frame_order, (std::vector<uint32_t>{1, 3}));
}

}  // namespace
}  // namespace raylift
