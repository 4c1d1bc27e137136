// Fits causes of depth errors, each with the parameters that explain the errors best, see
// depth_explanation.h: motions of pixels or cameras, and changes of values.

#pragma once

#include <cmath>
#include <functional>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "diagnosis/depth_explanation.h"
#include <Eigen/Core>

#include "raylift/diagnosis/depth_faults.h"

namespace raylift {

// A pixel that both maps know.
struct CauseSample {
  size_t view = 0;
  Eigen::Vector2d pixel;
  Eigen::Vector3d ray;  // z = 1
  double estimated = 0, truth = 0;
  size_t block = 0;  // over all views
};

// Returns ln(estimated / predicted), nullopt where the cause predicts nothing.
using Residual = std::function<std::optional<double>(const CauseSample&)>;

// Returns ln(estimated / predicted), or nullopt where one of them is no depth.
inline std::optional<double> LogRatio(double estimated, double predicted) {
  if (!(estimated > 0) || !(predicted > 0)) return std::nullopt;
  return std::log(estimated / predicted);
}

inline double IdentityError(const CauseSample& sample) {
  return std::abs(std::log(sample.estimated / sample.truth));
}

// Returns the mean |residual|. A cause explains nothing where it predicts nothing.
inline double MeanError(const Residual& residual, std::span<const CauseSample> samples) {
  double sum = 0;
  for (const CauseSample& sample : samples) {
    const auto r = residual(sample);
    sum += r ? std::abs(*r) : IdentityError(sample);
  }
  return sum / static_cast<double>(samples.size());
}

// Returns the mean error without any cause.
inline double ErrorAsItIs(std::span<const CauseSample> samples) {
  return MeanError([](const CauseSample&) { return std::nullopt; }, samples);
}

using Parameters = std::vector<double>;

// Returns the parameters of least cost near the best of `starts`: along each axis by steps that
// halve, down to `stop`.
template <typename Cost>
Parameters FindLeast(const std::vector<Parameters>& starts, double step, double stop, Cost cost) {
  Parameters best = starts.front();
  double least = std::numeric_limits<double>::infinity();
  const auto consider = [&](const Parameters& parameters) {
    const double value = cost(parameters);
    if (!(value < least)) return false;
    least = value;
    best = parameters;
    return true;
  };
  for (const Parameters& start : starts) consider(start);
  for (; step >= stop; step /= 2) {
    constexpr int kMaxMoves = 50;
    bool has_moved = true;
    for (int move = 0; has_moved && move < kMaxMoves; ++move) {
      has_moved = false;
      for (size_t axis = 0; axis < best.size(); ++axis) {
        for (const double sign : {-1.0, 1.0}) {
          Parameters moved = best;
          moved[axis] += sign * step;
          has_moved = consider(moved) || has_moved;
        }
      }
    }
  }
  return best;
}

// A cause with its best parameters.
struct CauseFit {
  DepthFault cause;
  std::vector<double> size;
  double severity = 0;  // below 1: too little for a word
  Residual residual;
  // Causes of which this is a special case; it may explain as much as they do.
  std::vector<DepthFault> special_case_of = {};
};

using CauseFitter = std::function<std::optional<CauseFit>()>;

// Return fitters, each of which fits one cause to the training samples; views and samples must
// outlive them. MotionFitters() returns those of motions of pixels or of the camera.
std::vector<CauseFitter> MotionFitters(std::span<const ExplainedView> views,
                                       std::span<const CauseSample> training);
// FilterFitters() returns those of causes that give a pixel the depth of its neighbors.
std::vector<CauseFitter> FilterFitters(std::span<const ExplainedView> views,
                                       std::span<const CauseSample> training);
// Returns the share of pixels at depth edges of the truth that lie between its two surfaces, on
// none of their neighbors', in percent. Neither a factor of a view counts, nor what errors as they
// are elsewhere would do.
double FlyingPercent(std::span<const ExplainedView> views, std::span<const CauseSample> samples);
// ValueFitters() returns those of changes of the values (value_models.h).
std::vector<CauseFitter> ValueFitters(std::span<const ExplainedView> views,
                                      std::span<const CauseSample> training);

double MedianTrueDepth(std::span<const CauseSample> samples);

}  // namespace raylift
