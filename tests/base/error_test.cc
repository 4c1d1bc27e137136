#include "raylift/base/error.h"

#include <functional>
#include <limits>
#include <string>

#include <gtest/gtest.h>

namespace raylift {
namespace {

std::string ErrorOf(const std::function<void()>& check) {
  try {
    check();
  } catch (const OptionError& error) {
    return error.what();
  }
  return "no error";
}

TEST(OptionChecks, NameTheOptionItsValueAndTheConstraint) {
  EXPECT_EQ(ErrorOf([] { RequireAtLeast("views", 0, 1); }), "views = 0: must be at least 1");
  EXPECT_EQ(ErrorOf([] { RequireAtLeast("noise", -0.5, 0); }), "noise = -0.5: must be at least 0");
  EXPECT_EQ(ErrorOf([] { RequirePositive("scale", 0.0); }), "scale = 0: must be positive");
  EXPECT_EQ(ErrorOf([] { RequireAtLeast("views", 1, 1); }), "no error");
  EXPECT_EQ(ErrorOf([] { RequirePositive("scale", 1e-300); }), "no error");
}

TEST(OptionChecks, NumbersThatAreNotFiniteAreRefused) {
  for (const double value :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    EXPECT_NE(ErrorOf([&] { RequireAtLeast("a", value, 0); }), "no error");
    EXPECT_NE(ErrorOf([&] { RequirePositive("a", value); }), "no error");
  }
}

}  // namespace
}  // namespace raylift
