// The scoring and refinement kernels, compiled once per instruction set and chosen at run time. All
// sets give the same bytes: the lanes are the same 64 bytes everywhere, sums are reduced in a fixed
// order and no multiplication is fused with an addition.

#pragma once

#include "base/instruction_sets.h"
#include "estimation/kernels/kernels.h"

namespace raylift::kernels {

// Returns the kernels of a level that is supported.
inline const KernelTable& KernelsOf(SimdLevel level) {
#if RAYLIFT_X86_KERNELS
  if (level == SimdLevel::kAvx512) return avx512::Kernels();
  if (level == SimdLevel::kAvx2) return avx2::Kernels();
#endif
  (void)level;
  return sse2::Kernels();
}

// Returns the kernels that the estimators use.
inline const KernelTable& ActiveKernels() { return KernelsOf(ActiveSimdLevel()); }

}  // namespace raylift::kernels
