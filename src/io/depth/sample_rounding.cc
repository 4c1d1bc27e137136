#include <algorithm>
#include <bit>
#include <cmath>

#include "base/instruction_sets.h"
#include "io/depth/depth_formats.h"

#include "raylift/base/error.h"

namespace raylift {
namespace {

constexpr uint32_t kSign = 0x80000000u;
constexpr uint32_t kInfinity = 0x7f800000u;
constexpr uint32_t kSmallestNormalHalf = 0x38800000u;  // 2^-14
constexpr uint32_t kMaxHalfBits = 0x477fe000u;         // 65504

// Takes the bits of a finite float of at most kMaxHalf, without sign.
uint32_t HalfOfMagnitude(uint32_t magnitude) {
  // Half of the last bit that is kept, and a tie goes to the even neighbor; then the exponent's
  // bias changes from 127 to 15.
  const uint32_t normal = (magnitude + 0xfffu + ((magnitude >> 13) & 1u) - (112u << 23)) >> 13;
  // Adding 0.5 shifts the bits of a subnormal half to the end of the mantissa, rounded.
  const float shifted = std::bit_cast<float>(magnitude) + 0.5f;
  const uint32_t subnormal = std::bit_cast<uint32_t>(shifted) - std::bit_cast<uint32_t>(0.5f);
  return magnitude < kSmallestNormalHalf ? subnormal : normal;
}

float FloatOfMagnitude(uint32_t half) { return std::bit_cast<float>(half << 13) * 0x1p112f; }

struct Lost {
  size_t beyond;
  size_t dropped;  // with those beyond
  double max_rounding;
};

void Add(const Lost& lost, DepthWriteReport& report) {
  report.dropped += lost.dropped;
  report.max_rounding = std::max(report.max_rounding, lost.max_rounding);
}

// Chunks, so that counts fit into the lanes of floats.
constexpr size_t kChunk = size_t{1} << 16;

RAYLIFT_FOR_EACH_ISA
Lost RoundChunkToHalf(const float* __restrict values, uint16_t* __restrict halves, size_t count) {
  uint32_t beyond = 0;
  uint32_t dropped = 0;
  float max_rounding = 0;
#pragma omp simd reduction(+ : beyond, dropped) reduction(max : max_rounding)
  for (size_t i = 0; i < count; ++i) {
    const auto bits = std::bit_cast<uint32_t>(values[i]);
    const uint32_t magnitude = bits & ~kSign;
    const uint32_t sign = (bits & kSign) >> 16;
    const bool is_finite = magnitude < kInfinity;
    const bool is_beyond = is_finite && magnitude > kMaxHalfBits;
    const uint32_t special = magnitude > kInfinity ? 0x7e00u : 0x7c00u;
    const uint32_t finite = is_beyond ? 0u : HalfOfMagnitude(magnitude);
    const uint32_t half = is_finite ? finite : special;
    const bool is_lost = half == 0 && magnitude != 0;
    halves[i] = static_cast<uint16_t>(is_beyond ? 0u : half | sign);
    beyond += is_beyond ? 1u : 0u;
    dropped += is_lost ? 1u : 0u;
    // A difference of neighbors is exact in float.
    const float rounding = std::abs(FloatOfMagnitude(finite) - std::bit_cast<float>(magnitude));
    const float kept = is_finite && !is_beyond ? rounding : 0.0f;
    max_rounding = kept > max_rounding ? kept : max_rounding;
  }
  return {beyond, dropped, double{max_rounding}};
}

RAYLIFT_FOR_EACH_ISA
Lost RoundChunkToSteps(const float* __restrict values, double step, uint16_t* __restrict counts,
                       size_t count) {
  int beyond = 0;
  int dropped = 0;
  double max_rounding = 0;
#pragma omp simd reduction(+ : beyond, dropped) reduction(max : max_rounding)
  for (size_t i = 0; i < count; ++i) {
    const auto value = double{values[i]};
    const double steps = value / step;
    // A comparison with NaN is false.
    const bool fits = steps > -0.5 && steps < 65535.5;
    const double safe = fits ? steps : 0.0;
    const auto below = static_cast<int>(safe);
    const int rounded = below + (safe - below >= 0.5 ? 1 : 0);
    counts[i] = static_cast<uint16_t>(rounded);
    beyond += fits ? 0 : 1;
    dropped += rounded == 0 && value != 0 ? 1 : 0;
    const double rounding = rounded == 0 ? 0.0 : std::abs(rounded * step - value);
    max_rounding = rounding > max_rounding ? rounding : max_rounding;
  }
  return {static_cast<size_t>(beyond), static_cast<size_t>(dropped), max_rounding};
}

}  // namespace

size_t RoundToHalf(std::span<const float> values, std::span<uint16_t> halves,
                   DepthWriteReport& report) {
  RAYLIFT_CHECK_EQ(values.size(), halves.size());
  size_t beyond = 0;
  for (size_t i = 0; i < values.size(); i += kChunk) {
    const size_t count = std::min(kChunk, values.size() - i);
    const Lost lost = RoundChunkToHalf(&values[i], &halves[i], count);
    beyond += lost.beyond;
    Add(lost, report);
  }
  return beyond;
}

size_t RoundToSteps(std::span<const float> values, double step, std::span<uint16_t> counts,
                    DepthWriteReport& report) {
  RAYLIFT_CHECK_EQ(values.size(), counts.size());
  size_t beyond = 0;
  for (size_t i = 0; i < values.size(); i += kChunk) {
    const size_t count = std::min(kChunk, values.size() - i);
    const Lost lost = RoundChunkToSteps(&values[i], step, &counts[i], count);
    beyond += lost.beyond;
    Add(lost, report);
  }
  return beyond;
}

}  // namespace raylift
