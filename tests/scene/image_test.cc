#include "raylift/scene/image.h"

#include <limits>

#include <gtest/gtest.h>

namespace raylift {
namespace {

template <typename T>
class NearestByteTest : public ::testing::Test {};

using FloatingPoint = ::testing::Types<float, double>;
TYPED_TEST_SUITE(NearestByteTest, FloatingPoint);

TYPED_TEST(NearestByteTest, HalvesGoUp) {
  using T = TypeParam;
  EXPECT_EQ(NearestByte(T{0}), 0);
  EXPECT_EQ(NearestByte(T{0.4375}), 0);
  EXPECT_EQ(NearestByte(T{0.5}), 1);
  EXPECT_EQ(NearestByte(T{1.5}), 2);
  EXPECT_EQ(NearestByte(T{127.4375}), 127);
  EXPECT_EQ(NearestByte(T{254.5}), 255);
}

TYPED_TEST(NearestByteTest, WhatIsBeyondGoesToTheNearestEnd) {
  using T = TypeParam;
  constexpr T kInfinity = std::numeric_limits<T>::infinity();
  EXPECT_EQ(NearestByte(T{-0.75}), 0);
  EXPECT_EQ(NearestByte(-kInfinity), 0);
  EXPECT_EQ(NearestByte(T{255.75}), 255);
  EXPECT_EQ(NearestByte(T{1e9}), 255);
  EXPECT_EQ(NearestByte(kInfinity), 255);
}

TYPED_TEST(NearestByteTest, NanIsZero) {
  EXPECT_EQ(NearestByte(std::numeric_limits<TypeParam>::quiet_NaN()), 0);
}

}  // namespace
}  // namespace raylift
