#include "raylift/scene/view.h"

#include <fmt/format.h>

namespace raylift {

std::string ViewCamera::ToString() const {
  return lens ? lens->ToString() : fmt::format("EQUIRECTANGULAR {} {}", width_px, height_px);
}

ViewCamera ViewCamera::Scaled(int new_width_px, int new_height_px) const {
  return lens ? ViewCamera(lens->Scaled(new_width_px, new_height_px))
              : Panorama(new_width_px, new_height_px);
}

}  // namespace raylift
