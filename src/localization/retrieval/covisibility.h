// Finds the references that see the same points of an SfM model: hloc's covisibility clustering,
// and retrieval by the number of shared points.

#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "raylift/io/colmap_model.h"
#include "raylift/scene/features.h"
#include "raylift/scene/photographs.h"

namespace raylift {

class Covisibility {
 public:
  // Makes one without points: Clusters() is empty.
  Covisibility() = default;
  explicit Covisibility(const ColmapModel& model);

  // Returns the cluster of each reference: references that observe a common 3D point are in one,
  // directly or through others of the list. Empty where the model has no points.
  std::vector<int> Clusters(const std::vector<PosedImage>& references) const;

  // Returns whether an image of this name observes points.
  bool Knows(const std::string& image) const;
  // Returns, for each query, an image of the model, the k references that observe most of the
  // points that it observes, their number being the score; without itself and those that observe
  // none.
  RetrievedLists MostShared(std::span<const std::string> queries,
                            std::span<const std::string> references, int k, int threads) const;

 private:
  std::map<std::string, std::vector<uint64_t>> points_of_image_;
};

}  // namespace raylift
