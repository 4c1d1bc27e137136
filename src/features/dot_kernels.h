// Products of descriptors, compiled once per instruction set. They are products of integers, so
// that all sets give the same.

#pragma once

#include <cstddef>
#include <cstdint>

namespace raylift::kernels {

// Columns come in tiles of so many, rows in multiples of so many.
inline constexpr int kTileColumns = 16;
inline constexpr int kRowMultiple = 8;

// Computes dots[i * stride + j] = row i . column j. Rows lie `dimension` (an even number) apart. A
// tile holds two values of each of its columns, then the next two: one instruction multiplies and
// adds these.
using MultiplyDescriptors = void(const int16_t* rows, size_t num_rows, const int16_t* tiles,
                                 size_t num_tiles, size_t dimension, int32_t* dots, size_t stride);

namespace sse2 {  // the baseline, on any processor
MultiplyDescriptors Multiply;
}
namespace avx2 {
MultiplyDescriptors Multiply;
}
namespace avx512 {
MultiplyDescriptors Multiply;
}

}  // namespace raylift::kernels
