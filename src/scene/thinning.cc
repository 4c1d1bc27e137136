#include "raylift/scene/thinning.h"

#include <map>

namespace raylift {

std::vector<size_t> KeptIndices(std::span<const std::string> cameras, const Thinning& thinning) {
  const auto every = static_cast<size_t>(thinning.every);
  const auto offset = static_cast<size_t>(thinning.offset);
  std::map<std::string, size_t> count_of_camera;
  std::vector<size_t> kept;
  for (size_t i = 0; i < cameras.size(); ++i) {
    const size_t place = thinning.per_camera ? count_of_camera[cameras[i]]++ : i;
    if (place % every == offset) kept.push_back(i);
  }
  return kept;
}

}  // namespace raylift
