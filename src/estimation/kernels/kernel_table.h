// The scoring and refinement kernels, compiled once per instruction set and chosen at run time. All
// sets give the same bytes: the lanes are the same 64 bytes everywhere, sums are reduced in a fixed
// order and no multiplication is fused with an addition.

#pragma once

#include <optional>
#include <string_view>

#include "estimation/kernels/kernels.h"

namespace raylift::kernels {

enum class SimdLevel { kSse2, kAvx2, kAvx512 };

// The best level that this processor and this build have.
SimdLevel BestSimdLevel();
std::string_view ToString(SimdLevel level);

// Returns the kernels of a level; null if the processor or the build lacks it.
const KernelTable* FindKernels(SimdLevel level);

// Returns the kernels that the estimators use: the best level's, unless a test asked for another.
const KernelTable& ActiveKernels();
// For tests: nullopt returns to the best level. Not for use while estimators run.
void OverrideSimdLevel(std::optional<SimdLevel> level);

}  // namespace raylift::kernels
