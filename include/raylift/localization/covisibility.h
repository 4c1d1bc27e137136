// Which references see the same points of an SfM model: hloc's covisibility clustering.

#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "raylift/io/colmap_model.h"
#include "raylift/scene/posed_image.h"

namespace raylift {

class Covisibility {
 public:
  // Knows nothing: Clusters() is empty.
  Covisibility() = default;
  explicit Covisibility(const ColmapModel& model);

  // The cluster of each reference: references that observe a common 3D point are in one, directly
  // or through others of the list. Empty where the model has no points.
  std::vector<int> Clusters(const std::vector<PosedImage>& references) const;

 private:
  std::map<std::string, std::vector<uint64_t>> points_of_image_;
};

}  // namespace raylift
