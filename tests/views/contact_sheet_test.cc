#include "support/meshes.h"
#include "views/job_files.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

TEST(ContactSheet, HoldsATileOfEachKindOfCameraForAnyThreadCount) {
  const auto scene = std::make_shared<const RayCaster>(
      std::make_shared<const TriangleMesh>(MakeBox({0, 0, 0}, {3, 2, 4})));
  std::vector<PosedImage> views;
  for (const Camera& camera : CamerasOfEveryModel()) {
    views.push_back({"a long name of an image " + camera.ToString(), camera, Rigid3()});
  }
  views.push_back({"panorama", Camera::Panorama(60, 30), Rigid3()});
  views.push_back({"away", views[0].camera, LookAt({0, 0, -9}, {0, 0, -10})});
  const Image sheet = MakeContactSheet(scene, views, 1);
  EXPECT_GT(sheet.width_px, 4 * 240);
  EXPECT_EQ(sheet.data.size(), static_cast<size_t>(sheet.width_px * sheet.height_px * 3));
  EXPECT_EQ(MakeContactSheet(scene, views, 4).data, sheet.data);
}

TEST(ContactSheet, TakesViewsThatSeeNothing) {
  const auto scene =
      std::make_shared<const RayCaster>(std::make_shared<const TriangleMesh>(TriangleMesh{}));
  const Image sheet = MakeContactSheet(scene, {{"one", Camera::Panorama(60, 30), Rigid3()}}, 1);
  EXPECT_EQ(sheet.width_px, 244);
}

}  // namespace
}  // namespace raylift
