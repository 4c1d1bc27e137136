// Computes dot products of many vectors: exact ones of rounded descriptors, and searches for the
// largest.

#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/features.h"

namespace raylift {

// Descriptors rounded to 16-bit integers. Their inner products are exact, hence the same for any
// order of summation, thread count and machine, and about twice as fast as in float, since one
// instruction multiplies and adds eight of them at once, or 32 (features/dot_kernels.h). Rounding
// changes a squared distance by about 2e-5; neighboring descriptors of photographs are 0.1 to 1
// apart.

// The integer for 1.0. Inner products of vectors of at most unit length stay below 2^31 (for up to
// 65536 values, rounding included).
inline constexpr int kQuantizedOne = 32767;
inline constexpr int64_t kQuantizedOneSquared = int64_t{kQuantizedOne} * kQuantizedOne;

struct QuantizedDescriptors {
  // Makes all zeros.
  QuantizedDescriptors(Eigen::Index dimension, Eigen::Index count);

  Eigen::Index dimension;
  Eigen::Index count;
  // The values; a descriptor is a column. Sides are padded with zeros to the multiples that
  // ComputeDots() needs.
  Eigen::Matrix<int16_t, Eigen::Dynamic, Eigen::Dynamic> values;
};

// Returns the columns scaled to unit length and rounded. A column that has no direction (all zero,
// or not finite) becomes zero.
QuantizedDescriptors QuantizeDirections(const Eigen::MatrixXf& descriptors);

// The second factor of ComputeDots, in the order in which its kernels read it.
class DotColumns {
 public:
  explicit DotColumns(const QuantizedDescriptors& descriptors);

  // Returns the number of products for which a row of ComputeDots() has room.
  Eigen::Index stride() const { return stride_; }
  // Computes the products of descriptors [first_row, first_row + num_rows) of `rows` with all
  // columns, row after row; of the stride() places of a row, the first ones, as many as there are
  // columns, count. first_row and the count of rows that `dots` has room for are multiples of
  // kernels::kRowMultiple.
  void ComputeDots(const QuantizedDescriptors& rows, Eigen::Index first_row, Eigen::Index num_rows,
                   std::span<int32_t> dots) const;

 private:
  Eigen::Index dimension_;
  Eigen::Index stride_;
  std::vector<int16_t> tiles_;
};

// Returns the index of the first of the largest values; `values` is not empty.
size_t IndexOfMax(std::span<const int32_t> values);

// Sets best[j], best_row[j] = values[j], row wherever values[j] > best[j].
void UpdateColumnBest(std::span<const int32_t> values, int32_t row, std::span<int32_t> best,
                      std::span<int32_t> best_row);

// Finds, for each query vector, the k reference vectors of the largest dot product: retrieval by
// global descriptors (VLAD, NetVLAD, AP-GeM, ...). References come in blocks, so that they need not
// fit into memory.
//
// Matrix products in float are fast, but their last digits depend on the machine and on where a
// vector stands in its block. They only choose here: whatever may be among the k best, given the
// largest rounding error that a sum in float can have, is scored again in double. So the result is
// that of dot products in double, equal vectors have equal scores, and neither blocks nor threads
// nor the machine change it.

class DotProductSearch {
 public:
  // Takes a column for each query; all values must be finite.
  DotProductSearch(Eigen::MatrixXf query_vectors, int k);

  // Adds the next references, a column each, numbered on from those before. `meanwhile` runs beside
  // the work, e.g. to read the next block.
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
