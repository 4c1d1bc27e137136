// The two cameras of the Kinect that recorded 7-Scenes. Its authors did not calibrate them:
// https://projet.liris.cnrs.fr/voir/activities-dataset/kinect-calibration.html measured such a
// Kinect, and kapture (kapture_import_7scenes.py) and ACE (setup_7scenes.py) take it from there.

#pragma once

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {

// 640 x 480, f 525 and 585: as published, the focal lengths of the drivers.
Camera SevenScenesColorCamera();
Camera SevenScenesDepthCamera();
// Some 26 mm apart and 0.67 degrees turned.
Rigid3 SevenScenesColorFromDepth();

}  // namespace raylift
