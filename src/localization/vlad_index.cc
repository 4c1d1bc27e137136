#include "localization/vlad_index.h"

#include <utility>

#include "localization/retrieved_lists.h"

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

Eigen::MatrixXf VectorsOf(std::span<const std::string> images, const FeatureStore& features,
                          const Vocabulary& vocabulary, int threads) {
  Eigen::MatrixXf vectors(vocabulary.words.size(), static_cast<Eigen::Index>(images.size()));
  ParallelFor(images.size(), threads, [&](size_t i) {
    vectors.col(static_cast<Eigen::Index>(i)) =
        ComputeVlad(features.Get(images[i])->features, vocabulary);
  });
  return vectors;
}

}  // namespace

VladVectors ComputeVladVectors(std::span<const std::string> references,
                               const FeatureStore& features, uint64_t seed, int threads) {
  VladVectors vectors;
  vectors.vocabulary = TrainVocabulary(
      references.size(),
      [&](size_t i, const auto& look) { look(features.Get(references[i])->features); },
      {.seed = seed, .threads = threads});
  vectors.of_references = VectorsOf(references, features, vectors.vocabulary, threads);
  return vectors;
}

VladIndex::VladIndex(std::vector<std::string> references, VladVectors vectors)
    : references_(std::move(references)), vectors_(std::move(vectors)) {
  RAYLIFT_CHECK_EQ(static_cast<size_t>(vectors_.of_references.cols()), references_.size());
  for (const std::string& name : references_) {
    index_of_name_.emplace(name, static_cast<Eigen::Index>(index_of_name_.size()));
  }
}

Eigen::VectorXf VladIndex::VectorOf(const Features& features) const {
  return ComputeVlad(features, vectors_.vocabulary);
}

Eigen::VectorXf VladIndex::VectorOfReference(const std::string& name) const {
  return vectors_.of_references.col(index_of_name_.at(name));
}

RetrievedLists VladIndex::Best(std::span<const std::string> queries, const Eigen::MatrixXf& vectors,
                               int top_k, int threads) const {
  RetrievedLists lists = RetrieveTopK(vectors, vectors_.of_references, top_k + 1, threads);
  DropOwn(queries, references_, top_k, &lists);
  return lists;
}

RetrievedLists RetrieveByVlad(const VladIndex& index, std::span<const std::string> queries,
                              const FeatureStore& features, int top_k, int threads) {
  return index.Best(queries, VectorsOf(queries, features, index.vocabulary(), threads), top_k,
                    threads);
}

}  // namespace raylift
