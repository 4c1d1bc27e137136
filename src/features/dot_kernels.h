// Products of descriptors, compiled once per instruction set. They are of integers, so all sets give
// the same.

#pragma once

#include <cstddef>
#include <cstdint>

namespace raylift::kernels {

// Columns come in tiles of so many, rows in multiples of so many.
inline constexpr int kTileColumns = 16;
inline constexpr int kRowMultiple = 8;

// dots[i * stride + j] = row i . column j. Rows lie `dimension` (an even number) apart. A tile holds
// two values of each of its columns, then the next two: what one instruction multiplies and adds.
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
