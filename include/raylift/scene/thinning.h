// Sparser references: every N-th image of a scene by name, to see what fewer of them cost.

#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace raylift {

struct Thinning {
  int every = 1;   // at least 1; 1 keeps all
  int offset = 0;  // of the first that is kept, from 0 to every - 1
  // Every N-th image of each camera rather than of all: where the cameras of a rig take turns, an
  // even N would keep those of one camera alone.
  bool per_camera = false;

  bool KeepsAll() const { return every == 1; }
};

// The indices of the images that are kept, in order. `cameras` says which camera took each image,
// the images being sorted by name.
std::vector<size_t> KeptIndices(std::span<const std::string> cameras, const Thinning& thinning);

}  // namespace raylift
