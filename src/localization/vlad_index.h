// References by their VLAD vectors, from features that are in memory.

#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/features/vlad.h"
#include "raylift/scene/features.h"
#include "raylift/scene/retrieved.h"

namespace raylift {

class VladIndex {
 public:
  // The vocabulary is learned from the references alone, so that a query's references do not depend
  // on the other queries. All references must be in `features`.
  VladIndex(std::vector<std::string> references, const std::map<std::string, Features>& features,
            uint64_t seed, int threads);

  Eigen::VectorXf VectorOf(const Features& features) const;
  const Eigen::VectorXf& VectorOfReference(const std::string& name) const;

  // Of each query, whose vector is a column, the `top_k` most alike; none is its own reference.
  RetrievedLists Best(std::span<const std::string> queries, const Eigen::MatrixXf& vectors,
                      int top_k, int threads) const;

 private:
  std::vector<std::string> references_;
  Vocabulary vocabulary_;
  std::vector<Eigen::VectorXf> vectors_;  // of the references
  std::map<std::string, size_t> index_of_name_;
};

// Of queries whose features are in memory, too.
RetrievedLists RetrieveByVlad(const VladIndex& index, std::span<const std::string> queries,
                              const std::map<std::string, Features>& features, int top_k,
                              int threads);

}  // namespace raylift
