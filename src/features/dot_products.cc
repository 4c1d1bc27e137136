// Compiled with -O3 in every configuration: the loops here are those that must be vectorized.

#include "features/dot_products.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

#include "base/instruction_sets.h"
#include "features/dot_kernels.h"

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr Eigen::Index kDimensionMultiple = 2;
constexpr Eigen::Index kRowMultiple = kernels::kRowMultiple;
constexpr Eigen::Index kTileColumns = kernels::kTileColumns;
// Far below any descriptor, far above where its square underflows to nothing.
constexpr float kLeastNorm = 1e-12f;

Eigen::Index RoundUp(Eigen::Index n, Eigen::Index multiple) {
  return (n + multiple - 1) / multiple * multiple;
}

kernels::MultiplyDescriptors& ActiveKernel() {
#if RAYLIFT_X86_KERNELS
  if (ActiveSimdLevel() == SimdLevel::kAvx512) return kernels::avx512::Multiply;
  if (ActiveSimdLevel() == SimdLevel::kAvx2) return kernels::avx2::Multiply;
#endif
  return kernels::sse2::Multiply;
}

}  // namespace

QuantizedDescriptors::QuantizedDescriptors(Eigen::Index dimension_in, Eigen::Index count_in)
    : dimension(dimension_in), count(count_in) {
  values.setZero(RoundUp(dimension, kDimensionMultiple), RoundUp(count, kRowMultiple));
}

QuantizedDescriptors QuantizeDirections(const Eigen::MatrixXf& descriptors) {
  QuantizedDescriptors quantized(descriptors.rows(), descriptors.cols());
  for (Eigen::Index i = 0; i < descriptors.cols(); ++i) {
    const float norm = descriptors.col(i).norm();
    if (!std::isfinite(norm) || norm < kLeastNorm) {
      continue;
    }
    for (Eigen::Index k = 0; k < descriptors.rows(); ++k) {
      const float value = descriptors(k, i) * (kQuantizedOne / norm);
      // Rounds to the nearest; unlike std::lround, this is vectorized.
      quantized.values(k, i) = static_cast<int16_t>(value + std::copysign(0.5f, value));
    }
  }
  return quantized;
}

DotColumns::DotColumns(const QuantizedDescriptors& descriptors)
    : dimension_(descriptors.values.rows()),
      stride_(RoundUp(descriptors.count, kTileColumns)),
      tiles_(static_cast<size_t>(stride_ * dimension_)) {
  for (Eigen::Index j = 0; j < descriptors.count; ++j) {
    int16_t* const column = tiles_.data() + j / kTileColumns * kTileColumns * dimension_ +
                            j % kTileColumns * kDimensionMultiple;
    for (Eigen::Index k = 0; k < dimension_; k += kDimensionMultiple) {
      std::copy_n(&descriptors.values(k, j), kDimensionMultiple, column + k * kTileColumns);
    }
  }
}

void DotColumns::ComputeDots(const QuantizedDescriptors& rows, Eigen::Index first_row,
                             Eigen::Index num_rows, std::span<int32_t> dots) const {
  const Eigen::Index padded_rows = RoundUp(num_rows, kRowMultiple);
  RAYLIFT_CHECK_EQ(rows.values.rows(), dimension_);
  RAYLIFT_CHECK(first_row % kRowMultiple == 0 && first_row + padded_rows <= rows.values.cols());
  RAYLIFT_CHECK(static_cast<size_t>(padded_rows * stride_) <= dots.size());
  ActiveKernel()(rows.values.data() + first_row * dimension_, static_cast<size_t>(padded_rows),
                 tiles_.data(), static_cast<size_t>(stride_ / kTileColumns),
                 static_cast<size_t>(dimension_), dots.data(), static_cast<size_t>(stride_));
}

RAYLIFT_FOR_EACH_ISA
size_t IndexOfMax(std::span<const int32_t> values) {
  int32_t largest = values[0];
  for (const int32_t value : values) {
    largest = value > largest ? value : largest;
  }
  return static_cast<size_t>(std::find(values.begin(), values.end(), largest) - values.begin());
}

RAYLIFT_FOR_EACH_ISA
void UpdateColumnBest(std::span<const int32_t> values, int32_t row, std::span<int32_t> best,
                      std::span<int32_t> best_row) {
  for (size_t j = 0; j < values.size(); ++j) {
    const bool better = values[j] > best[j];
    best[j] = better ? values[j] : best[j];
    best_row[j] = better ? row : best_row[j];
  }
}

namespace {

// The side of a tile of the product, which is one thread's work: large enough that packing its
// factors costs little.
constexpr Eigen::Index kTileSide = 256;

// Returns the dot product in a fixed order, whatever the instruction set: the products of floats
// are exact in double.
double DotInDouble(const float* a, const float* b, Eigen::Index size) {
  constexpr Eigen::Index kLanes = 8;
  std::array<double, kLanes> sums{};
  Eigen::Index i = 0;
  for (; i + kLanes <= size; i += kLanes) {
    for (Eigen::Index lane = 0; lane < kLanes; ++lane) {
      sums[static_cast<size_t>(lane)] +=
          static_cast<double>(a[i + lane]) * static_cast<double>(b[i + lane]);
    }
  }
  for (; i < size; ++i) sums[0] += static_cast<double>(a[i]) * static_cast<double>(b[i]);
  return ((sums[0] + sums[4]) + (sums[1] + sums[5])) + ((sums[2] + sums[6]) + (sums[3] + sums[7]));
}

// Returns the largest error of a dot product in float, relative to the product of the norms, in
// whatever order it is summed (Higham, Accuracy and Stability of Numerical Algorithms, Sec. 3.1);
// twice that, as the norms are rounded, too.
float ErrorBound(Eigen::Index size) {
  return static_cast<float>(size + 2) * std::numeric_limits<float>::epsilon();
}

bool IsBetter(const RetrievedReference& a, const RetrievedReference& b) {
  return a.score != b.score ? a.score > b.score : a.reference_index < b.reference_index;
}

}  // namespace

DotProductSearch::DotProductSearch(Eigen::MatrixXf query_vectors, int k)
    : query_vectors_(std::move(query_vectors)),
      query_norms_(query_vectors_.colwise().norm()),
      k_(static_cast<size_t>(std::max(0, k))),
      best_(static_cast<size_t>(query_vectors_.cols())) {}

void DotProductSearch::Add(const Eigen::MatrixXf& reference_vectors, int threads,
                           const std::function<void()>& meanwhile) {
  const Eigen::Index references = reference_vectors.cols();
  const Eigen::Index queries = query_vectors_.cols();
  if (references > 0 && queries > 0) {
    RAYLIFT_CHECK_EQ(reference_vectors.rows(), query_vectors_.rows());
  }
  scores_.resize(references, queries);
  block_norms_.resize(references);
  const Eigen::Index rows = (references + kTileSide - 1) / kTileSide;
  const Eigen::Index columns = (queries + kTileSide - 1) / kTileSide;
  ParallelFor(static_cast<size_t>(1 + rows * columns), threads, [&](size_t item) {
    if (item == 0) {
      if (meanwhile) meanwhile();
      return;
    }
    const Eigen::Index row = (static_cast<Eigen::Index>(item) - 1) / columns * kTileSide;
    const Eigen::Index column = (static_cast<Eigen::Index>(item) - 1) % columns * kTileSide;
    const Eigen::Index height = std::min(kTileSide, references - row);
    const Eigen::Index width = std::min(kTileSide, queries - column);
    const auto block = reference_vectors.middleCols(row, height);
    if (column == 0) block_norms_.segment(row, height) = block.colwise().norm();
    scores_.block(row, column, height, width).noalias() =
        block.transpose() * query_vectors_.middleCols(column, width);
  });
  ParallelFor(static_cast<size_t>(queries), threads,
              [&](size_t query) { TakeBest(static_cast<Eigen::Index>(query), reference_vectors); });
  num_references_ += static_cast<int>(references);
}

void DotProductSearch::TakeBest(Eigen::Index query, const Eigen::MatrixXf& reference_vectors) {
  if (k_ == 0) return;
  std::vector<RetrievedReference>& heap = best_[static_cast<size_t>(query)];
  const Eigen::Index size = query_vectors_.rows();
  const float error = ErrorBound(size) * query_norms_[query];
  for (Eigen::Index i = 0; i < reference_vectors.cols(); ++i) {
    // Not "at least": a score in float that overflowed, and is no number, stays a candidate.
    if (heap.size() == k_ &&
        static_cast<double>(scores_(i, query) + error * block_norms_[i]) < heap.front().score) {
      continue;
    }
    const RetrievedReference candidate{
        num_references_ + static_cast<int>(i),
        DotInDouble(query_vectors_.col(query).data(), reference_vectors.col(i).data(), size)};
    if (heap.size() == k_) {
      if (!IsBetter(candidate, heap.front())) continue;
      std::pop_heap(heap.begin(), heap.end(), IsBetter);
      heap.pop_back();
    }
    heap.push_back(candidate);
    std::push_heap(heap.begin(), heap.end(), IsBetter);
  }
}

RetrievedLists DotProductSearch::Best() const {
  RetrievedLists sorted = best_;
  for (auto& list : sorted) std::sort(list.begin(), list.end(), IsBetter);
  return sorted;
}

}  // namespace raylift
