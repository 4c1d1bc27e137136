// Retrieval among references that grow: localized queries are ranked among the references that were
// retrieved for a query, by the cosines of their VLAD vectors.

#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/features/vlad.h"
#include "raylift/scene/features.h"
#include "raylift/scene/posed_image.h"

namespace raylift {

class JoinedRetrieval {
 public:
  // Learns the vocabulary from the references' features.
  JoinedRetrieval(std::span<const PosedImage> references,
                  const std::map<std::string, Features>& features, uint64_t seed, int threads);

  void Join(const PosedImage& image, const Features& features);

  // The `top_k` best of the retrieved references, which keep their order, and of up to `max_joined`
  // joined queries: each stands before the first reference that is less like the query than it is.
  std::vector<PosedImage> Merge(const std::string& query, const Features& query_features,
                                const std::vector<PosedImage>& retrieved, size_t top_k,
                                size_t max_joined) const;

 private:
  Vocabulary vocabulary_;
  std::map<std::string, Eigen::VectorXf> vector_of_reference_;
  struct Joined {
    PosedImage image;
    Eigen::VectorXf vector;
  };
  std::vector<Joined> joined_;
};

}  // namespace raylift
