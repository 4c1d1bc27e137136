// Models of changed values of depth maps, which doctor and compare fit: values held at a largest or
// smallest one, a line v' = factor * v + shift of depth or of inverse depth, and steps. The doctor
// has the depths that some matches triangulate, each with an error of its own, and wrong ones among
// them; compare has the true depth of every pixel.

#pragma once

#include <cstddef>
#include <optional>
#include <span>

#include "raylift/scene/image.h"

namespace raylift {

// Returns how many of the values are `at`, to a relative difference of `tolerance`.
size_t CountAt(std::span<const double> values, double at, double tolerance);

struct ValueLine {
  double factor = 1;
  double shift = 0;

  double operator()(double value) const { return factor * value + shift; }
};

// Returns the least squares line from x to y; nullopt where all of x are the same.
std::optional<ValueLine> FitLine(std::span<const double> x, std::span<const double> y);

// A value and the target of its line, where a relative error of 1 in the target moves the keypoint
// by `px`.
struct LineSample {
  double value;
  double target;
  double px;
};

// Returns the line that minimizes sum ln(1 + e^2 / (3 px)^2), e = (line(value) - target) / target *
// px: the best of those through two samples each, then refined; its factor is positive. nullopt
// where there are too few samples.
std::optional<ValueLine> FitLineRobustly(std::span<const LineSample> samples);

// Values are `first` + k * `step` with whole k, of depth or of its inverse.
struct ValueSteps {
  double first = 0;
  double step = 0;  // scene units, or 1 / scene units
  double largest = 0;
  bool of_inverse = false;

  // Returns the bits of an integer that counts the steps from 0 to the largest value.
  double Bits() const;
  // Returns the depth of the step that is nearest to a depth.
  double Nearest(double z) const;
};

// Returns nullopt where values seem continuous, or their distances are no multiples of one step.
std::optional<ValueSteps> FindValueSteps(const DepthMap& map);

// Returns the step that the depths of a map are multiples of, in scene units, from a sample of its
// pixels; 0 where they seem continuous.
double FindQuantizationStep(const DepthMap& map);

}  // namespace raylift
