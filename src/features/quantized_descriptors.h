// Descriptors rounded to 16-bit integers. Their inner products are exact, hence the same for any
// order of summation, thread count and machine, and about twice as fast as in float, since every
// x86-64 multiplies and adds eight of them at once. Rounding changes a squared distance by about
// 2e-5; neighboring descriptors of photographs are 0.1 to 1 apart.

#pragma once

#include <cstdint>
#include <span>

#include <Eigen/Core>

namespace raylift {

// What 1.0 becomes. Inner products of vectors of at most unit length stay below 2^31 (for up to
// 65536 values, rounding included).
inline constexpr int kQuantizedOne = 32767;
inline constexpr int64_t kQuantizedOneSquared = int64_t{kQuantizedOne} * kQuantizedOne;

struct QuantizedDescriptors {
  // All zeros.
  QuantizedDescriptors(Eigen::Index dimension, Eigen::Index count);

  Eigen::Index dimension;
  Eigen::Index count;
  // A descriptor is a column. Sides are padded with zeros to what ComputeDots works in.
  Eigen::Matrix<int16_t, Eigen::Dynamic, Eigen::Dynamic> values;
};

// Columns scaled to unit length and rounded. A column that has no direction (all zero, or not
// finite) becomes zero.
QuantizedDescriptors QuantizeDirections(const Eigen::MatrixXf& descriptors);

// The products of descriptors [first_row, first_row + num_rows) of `rows` with all of `columns`,
// row after row; a row has DotStride(columns) places, of which the first columns.count are meant.
// first_row is even; dots has room for an even count of rows.
Eigen::Index DotStride(const QuantizedDescriptors& columns);
void ComputeDots(const QuantizedDescriptors& rows, Eigen::Index first_row, Eigen::Index num_rows,
                 const QuantizedDescriptors& columns, std::span<int32_t> dots);

// The first of the largest values; `values` is not empty.
size_t IndexOfMax(std::span<const int32_t> values);

// best[j], best_row[j] = values[j], row wherever values[j] > best[j].
void UpdateColumnBest(std::span<const int32_t> values, int32_t row, std::span<int32_t> best,
                      std::span<int32_t> best_row);

}  // namespace raylift
