// Retrieval among references that grow: localized queries are ranked among the references that were
// retrieved for a query, by the cosines of their VLAD vectors.

#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "localization/vlad_index.h"
#include <Eigen/Core>

#include "raylift/scene/features.h"
#include "raylift/scene/photographs.h"

namespace raylift {

class JoinedRetrieval {
 public:
  explicit JoinedRetrieval(std::shared_ptr<const VladIndex> references)
      : references_(std::move(references)) {}

  void Join(const PosedImage& image, const Features& features);

  // The `top_k` best of the retrieved references, which keep their order, and of up to `max_joined`
  // joined queries: each stands before the first reference that is less like the query than it is.
  std::vector<PosedImage> Merge(const std::string& query, const Features& query_features,
                                const std::vector<PosedImage>& retrieved, size_t top_k,
                                size_t max_joined) const;

 private:
  std::shared_ptr<const VladIndex> references_;
  struct Joined {
    PosedImage image;
    Eigen::VectorXf vector;
  };
  std::vector<Joined> joined_;
};

}  // namespace raylift
