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

// The kernels of a level, or none if the processor or the build lacks it.
const KernelTable* FindKernels(SimdLevel level);

// What the estimators use: the best level's, unless a test has asked for another.
const KernelTable& ActiveKernels();
// For tests: none returns to the best level. Not for use while estimators run.
void OverrideSimdLevel(std::optional<SimdLevel> level);

}  // namespace raylift::kernels
