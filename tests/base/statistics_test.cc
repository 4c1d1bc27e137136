#include "base/statistics.h"

#include <array>
#include <stdexcept>

#include "base/constants.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

TEST(Median, OfAnOddCountIsTheMiddleValue) {
  std::array<double, 5> values = {9, -1, 4, 7, 0};
  EXPECT_EQ(UpperMedianInPlace(std::span<double>(values)), 4);
  EXPECT_EQ(MidpointMedianInPlace(std::span<double>(values)), 4);
  EXPECT_EQ(UpperMedianOr({9, -1, 4, 7, 0}, 5), 4);
}

TEST(Median, OfAnEvenCountIsTheUpperOfTheMiddleTwoOrTheirMidpoint) {
  std::array<float, 4> values = {8, 1, 3, 4};
  EXPECT_EQ(UpperMedianInPlace(std::span<float>(values)), 4);
  EXPECT_EQ(MidpointMedianInPlace(std::span<float>(values)), 3.5);
  EXPECT_EQ(UpperMedianOr({8, 1, 3, 4}, 0), 4);
}

TEST(Median, OfInfinitiesIsTheirs) {
  std::array<double, 2> half = {kInfinity, 1};
  EXPECT_EQ(UpperMedianInPlace(std::span<double>(half)), kInfinity);
  EXPECT_EQ(MidpointMedianInPlace(std::span<double>(half)), kInfinity);
  std::array<double, 2> all = {kInfinity, kInfinity};
  EXPECT_EQ(MidpointMedianInPlace(std::span<double>(all)), kInfinity);
}

TEST(Median, OfNoneIsWhatTheCallerSays) {
  EXPECT_EQ(UpperMedianOr({}, 0), 0);
  EXPECT_EQ(UpperMedianOr({}, kInfinity), kInfinity);
  EXPECT_THROW(UpperMedianInPlace(std::span<double>()), std::logic_error);
  EXPECT_THROW(MidpointMedianInPlace(std::span<float>()), std::logic_error);
}

TEST(WeightedMedian, IsWhereHalfOfTheWeightIsReached) {
  EXPECT_EQ(WeightedMedian({{5, 1}, {1, 1}, {3, 1}}), 3);
  EXPECT_EQ(WeightedMedian({{5, 10}, {1, 1}, {3, 1}}), 5);
  EXPECT_EQ(WeightedMedian({{2, 1}, {1, 1}}), 1);
  EXPECT_EQ(WeightedMedian({}), 0);
}

}  // namespace
}  // namespace raylift
