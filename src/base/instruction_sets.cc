#include "base/instruction_sets.h"

#include <atomic>

#include "raylift/base/error.h"

namespace raylift {
namespace {

std::atomic<SimdLevel>& ActiveLevel() {
  static std::atomic<SimdLevel> level{BestSimdLevel()};
  return level;
}

}  // namespace

std::string_view VectorInstructions() {
#if RAYLIFT_X86_KERNELS
  if (IsSupported(SimdLevel::kAvx512)) return "avx512";
  if (IsSupported(SimdLevel::kAvx2) && __builtin_cpu_supports("fma")) return "avx2";
  return __builtin_cpu_supports("avx") ? "avx" : "sse";
#else
  return "other";
#endif
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

bool IsSupported(SimdLevel level) {
#if RAYLIFT_X86_KERNELS
  switch (level) {
    case SimdLevel::kSse2:
      return true;
    case SimdLevel::kAvx2:
      return __builtin_cpu_supports("avx2");
    case SimdLevel::kAvx512:
      return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
             __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw");
  }
#endif
  return level == SimdLevel::kSse2;
}

SimdLevel BestSimdLevel() {
  for (const SimdLevel level : {SimdLevel::kAvx512, SimdLevel::kAvx2}) {
    if (IsSupported(level)) return level;
  }
  return SimdLevel::kSse2;
}

SimdLevel ActiveSimdLevel() { return ActiveLevel(); }

void OverrideSimdLevel(std::optional<SimdLevel> level) {
  RAYLIFT_CHECK(!level || IsSupported(*level));
  ActiveLevel() = level.value_or(BestSimdLevel());
}

}  // namespace raylift
