// Depth of a sensor that stands beside the photograph's camera, as the photograph's camera would
// see it. Where both are taken for one, every point is off by their distance and by the ratio of
// their focal lengths.

#pragma once

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/scene/image.h"

namespace raylift {

struct DepthSensor {
  Camera camera;
  Rigid3 image_from_sensor;  // from the sensor's frame to that of the photograph's camera
};

// The sensor's map seen by `image`, of its size. Neighbors in the map span triangles, so planes
// stay planes, unless their depths jump by more than 5 %; the nearest surface counts.
DepthMap RegisterDepth(const DepthMap& map, const DepthSensor& sensor, const Camera& image);

}  // namespace raylift
