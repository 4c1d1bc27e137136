// Depth in steps: maps that were kept in few bits, of depth or of its inverse.

#pragma once

#include <optional>

#include "raylift/scene/image.h"

namespace raylift {

// Values are `first` + k * `step` with whole k, of depth or of its inverse.
struct ValueSteps {
  double first = 0;
  double step = 0;  // scene units, or 1 / scene units
  double largest = 0;
  bool of_inverse = false;

  // Of an integer that counts the steps from 0 to the largest value.
  double Bits() const;
  // The depth of the step that is nearest to a depth.
  double Nearest(double z) const;
};

// None where values seem continuous, or their distances are no multiples of one step.
std::optional<ValueSteps> FindValueSteps(const DepthMap& map);

}  // namespace raylift
