#include "localization/joined_retrieval.h"

#include <algorithm>

namespace raylift {
namespace {

double Cosine(const Eigen::VectorXf& a, const Eigen::VectorXf& b) {
  return a.cast<double>().dot(b.cast<double>());
}

}  // namespace

void JoinedRetrieval::Join(const PosedImage& image, const Features& features) {
  joined_.push_back({image, references_->VectorOf(features)});
}

std::vector<PosedImage> JoinedRetrieval::Merge(const std::string& query,
                                               const Features& query_features,
                                               const std::vector<PosedImage>& retrieved,
                                               size_t top_k, size_t max_joined) const {
  const Eigen::VectorXf query_vector = references_->VectorOf(query_features);
  struct Ranked {
    double cosine;
    const PosedImage* image;
  };
  std::vector<Ranked> ranked;
  for (const Joined& joined : joined_) {
    if (joined.image.name == query) continue;
    ranked.push_back({Cosine(query_vector, joined.vector), &joined.image});
  }
  std::stable_sort(ranked.begin(), ranked.end(),
                   [](const Ranked& a, const Ranked& b) { return a.cosine > b.cosine; });
  ranked.resize(std::min(ranked.size(), max_joined));

  std::vector<PosedImage> merged;
  auto next = ranked.begin();
  for (const PosedImage& image : retrieved) {
    const double cosine = Cosine(query_vector, references_->VectorOfReference(image.name));
    while (next != ranked.end() && next->cosine > cosine) merged.push_back(*(next++)->image);
    merged.push_back(image);
  }
  while (next != ranked.end()) merged.push_back(*(next++)->image);
  merged.resize(std::min(merged.size(), top_k));
  return merged;
}

}  // namespace raylift
