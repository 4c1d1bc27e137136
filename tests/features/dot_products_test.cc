#include "features/dot_products.h"

#include "base/instruction_sets.h"
#include "base/rng.h"
#include "features/dot_kernels.h"
#include "support/matchers.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

// Any values that quantized descriptors may have.
QuantizedDescriptors RandomDescriptors(Eigen::Index dimension, Eigen::Index count, Rng& rng) {
  Eigen::MatrixXf values(dimension, count);
  for (float& value : values.reshaped()) value = static_cast<float>(rng.Uniform(-1, 1));
  return QuantizeDirections(values);
}

TEST(DotProducts, EverySimdLevelGivesTheExactOnes) {
  Rng rng = TestRng();
  for (const Eigen::Index dimension : {1, 2, 33, 64, 128, 256}) {
    for (const Eigen::Index count : {1, 7, 8, 15, 16, 17, 50}) {
      const QuantizedDescriptors rows = RandomDescriptors(dimension, 21, rng);
      const QuantizedDescriptors columns = RandomDescriptors(dimension, count, rng);
      const DotColumns packed(columns);
      std::vector<int32_t> dots(16 * packed.stride());
      for (const auto level : {SimdLevel::kSse2, SimdLevel::kAvx2, SimdLevel::kAvx512}) {
        if (!IsSupported(level)) continue;
        OverrideSimdLevel(level);
        packed.ComputeDots(rows, kernels::kRowMultiple, 13, dots);
        for (Eigen::Index i = 0; i < 13; ++i) {
          for (Eigen::Index j = 0; j < count; ++j) {
            const int64_t expected = rows.values.col(kernels::kRowMultiple + i)
                                         .cast<int64_t>()
                                         .dot(columns.values.col(j).cast<int64_t>());
            ASSERT_EQ(dots[i * packed.stride() + j], expected)
                << ToString(level) << " " << dimension << " " << count;
          }
        }
      }
      OverrideSimdLevel(std::nullopt);
    }
  }
}

}  // namespace
}  // namespace raylift
