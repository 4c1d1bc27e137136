// Finds, for each query vector, the k reference vectors of the largest dot product: retrieval by
// global descriptors (VLAD, NetVLAD, AP-GeM, ...). References come in blocks, so that they need not
// fit into memory.
//
// Matrix products in float are fast, but their last digits depend on the machine and on where a
// vector stands in its block. They only choose here: whatever may be among the k best, given the
// largest rounding error that a sum in float can have, is scored again in double. So the result is
// that of dot products in double, equal vectors have equal scores, and neither blocks nor threads
// nor the machine change it.

#pragma once

#include <functional>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/features.h"

namespace raylift {

class DotProductSearch {
 public:
  // A query is a column; all values must be finite.
  DotProductSearch(Eigen::MatrixXf query_vectors, int k);

  // The next references, a column each, numbered on from those before. `meanwhile` runs beside the
  // work, e.g. to read the next block.
  void Add(const Eigen::MatrixXf& reference_vectors, int threads,
           const std::function<void()>& meanwhile = {});

  RetrievedLists Best() const;

 private:
  void TakeBest(Eigen::Index query, const Eigen::MatrixXf& reference_vectors);

  Eigen::MatrixXf query_vectors_;
  Eigen::VectorXf query_norms_;
  size_t k_;
  int num_references_ = 0;  // before the block in hand
  RetrievedLists best_;     // of each query a heap, its worst in front
  Eigen::MatrixXf scores_;  // in float, of the block in hand: references x queries
  Eigen::VectorXf block_norms_;
};

}  // namespace raylift
