#include "raylift/scene/photographs.h"

#include <map>

namespace raylift {

bool PosedImage::Sees(const Eigen::Vector3d& point_in_world) const {
  const auto pixel = camera.ImgFromCam(cam_from_world * point_in_world);
  return pixel && camera.Contains(*pixel);
}

std::vector<size_t> KeptIndices(std::span<const std::string> cameras,
                                const Subsampling& subsampling) {
  const auto every = static_cast<size_t>(subsampling.every);
  const auto offset = static_cast<size_t>(subsampling.offset);
  std::map<std::string, size_t> count_of_camera;
  std::vector<size_t> kept;
  for (size_t i = 0; i < cameras.size(); ++i) {
    const size_t place = subsampling.per_camera ? count_of_camera[cameras[i]]++ : i;
    if (place % every == offset) kept.push_back(i);
  }
  return kept;
}

}  // namespace raylift
