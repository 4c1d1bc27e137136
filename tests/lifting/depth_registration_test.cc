#include <cmath>

#include "lifting/depth_convention.h"
#include "scene/seven_scenes_kinect.h"
#include "support/matchers.h"
#include <gtest/gtest.h>

#include "raylift/lifting/depth_source.h"

namespace raylift {
namespace {

// z of a plane at each pixel; 0 where the ray does not meet it.
DepthMap SeePlane(const Camera& camera, const Rigid3& cam_from_world,
                  const Eigen::Vector3d& normal_in_world, double offset) {
  DepthMap map{camera.width_px(), camera.height_px(), {}};
  const Eigen::Vector3d normal = cam_from_world.rotation * normal_in_world;
  const double distance = offset + normal.dot(cam_from_world.translation);
  for (int y = 0; y < map.height_px; ++y) {
    for (int x = 0; x < map.width_px; ++x) {
      const Eigen::Vector3d ray = *camera.RayInCam({x + 0.5, y + 0.5});
      map.z.push_back(static_cast<float>(std::max(0.0, distance / normal.dot(ray) * ray.z())));
    }
  }
  return map;
}

// The world is the sensor's frame. Tolerance: the stored floats, times what is extrapolated.
TEST(DepthRegistration, PlanesStayPlanesThroughTheOtherCamera) {
  const DepthSensor sensor{SevenScenesDepthCamera(), SevenScenesColorFromDepth()};
  const Camera image = SevenScenesColorCamera();
  const Eigen::Vector3d normal = Eigen::Vector3d(0.4, -0.2, 1).normalized();
  const DepthMap seen = SeePlane(sensor.camera, Rigid3(), normal, 2);
  const DepthMap registered = RegisterDepth(seen, sensor, image);
  const DepthMap expected = SeePlane(image, sensor.image_from_sensor, normal, 2);
  size_t num_holes = 0;
  double largest = 0;
  for (size_t i = 0; i < registered.z.size(); ++i) {
    num_holes += registered.z[i] == 0;
    if (registered.z[i] == 0) continue;
    largest = std::max(largest, std::abs(double{registered.z[i]} - double{expected.z[i]}));
  }
  EXPECT_LT(largest, 1e-5);
  // The color camera sees more: 525 / 585 of both sides is there.
  const double share = std::pow(525.0 / 585, 2);
  EXPECT_NEAR(1 - static_cast<double>(num_holes) / static_cast<double>(expected.z.size()), share,
              0.02);
  // As if the cameras were one, the same map is centimeters off.
  double unregistered = 0;
  for (size_t i = 0; i < seen.z.size(); ++i) {
    unregistered = std::max(unregistered, std::abs(double{seen.z[i]} - double{expected.z[i]}));
  }
  EXPECT_GT(unregistered, 0.03);
}

TEST(DepthRegistration, TheNearestSurfaceCountsAndJumpsStayOpen) {
  const Camera camera(CameraModel::kPinhole, 8, 6, std::vector<double>{8, 8, 4, 3});
  // One pixel to the left for z = 1.
  const DepthSensor sensor{camera, {Eigen::Quaterniond::Identity(), {-0.125, 0, 0}}};
  DepthMap map{8, 6, std::vector<float>(48, 4)};
  for (int y = 0; y < 6; ++y) {
    for (int x = 4; x < 8; ++x) map.z[static_cast<size_t>(y * 8 + x)] = 1;
  }
  const DepthMap registered = RegisterDepth(map, sensor, camera);
  // Pixels 4 to 7 moved to 3 to 6; what lay behind moved a quarter of a pixel and ends at 3.25.
  for (int x = 0; x < 8; ++x) {
    const float expected = x < 3 ? 4.0f : x < 7 ? 1.0f : 0.0f;
    EXPECT_NEAR(registered.At(x, 2), expected, 1e-6) << x;
  }
  map.z.assign(48, 0);
  EXPECT_EQ(RegisterDepth(map, sensor, camera).z, map.z);
}

TEST(DepthRegistration, ThePresetTurnsTheKinectsMillimetersIntoThePhotographsDepth) {
  const Eigen::Vector3d normal = Eigen::Vector3d(0.1, 0.3, 1).normalized();
  const DepthMap seen = SeePlane(SevenScenesDepthCamera(), Rigid3(), normal, 1.5);
  StoredDepth stored;
  stored.width_px = 640;
  stored.height_px = 480;
  stored.sample_type = "uint16";
  for (const float z : seen.z) stored.values.push_back(std::round(1000 * z));
  stored.values[100 * 640 + 100] = 65535;
  const Camera photograph = SevenScenesColorCamera().Scaled(1280, 960);
  const auto preset = DepthPreset("7scenes_sensor");
  ASSERT_TRUE(preset);
  const DepthMap map = ToDepthMap(stored, photograph, *preset);
  ASSERT_EQ(map.width_px, 640);
  const DepthMap expected =
      SeePlane(SevenScenesColorCamera(), SevenScenesColorFromDepth(), normal, 1.5);
  size_t num_far = 0, num_holes = 0;
  for (size_t i = 0; i < map.z.size(); ++i) {
    if (map.z[i] == 0) {
      ++num_holes;
    } else {
      num_far += std::abs(map.z[i] - expected.z[i]) > 0.001f;
    }
  }
  EXPECT_EQ(num_far, 0u);
  EXPECT_LT(num_holes, map.z.size() / 4);
}

}  // namespace
}  // namespace raylift
