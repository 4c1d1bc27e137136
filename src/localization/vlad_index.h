// References by their VLAD vectors.

#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "localization/feature_store.h"
#include <Eigen/Core>

#include "raylift/features/vlad.h"
#include "raylift/scene/features.h"

namespace raylift {

// What references are retrieved by.
struct VladVectors {
  Vocabulary vocabulary;
  Eigen::MatrixXf of_references;  // a column each
};

// The vocabulary is learned from the references alone, so that a query's references do not depend
// on the other queries. All references must be in `features`.
VladVectors ComputeVladVectors(std::span<const std::string> references,
                               const FeatureStore& features, uint64_t seed, int threads);

class VladIndex {
 public:
  // One vector for each reference.
  VladIndex(std::vector<std::string> references, VladVectors vectors);

  const Vocabulary& vocabulary() const { return vectors_.vocabulary; }
  Eigen::VectorXf VectorOf(const Features& features) const;
  Eigen::VectorXf VectorOfReference(const std::string& name) const;

  // Of each query, whose vector is a column, the `top_k` most alike; none is its own reference.
  RetrievedLists Best(std::span<const std::string> queries, const Eigen::MatrixXf& vectors,
                      int top_k, int threads) const;

 private:
  std::vector<std::string> references_;
  VladVectors vectors_;
  std::map<std::string, Eigen::Index> index_of_name_;
};

// Of queries whose features are in the same store.
RetrievedLists RetrieveByVlad(const VladIndex& index, std::span<const std::string> queries,
                              const FeatureStore& features, int top_k, int threads);

}  // namespace raylift
