// Compiled once per instruction set (raylift_add_kernels), each time with other flags: everything
// here but Multiply() has internal linkage, and no library header is used.

#include "features/dot_kernels.h"

#ifdef __SSE2__
#include <immintrin.h>
#endif

namespace raylift::kernels {
namespace {

// Sums of products, one for each of some columns.
#if RAYLIFT_KERNEL_BYTES == 64
struct Sums {
  __m512i value = _mm512_setzero_si512();

  // Adds the products of two values of a row with two of each column.
  void Add(int32_t of_row, const int16_t* of_columns) {
    const __m512i columns = _mm512_loadu_si512(of_columns);
    value = _mm512_add_epi32(value, _mm512_madd_epi16(_mm512_set1_epi32(of_row), columns));
  }
  void Store(int32_t* dots) const { _mm512_storeu_si512(dots, value); }
};
#elif RAYLIFT_KERNEL_BYTES == 32
struct Sums {
  __m256i value = _mm256_setzero_si256();

  void Add(int32_t of_row, const int16_t* of_columns) {
    const __m256i columns = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(of_columns));
    value = _mm256_add_epi32(value, _mm256_madd_epi16(_mm256_set1_epi32(of_row), columns));
  }
  void Store(int32_t* dots) const { _mm256_storeu_si256(reinterpret_cast<__m256i*>(dots), value); }
};
#elif defined(__SSE2__)
struct Sums {
  __m128i value = _mm_setzero_si128();

  void Add(int32_t of_row, const int16_t* of_columns) {
    const __m128i columns = _mm_loadu_si128(reinterpret_cast<const __m128i*>(of_columns));
    value = _mm_add_epi32(value, _mm_madd_epi16(_mm_set1_epi32(of_row), columns));
  }
  void Store(int32_t* dots) const { _mm_storeu_si128(reinterpret_cast<__m128i*>(dots), value); }
};
#else
struct Sums {
  int32_t value[4] = {};

  void Add(int32_t of_row, const int16_t* of_columns) {
    int16_t row[2];
    __builtin_memcpy(row, &of_row, sizeof(row));
    for (int i = 0; i < 4; ++i) {
      value[i] += row[0] * of_columns[2 * i] + row[1] * of_columns[2 * i + 1];
    }
  }
  void Store(int32_t* dots) const { __builtin_memcpy(dots, value, sizeof(value)); }
};
#endif

// The number of sums in a register; eight registers hold sums.
constexpr size_t kLanes = sizeof(Sums) / sizeof(int32_t);
constexpr size_t kParts = kLanes == kTileColumns ? 1 : 2;
constexpr size_t kRows = 8 / kParts;
static_assert(kTileColumns % (kParts * kLanes) == 0 && kRowMultiple % kRows == 0);

void MultiplyBlock(const int16_t* rows, const int16_t* columns, size_t dimension, int32_t* dots,
                   size_t stride) {
  Sums sums[kRows][kParts];
  for (size_t k = 0; k < dimension; k += 2, columns += 2 * kTileColumns) {
    for (size_t i = 0; i < kRows; ++i) {
      int32_t of_row;
      __builtin_memcpy(&of_row, rows + i * dimension + k, sizeof(of_row));
      for (size_t part = 0; part < kParts; ++part) {
        sums[i][part].Add(of_row, columns + 2 * kLanes * part);
      }
    }
  }
  for (size_t i = 0; i < kRows; ++i) {
    for (size_t part = 0; part < kParts; ++part) {
      sums[i][part].Store(dots + i * stride + kLanes * part);
    }
  }
}

}  // namespace

void RAYLIFT_KERNEL_LEVEL::Multiply(const int16_t* rows, size_t num_rows, const int16_t* tiles,
                                    size_t num_tiles, size_t dimension, int32_t* dots,
                                    size_t stride) {
  for (size_t tile = 0; tile < num_tiles; ++tile) {
    for (size_t i = 0; i < num_rows; i += kRows) {
      for (size_t j = 0; j < kTileColumns; j += kParts * kLanes) {
        MultiplyBlock(rows + i * dimension, tiles + tile * kTileColumns * dimension + 2 * j,
                      dimension, dots + i * stride + tile * kTileColumns + j, stride);
      }
    }
  }
}

}  // namespace raylift::kernels
