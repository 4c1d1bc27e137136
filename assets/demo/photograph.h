// Takes a photograph of a mesh: sun with shadows, light from the sky and from the ground, a sky
// behind it all, and what a real camera does to the picture.

#pragma once

#include <cstdint>
#include <functional>

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

// A clear late morning.
inline const Daylight kMorning{{-0.45, -0.55, 0.80},
                               {2.3f, 2.15f, 1.9f},
                               {0.95f, 1.08f, 1.25f},
                               {0.62f, 0.58f, 0.52f},
                               {0.30f, 0.52f, 0.82f},
                               {0.78f, 0.86f, 0.93f},
                               1.15};
// A hazy afternoon: the sun from the other side, lower and warmer.
inline const Daylight kAfternoon{{0.75, -0.30, 0.62},
                                 {1.9f, 1.45f, 0.95f},
                                 {0.80f, 0.85f, 1.02f},
                                 {0.60f, 0.52f, 0.42f},
                                 {0.55f, 0.60f, 0.72f},
                                 {0.93f, 0.84f, 0.72f},
                                 1.0};

struct Sensor {
  double blur_px = 0;     // standard deviation
  double vignetting = 0;  // loss of light in the corners
  double shot_noise = 0;  // standard deviation at white, of 255; grows with the root of the value
  double read_noise = 0;  // standard deviation, of 255
  int samples_per_side = 3;  // of each pixel
};

// The rays of a picture's pixels.
struct PixelGrid {
  int width_px, height_px;
  std::function<Ray(const Eigen::Vector2d&)> ray;
};
PixelGrid GridOf(const Camera& camera, const Rigid3& cam_from_world);

// Deterministic by `seed`, whatever the number of threads.
Image TakePhotograph(const RayCaster& caster, const PixelGrid& grid, const Daylight& light,
                     const Sensor& sensor, uint64_t seed, int threads);

}  // namespace raylift::demo
