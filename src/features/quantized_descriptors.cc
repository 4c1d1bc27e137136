// Compiled with -O3 in every configuration: the loops here are those that must be vectorized.

#include "quantized_descriptors.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "raylift/base/error.h"

namespace raylift {
namespace {

constexpr Eigen::Index kDimensionMultiple = 16;
constexpr Eigen::Index kRowsAtOnce = 2;
constexpr Eigen::Index kColumnsAtOnce = 4;
// Far below any descriptor, far above where its square underflows to nothing.
constexpr float kLeastNorm = 1e-12f;

Eigen::Index RoundUp(Eigen::Index n, Eigen::Index multiple) {
  return (n + multiple - 1) / multiple * multiple;
}

// Two descriptors at a, four at b, each `dimension` (a multiple of kDimensionMultiple) apart: eight
// sums stay in registers, and six loads serve eight products.
void ComputeDots2x4(const int16_t* a, const int16_t* b, Eigen::Index dimension, int32_t* dots,
                    Eigen::Index stride) {
  const int16_t* const a0 = a;
  const int16_t* const a1 = a + dimension;
  const int16_t* const b0 = b;
  const int16_t* const b1 = b + dimension;
  const int16_t* const b2 = b + 2 * dimension;
  const int16_t* const b3 = b + 3 * dimension;
  int32_t s00 = 0, s01 = 0, s02 = 0, s03 = 0;
  int32_t s10 = 0, s11 = 0, s12 = 0, s13 = 0;
  for (Eigen::Index k = 0; k < dimension; ++k) {
    s00 += a0[k] * b0[k];
    s01 += a0[k] * b1[k];
    s02 += a0[k] * b2[k];
    s03 += a0[k] * b3[k];
    s10 += a1[k] * b0[k];
    s11 += a1[k] * b1[k];
    s12 += a1[k] * b2[k];
    s13 += a1[k] * b3[k];
  }
  dots[0] = s00;
  dots[1] = s01;
  dots[2] = s02;
  dots[3] = s03;
  dots[stride] = s10;
  dots[stride + 1] = s11;
  dots[stride + 2] = s12;
  dots[stride + 3] = s13;
}

}  // namespace

QuantizedDescriptors::QuantizedDescriptors(Eigen::Index dimension_in, Eigen::Index count_in)
    : dimension(dimension_in), count(count_in) {
  values.setZero(RoundUp(dimension, kDimensionMultiple), RoundUp(count, kColumnsAtOnce));
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

Eigen::Index DotStride(const QuantizedDescriptors& columns) { return columns.values.cols(); }

void ComputeDots(const QuantizedDescriptors& rows, Eigen::Index first_row, Eigen::Index num_rows,
                 const QuantizedDescriptors& columns, std::span<int32_t> dots) {
  const Eigen::Index stride = DotStride(columns);
  const Eigen::Index dimension = columns.values.rows();
  const Eigen::Index even_rows = RoundUp(num_rows, kRowsAtOnce);
  RAYLIFT_CHECK_EQ(rows.values.rows(), dimension);
  RAYLIFT_CHECK(first_row % kRowsAtOnce == 0 && first_row + even_rows <= rows.values.cols());
  RAYLIFT_CHECK(static_cast<size_t>(even_rows * stride) <= dots.size());
  for (Eigen::Index j = 0; j < stride; j += kColumnsAtOnce) {
    for (Eigen::Index i = 0; i < even_rows; i += kRowsAtOnce) {
      ComputeDots2x4(rows.values.col(first_row + i).data(), columns.values.col(j).data(), dimension,
                     dots.data() + i * stride + j, stride);
    }
  }
}

size_t IndexOfMax(std::span<const int32_t> values) {
  int32_t largest = values[0];
  for (const int32_t value : values) {
    largest = value > largest ? value : largest;
  }
  return static_cast<size_t>(std::find(values.begin(), values.end(), largest) - values.begin());
}

void UpdateColumnBest(std::span<const int32_t> values, int32_t row, std::span<int32_t> best,
                      std::span<int32_t> best_row) {
  for (size_t j = 0; j < values.size(); ++j) {
    const bool better = values[j] > best[j];
    best[j] = better ? values[j] : best[j];
    best_row[j] = better ? row : best_row[j];
  }
}

}  // namespace raylift
