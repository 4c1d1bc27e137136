#include "localization/joined_retrieval.h"

#include <algorithm>

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

double Cosine(const Eigen::VectorXf& a, const Eigen::VectorXf& b) {
  return a.cast<double>().dot(b.cast<double>());
}

}  // namespace

JoinedRetrieval::JoinedRetrieval(std::span<const PosedImage> references,
                                 const std::map<std::string, Features>& features, uint64_t seed,
                                 int threads) {
  std::vector<Features> of_references;
  for (const PosedImage& image : references) of_references.push_back(features.at(image.name));
  vocabulary_ = TrainVocabulary(of_references, {.seed = seed, .threads = threads});
  std::vector<Eigen::VectorXf> vectors(references.size());
  ParallelFor(references.size(), threads,
              [&](size_t i) { vectors[i] = ComputeVlad(of_references[i], vocabulary_); });
  for (size_t i = 0; i < references.size(); ++i) {
    vector_of_reference_.emplace(references[i].name, std::move(vectors[i]));
  }
}

void JoinedRetrieval::Join(const PosedImage& image, const Features& features) {
  joined_.push_back({image, ComputeVlad(features, vocabulary_)});
}

std::vector<PosedImage> JoinedRetrieval::Merge(const std::string& query,
                                               const Features& query_features,
                                               const std::vector<PosedImage>& retrieved,
                                               size_t top_k, size_t max_joined) const {
  const Eigen::VectorXf query_vector = ComputeVlad(query_features, vocabulary_);
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
    const double cosine = Cosine(query_vector, vector_of_reference_.at(image.name));
    while (next != ranked.end() && next->cosine > cosine) merged.push_back(*(next++)->image);
    merged.push_back(image);
  }
  while (next != ranked.end()) merged.push_back(*(next++)->image);
  merged.resize(std::min(merged.size(), top_k));
  return merged;
}

}  // namespace raylift
