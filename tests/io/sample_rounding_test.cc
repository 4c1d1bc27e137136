// Rounding to 16 bits, against Eigen's float16 and against arithmetic in double.

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <vector>

#include "io/depth/depth_formats.h"
#include "support/matchers.h"
#include <Eigen/Core>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace raylift {
namespace {

// Floats of all magnitudes that float16 knows, both signs, and all ties between two of them.
std::vector<float> FloatsAroundEveryHalf() {
  std::vector<float> floats;
  for (uint32_t bits = 0; bits < 0x7c00; ++bits) {
    const auto half = Eigen::numext::bit_cast<Eigen::half>(static_cast<uint16_t>(bits));
    const auto next = Eigen::numext::bit_cast<Eigen::half>(static_cast<uint16_t>(bits + 1));
    const auto value = static_cast<float>(half);
    const float tie = bits + 1 < 0x7c00 ? 0.5f * (value + static_cast<float>(next)) : value;
    for (const float f : {value, tie, std::nextafter(tie, 0.0f), std::nextafter(tie, 1e6f)}) {
      if (f > kMaxHalf) continue;
      floats.push_back(f);
      floats.push_back(-f);
    }
  }
  return floats;
}

TEST(SampleRounding, EveryHalfAndEveryTieIsEigens) {
  const std::vector<float> values = FloatsAroundEveryHalf();
  std::vector<uint16_t> halves(values.size());
  DepthWriteReport report;
  EXPECT_EQ(RoundToHalf(values, halves, report), 0u);
  size_t lost = 0;
  double max_rounding = 0;
  for (size_t i = 0; i < values.size(); ++i) {
    const Eigen::half expected(values[i]);
    ASSERT_EQ(halves[i], Eigen::numext::bit_cast<uint16_t>(expected)) << values[i];
    const auto rounded = static_cast<float>(expected);
    lost += rounded == 0 && values[i] != 0 ? 1 : 0;
    max_rounding = std::max(max_rounding, std::abs(double{rounded} - double{values[i]}));
  }
  EXPECT_EQ(report.dropped, lost);
  EXPECT_EQ(report.max_rounding, max_rounding);
}

TEST(SampleRounding, WhatFloat16CannotHoldIsCounted) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const std::array<float, 6> values = {
      65504, 65505, -1e9f, kInfinity, -kInfinity, std::numeric_limits<float>::quiet_NaN()};
  std::array<uint16_t, 6> halves{};
  DepthWriteReport report;
  EXPECT_EQ(RoundToHalf(values, halves, report), 2u);
  EXPECT_EQ(report.dropped, 2u);
  EXPECT_EQ(report.max_rounding, 0);
  EXPECT_THAT(halves, testing::ElementsAre(0x7bff, 0, 0, 0x7c00, 0xfc00, 0x7e00));
}

TEST(SampleRounding, StepsAreThoseOfDoubles) {
  Rng rng = TestRng();
  std::vector<float> values(100000);
  for (float& value : values) value = static_cast<float>(70 * rng.Uniform() - 1);
  std::vector<uint16_t> counts(values.size());
  DepthWriteReport report;
  const size_t beyond = RoundToSteps(values, 0.001, counts, report);
  size_t expected_beyond = 0;
  size_t expected_dropped = 0;
  for (size_t i = 0; i < values.size(); ++i) {
    const double count = std::round(double{values[i]} / 0.001);
    const bool fits = count >= 0 && count <= 65535;
    expected_beyond += fits ? 0 : 1;
    expected_dropped += !fits || count == 0 ? 1 : 0;
    ASSERT_EQ(counts[i], fits ? count : 0) << values[i];
  }
  EXPECT_EQ(beyond, expected_beyond);
  EXPECT_EQ(report.dropped, expected_dropped);
  EXPECT_LE(report.max_rounding, 0.0005 + 1e-12);  // the product is rounded, too
}

TEST(SampleRounding, StepsRoundTiesUpwards) {
  const std::array<float, 7> values = {
      0.5f, 1.5f, 2.5f, 65535.49f, 65535.5f, -0.4999f, std::numeric_limits<float>::quiet_NaN()};
  std::array<uint16_t, 7> counts{};
  DepthWriteReport report;
  EXPECT_EQ(RoundToSteps(values, 1, counts, report), 2u);
  EXPECT_EQ(report.dropped, 3u);
  EXPECT_THAT(counts, testing::ElementsAre(1, 2, 3, 65535, 0, 0, 0));
}

}  // namespace
}  // namespace raylift
