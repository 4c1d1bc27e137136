// The two cameras of the Kinect that recorded 7-Scenes. Its authors did not calibrate them:
// https://projet.liris.cnrs.fr/voir/activities-dataset/kinect-calibration.html measured such a
// Kinect, and kapture (kapture_import_7scenes.py) and ACE (setup_7scenes.py) take it from there.

#pragma once

#include <vector>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {

// Return pinholes of 640 x 480 pixels whose focal lengths, 525 and 585, are those of the drivers,
// as published.
inline Camera SevenScenesColorCamera() {
  return Camera(CameraModel::kSimplePinhole, 640, 480, std::vector<double>{525, 320, 240});
}
inline Camera SevenScenesDepthCamera() {
  return Camera(CameraModel::kSimplePinhole, 640, 480, std::vector<double>{585, 320, 240});
}
// Returns the transform between the cameras, which are some 26 mm apart and turned by 0.67 degrees.
inline Rigid3 SevenScenesColorFromDepth() {
  Eigen::Matrix3d rotation;
  rotation << 9.9996518012567637e-01, 2.6765126468950343e-03, -7.9041012313000904e-03,
      -2.7409311281316700e-03, 9.9996302803027592e-01, -8.1504520778013286e-03,
      7.8819942130445332e-03, 8.1718328771890631e-03, 9.9993554558014031e-01;
  return {Eigen::Quaterniond(rotation).normalized(),
          {-2.5558943178152542e-02, 1.0109636268061706e-04, 2.0318321729487039e-03}};
}

}  // namespace raylift
