// Comparisons that the tests share.

#pragma once

#include <functional>
#include <string>
#include <vector>

#include "base/rng.h"
#include <gtest/gtest.h>

#include "raylift/geometry/rigid3.h"

namespace raylift {

// The orientation within `deg` and the camera center within `units` of the expected pose.
::testing::AssertionResult IsNearPose(const Rigid3& actual, const Rigid3& expected, double deg,
                                      double units);

// Runs `action`, which must throw InputError; its message must contain each of `parts`.
::testing::AssertionResult FailsWithInputError(const std::function<void()>& action,
                                               const std::vector<std::string>& parts);

// A stream of its own for the running test, from the test's name.
Rng TestRng();

Rigid3 RandomRigid3(Rng& rng, double translation_extent);

}  // namespace raylift
