#include "estimation/reliable_pairs.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/statistics.h"
#include <Eigen/Geometry>

namespace raylift {
namespace {

// Parallaxes over the median one are sorted into bins that end here; the last is open.
constexpr std::array kBinEnds = {1.5, 2.0, 3.0, 4.5, 7.0};
constexpr size_t kNumBins = kBinEnds.size() + 1;

// A bin is trusted if no more than this share of its matches is there by chance.
constexpr double kMaxChanceShare = 0.1;

// Right matches lie within so many standard deviations; beyond twice as many there are none.
constexpr double kInnerSigmas = 2.5;
// Wrong ones are counted up to so many thresholds.
constexpr double kOuterThresholds = 10;

// The sine of the angle at the point over the baseline's length: about the inverse distance.
double InverseDistance(const PreparedProblem& problem, const SolverPose& pose,
                       const PreparedPair& pair) {
  const Eigen::Vector3d baseline = pose.rotation * problem.centers[pair.reference] +
                                   problem.PoseOfCamera(pose, pair.camera).translation;
  const Eigen::Vector3d reference_ray = pose.rotation * pair.reference_ray;
  return reference_ray.cross(pair.query_ray).norm() / baseline.norm();
}

struct Bin {
  int inner = 0;
  int outer = 0;
};

}  // namespace

std::vector<int> ReliablePairs(const PreparedProblem& problem, const SolverPose& pose,
                               const std::vector<double>& squared_residuals, double variance,
                               double limit) {
  const double inner = kInnerSigmas * std::sqrt(variance);
  const double outer_begin = 2 * inner;
  // Wide enough to count in, whatever the noise.
  const double outer_end = std::max(kOuterThresholds, 2 * outer_begin);

  std::vector<int> counted;
  std::vector<double> inverse_distances;  // of the counted
  std::vector<double> inner_distances;
  for (int i = 0; i < static_cast<int>(squared_residuals.size()); ++i) {
    if (squared_residuals[i] < outer_end * outer_end) {
      counted.push_back(i);
      inverse_distances.push_back(InverseDistance(problem, pose, problem.pairs[i]));
      if (squared_residuals[i] < inner * inner) inner_distances.push_back(inverse_distances.back());
    }
  }
  if (inner_distances.empty()) {
    return {};
  }
  const double median = UpperMedianInPlace(std::span(inner_distances));
  const auto bin_of = [median](double inverse_distance) {
    size_t bin = 0;
    while (bin < kBinEnds.size() && inverse_distance > kBinEnds[bin] * median) ++bin;
    return bin;
  };

  std::array<Bin, kNumBins> bins;
  for (size_t k = 0; k < counted.size(); ++k) {
    Bin& bin = bins[bin_of(inverse_distances[k])];
    const double e2 = squared_residuals[counted[k]];
    bin.inner += e2 < inner * inner ? 1 : 0;
    bin.outer += e2 > outer_begin * outer_begin ? 1 : 0;
  }
  // Residuals of wrong matches are spread evenly.
  const double inner_share = inner / (outer_end - outer_begin);
  std::vector<int> reliable;
  for (size_t k = 0; k < counted.size(); ++k) {
    const Bin& bin = bins[bin_of(inverse_distances[k])];
    if (squared_residuals[counted[k]] < limit &&
        bin.outer * inner_share <= kMaxChanceShare * bin.inner) {
      reliable.push_back(counted[k]);
    }
  }
  return reliable;
}

}  // namespace raylift
