// A picture to be taken of a scene: its name, from where, and through what.

#pragma once

#include <optional>
#include <string>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {

// One of COLMAP's cameras, or an equirectangular panorama of all directions, which has no other
// parameters than its size (PixelRays::Equirectangular says which pixel looks where).
struct ViewCamera {
  std::optional<Camera> lens = std::nullopt;  // none: a panorama, also where it is COLMAP's
  int width_px = 0;
  int height_px = 0;

  ViewCamera() = default;
  ViewCamera(const Camera& camera)  // NOLINT(google-explicit-constructor): it is one of the two
      : lens(camera.is_panorama() ? std::nullopt : std::optional(camera)),
        width_px(camera.width_px()),
        height_px(camera.height_px()) {}
  static ViewCamera Panorama(int width_px, int height_px) {
    ViewCamera camera;
    camera.width_px = width_px;
    camera.height_px = height_px;
    return camera;
  }

  // "MODEL width height params...", the model of a panorama being EQUIRECTANGULAR.
  std::string ToString() const;

  // The same on an image of another size.
  ViewCamera Scaled(int new_width_px, int new_height_px) const;
};

struct View {
  std::string name;  // as of a photograph: a path relative to some folder
  ViewCamera camera;
  Rigid3 cam_from_world;
};

}  // namespace raylift
