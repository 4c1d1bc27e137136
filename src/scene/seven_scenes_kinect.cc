#include "raylift/scene/seven_scenes_kinect.h"

#include <vector>

namespace raylift {

Camera SevenScenesColorCamera() {
  return Camera(CameraModel::kSimplePinhole, 640, 480, std::vector<double>{525, 320, 240});
}

Camera SevenScenesDepthCamera() {
  return Camera(CameraModel::kSimplePinhole, 640, 480, std::vector<double>{585, 320, 240});
}

Rigid3 SevenScenesColorFromDepth() {
  Eigen::Matrix3d rotation;
  rotation << 9.9996518012567637e-01, 2.6765126468950343e-03, -7.9041012313000904e-03,
      -2.7409311281316700e-03, 9.9996302803027592e-01, -8.1504520778013286e-03,
      7.8819942130445332e-03, 8.1718328771890631e-03, 9.9993554558014031e-01;
  return {Eigen::Quaterniond(rotation).normalized(),
          {-2.5558943178152542e-02, 1.0109636268061706e-04, 2.0318321729487039e-03}};
}

}  // namespace raylift
