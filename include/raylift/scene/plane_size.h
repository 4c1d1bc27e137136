// The size of a picture or a map.

#pragma once

namespace raylift {

struct PlaneSize {
  int width_px = 0;
  int height_px = 0;
  bool operator==(const PlaneSize&) const = default;
};

}  // namespace raylift
