#include "localization/vlad_index.h"

#include <utility>

#include "localization/retrieved_lists.h"

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

Eigen::MatrixXf Stacked(std::span<const Eigen::VectorXf> columns) {
  Eigen::MatrixXf stacked(columns.empty() ? 0 : columns[0].size(),
                          static_cast<Eigen::Index>(columns.size()));
  for (size_t i = 0; i < columns.size(); ++i) {
    stacked.col(static_cast<Eigen::Index>(i)) = columns[i];
  }
  return stacked;
}

}  // namespace

VladIndex::VladIndex(std::vector<std::string> references,
                     const std::map<std::string, Features>& features, uint64_t seed, int threads)
    : references_(std::move(references)), vectors_(references_.size()) {
  std::vector<Features> of_references;
  for (const std::string& name : references_) of_references.push_back(features.at(name));
  vocabulary_ = TrainVocabulary(of_references, {.seed = seed, .threads = threads});
  ParallelFor(references_.size(), threads,
              [&](size_t i) { vectors_[i] = VectorOf(of_references[i]); });
  for (size_t i = 0; i < references_.size(); ++i) index_of_name_.emplace(references_[i], i);
}

Eigen::VectorXf VladIndex::VectorOf(const Features& features) const {
  return ComputeVlad(features, vocabulary_);
}

const Eigen::VectorXf& VladIndex::VectorOfReference(const std::string& name) const {
  return vectors_[index_of_name_.at(name)];
}

RetrievedLists VladIndex::Best(std::span<const std::string> queries, const Eigen::MatrixXf& vectors,
                               int top_k, int threads) const {
  RetrievedLists lists = RetrieveTopK(vectors, Stacked(vectors_), top_k + 1, threads);
  DropOwn(queries, references_, top_k, &lists);
  return lists;
}

RetrievedLists RetrieveByVlad(const VladIndex& index, std::span<const std::string> queries,
                              const std::map<std::string, Features>& features, int top_k,
                              int threads) {
  std::vector<Eigen::VectorXf> vectors(queries.size());
  ParallelFor(queries.size(), threads,
              [&](size_t i) { vectors[i] = index.VectorOf(features.at(queries[i])); });
  return index.Best(queries, Stacked(vectors), top_k, threads);
}

}  // namespace raylift
