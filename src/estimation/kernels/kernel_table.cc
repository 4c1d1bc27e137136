#include "estimation/kernels/kernel_table.h"

#include <atomic>

#include "raylift/base/error.h"

namespace raylift::kernels {
namespace {

// Set by tests only.
std::atomic<const KernelTable*>& Override() {
  static std::atomic<const KernelTable*> table{nullptr};
  return table;
}

}  // namespace

const KernelTable* FindKernels(SimdLevel level) {
  switch (level) {
    case SimdLevel::kSse2:
      return &KernelTableSse2();
#if RAYLIFT_X86_KERNELS
    case SimdLevel::kAvx2:
      return __builtin_cpu_supports("avx2") ? &KernelTableAvx2() : nullptr;
    case SimdLevel::kAvx512:
      return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                     __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw")
                 ? &KernelTableAvx512()
                 : nullptr;
#else
    case SimdLevel::kAvx2:
    case SimdLevel::kAvx512:
      return nullptr;
#endif
  }
  return nullptr;
}

SimdLevel BestSimdLevel() {
  static const SimdLevel best = [] {
    for (const SimdLevel level : {SimdLevel::kAvx512, SimdLevel::kAvx2}) {
      if (FindKernels(level) != nullptr) return level;
    }
    return SimdLevel::kSse2;
  }();
  return best;
}

std::string_view ToString(SimdLevel level) {
  switch (level) {
    case SimdLevel::kSse2:
      return "baseline";
    case SimdLevel::kAvx2:
      return "avx2";
    case SimdLevel::kAvx512:
      return "avx512";
  }
  return "";
}

const KernelTable& ActiveKernels() {
  const KernelTable* table = Override();
  if (table == nullptr) table = FindKernels(BestSimdLevel());
  RAYLIFT_CHECK(table != nullptr);
  return *table;
}

void OverrideSimdLevel(std::optional<SimdLevel> level) {
  Override() = level ? FindKernels(*level) : nullptr;
}

}  // namespace raylift::kernels
