// Takes a photograph of a mesh: sun with shadows, light from the sky and from the ground, a sky
// behind it all, and what a real camera does to the picture.

#pragma once

#include <cstdint>

#include <Eigen/Core>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/image.h"

namespace raylift::demo {

// Linear RGB intensities.
struct Daylight {
  Eigen::Vector3d to_sun;  // any length
  Eigen::Vector3f sun;
  Eigen::Vector3f sky;     // onto surfaces that look up
  Eigen::Vector3f ground;  // what the yard throws back
  Eigen::Vector3f zenith;  // the sky as seen, sRGB
  Eigen::Vector3f horizon;
  double exposure = 1;
};

struct Sensor {
  double blur_px = 0;     // standard deviation
  double vignetting = 0;  // loss of light in the corners
  double shot_noise = 0;  // standard deviation at white, of 255; grows with the root of the value
  double read_noise = 0;  // standard deviation, of 255
};

// Deterministic by `seed`, whatever the number of threads.
Image TakePhotograph(const RayCaster& caster, const Camera& camera, const Rigid3& cam_from_world,
                     const Daylight& light, const Sensor& sensor, uint64_t seed, int threads);

}  // namespace raylift::demo
