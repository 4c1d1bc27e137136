#include "lifting/factor_belief.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <utility>

#include "base/index_sets.h"
#include "base/statistics.h"

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

// Factors nearer to each other than this are one: a fit tells them apart, not a belief.
constexpr double kNodeStep = 0.01;
// These are the prior shares of patches and of pairs whose matches are wrong together, as
// look-alike places make some where a scene repeats itself. A tenth of these changes a bound by
// 2.3.
constexpr double kWrongPatches = 0.1;
constexpr double kWrongPairs = 0.02;
constexpr std::array kRightShares = {0.1, 0.5, 0.9};
constexpr std::array kDepthNoises = {0.01, 0.02, 0.04, 0.08, 0.16};                // t
constexpr std::array kSpreads = {0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64, 1.28};  // o
constexpr size_t kMapsAsked = 30;  // for what all have in common

using Curve = std::vector<double>;  // over the nodes of log factors

double LogSumExp(std::span<const double> values) {
  const double most = *std::max_element(values.begin(), values.end());
  double sum = 0;
  for (const double value : values) sum += std::exp(value - most);
  return most + std::log(sum);
}

double LogMeanExp(std::span<const double> values) {
  return LogSumExp(values) - std::log(static_cast<double>(values.size()));
}

// Holds the log factors at which likelihoods are evaluated: those that matches imply, but for a
// few, and 0.
class Nodes {
 public:
  explicit Nodes(std::span<const MapMatches> maps) {
    constexpr double kFew = 0.02;
    constexpr double kMargin = 0.1;
    std::vector<double> asked = {0};
    for (const MapMatches& map : maps) {
      for (const FactorMatch& match : map.matches) asked.push_back(match.log_factor);
    }
    const double low = std::min(0.0, QuantileInPlace(std::span(asked), kFew)) - kMargin;
    const double high = std::max(0.0, QuantileInPlace(std::span(asked), 1 - kFew)) + kMargin;
    first_ = std::lround(low / kNodeStep);
    count_ = static_cast<size_t>(std::lround(high / kNodeStep) - first_ + 1);
  }
  size_t count() const { return count_; }
  double At(size_t node) const {
    return kNodeStep * static_cast<double>(first_ + static_cast<long>(node));
  }
  size_t Zero() const { return static_cast<size_t>(-first_); }

 private:
  long first_;
  size_t count_;
};

// The matches of one patch with one reference.
struct PatchMatches {
  int other;
  std::vector<FactorMatch> of_places;
};

int PatchOf(int place) {
  const int row = place / kPlacesPerSide / kPlacesPerPatchSide;
  const int column = place % kPlacesPerSide / kPlacesPerPatchSide;
  return row * kPlacesPerSide + column;
}

std::vector<PatchMatches> ByPatch(const MapMatches& map) {
  std::map<std::pair<int, int>, std::map<int, std::vector<FactorMatch>>> sorted;
  for (const FactorMatch& match : map.matches) {
    sorted[{match.other, PatchOf(match.place)}][match.place].push_back(match);
  }
  std::vector<PatchMatches> patches;
  for (auto& [other_and_patch, places] : sorted) {
    patches.push_back({other_and_patch.first, {}});
    for (auto& [place, matches] : places) {
      const auto middle = matches.begin() + static_cast<std::ptrdiff_t>(matches.size() / 2);
      std::nth_element(
          matches.begin(), middle, matches.end(),
          [](const FactorMatch& a, const FactorMatch& b) { return a.log_factor < b.log_factor; });
      patches.back().of_places.push_back(*middle);
    }
  }
  return patches;
}

// Returns ln of the mean of exp(curve) under a normal distribution about each node.
Curve Smoothed(const Curve& curve, double sigma) {
  const double most = *std::max_element(curve.begin(), curve.end());
  const auto size = static_cast<std::ptrdiff_t>(curve.size());
  const auto reach =
      std::min(size - 1, static_cast<std::ptrdiff_t>(std::ceil(5 * sigma / kNodeStep)));
  std::vector<double> weights(static_cast<size_t>(reach + 1));
  double total = 0;
  for (size_t i = 0; i < weights.size(); ++i) {
    const double z = static_cast<double>(i) * kNodeStep / sigma;
    weights[i] = std::exp(-0.5 * z * z);
    total += (i == 0 ? 1 : 2) * weights[i];
  }
  std::vector<double> linear(curve.size());
  for (size_t i = 0; i < curve.size(); ++i) linear[i] = std::exp(curve[i] - most);
  Curve smoothed(curve.size());
  for (std::ptrdiff_t n = 0; n < size; ++n) {
    double sum = 0;
    for (std::ptrdiff_t k = std::max<std::ptrdiff_t>(0, n - reach);
         k <= std::min(size - 1, n + reach); ++k) {
      sum += weights[static_cast<size_t>(std::abs(k - n))] * linear[static_cast<size_t>(k)];
    }
    smoothed[static_cast<size_t>(n)] =
        most + std::log(std::max(sum / total, std::numeric_limits<double>::min()));
  }
  return smoothed;
}

struct Noise {
  double keypoint_px;
  double depth;
};

// Returns ln p(patch | a), without what is wrong together, at each node.
Curve OfPatch(const PatchMatches& patch, double extent_px, const Nodes& nodes, const Noise& noise) {
  std::array<Curve, kRightShares.size()> of_share;
  for (Curve& curve : of_share) curve.assign(nodes.count(), 0);
  for (const FactorMatch& match : patch.of_places) {
    for (size_t n = 0; n < nodes.count(); ++n) {
      const double ratio = std::exp(match.log_factor - nodes.At(n));
      const double sigma_px = std::hypot(noise.keypoint_px, match.gain_px * ratio * noise.depth);
      const double z = match.gain_px * (1 - ratio) / sigma_px;
      const double right =
          extent_px / sigma_px * std::exp(-0.5 * z * z) / std::sqrt(2 * std::numbers::pi);
      for (size_t i = 0; i < kRightShares.size(); ++i) {
        of_share[i][n] += std::log(kRightShares[i] * right + (1 - kRightShares[i]));
      }
    }
  }
  Curve curve(nodes.count());
  for (size_t n = 0; n < nodes.count(); ++n) {
    std::array<double, kRightShares.size()> values;
    for (size_t i = 0; i < kRightShares.size(); ++i) values[i] = of_share[i][n];
    curve[n] = LogMeanExp(values);
  }
  return Smoothed(curve, noise.depth);
}

// Mixes two likelihoods: matches are wrong together with the probability `wrong_share`, or else
// right.
struct Mixture {
  double wrong_share;
  double Right(double at_node) const { return std::log(1 - wrong_share) + at_node; }
  double Wrong(const Curve& curve) const { return std::log(wrong_share) + LogMeanExp(curve); }
  void Add(const Curve& curve, Curve& sum) const {
    const double wrong = Wrong(curve);
    for (size_t n = 0; n < curve.size(); ++n) {
      const std::array both = {Right(curve[n]), wrong};
      sum[n] += LogSumExp(both);
    }
  }
};
constexpr Mixture kPatches{kWrongPatches};
constexpr Mixture kPairs{kWrongPairs};

struct MapCurves {
  std::map<int, Curve> of_pairs;  // by the other reference
  Curve all;
};

MapCurves OfMap(std::span<const PatchMatches> patches, double extent_px, const Nodes& nodes,
                const Noise& noise) {
  MapCurves curves;
  curves.all.assign(nodes.count(), 0);
  for (const PatchMatches& patch : patches) {
    Curve& pair = curves.of_pairs[patch.other];
    pair.resize(nodes.count(), 0);
    kPatches.Add(OfPatch(patch, extent_px, nodes, noise), pair);
  }
  for (const auto& [other, pair] : curves.of_pairs) kPairs.Add(pair, curves.all);
  return curves;
}

// Holds ln p(matches | m, o) of one map, or summed over several, for each spread o and node m.
using Evidence = std::array<Curve, kSpreads.size()>;

Evidence EvidenceOf(const Curve& map) {
  Evidence evidence;
  for (size_t o = 0; o < kSpreads.size(); ++o) evidence[o] = Smoothed(map, kSpreads[o]);
  return evidence;
}

void Add(const Evidence& part, double sign, Evidence& sum) {
  for (size_t o = 0; o < kSpreads.size(); ++o) {
    for (size_t n = 0; n < sum[o].size(); ++n) sum[o][n] += sign * part[o][n];
  }
}

// Returns ln of what another map's factor is by the evidence of some.
Curve Prediction(const Evidence& evidence) {
  std::array<Curve, kSpreads.size()> parts;
  Curve prediction(evidence.front().size());
  for (size_t o = 0; o < kSpreads.size(); ++o) parts[o] = Smoothed(evidence[o], kSpreads[o]);
  for (size_t n = 0; n < prediction.size(); ++n) {
    std::array<double, kSpreads.size()> values;
    for (size_t o = 0; o < kSpreads.size(); ++o) values[o] = parts[o][n];
    prediction[n] = LogMeanExp(values);
  }
  return prediction;
}

// Says whether no factors explain the matches as well as any: with one step of spread about none,
// against all means and spreads alike likely.
bool AllRight(const Evidence& evidence, const Nodes& nodes) {
  constexpr double kLeastRange = 2;  // of log factors that may be: from a third to three times
  std::vector<double> values;
  for (const Curve& curve : evidence) values.insert(values.end(), curve.begin(), curve.end());
  const double range = std::max(static_cast<double>(nodes.count()), kLeastRange / kNodeStep);
  const double some = LogSumExp(values) - std::log(range * kSpreads.size());
  return evidence.front()[nodes.Zero()] >= some;
}

// Computes quantiles of the belief in a log factor.
class Quantiles {
 public:
  Quantiles(const Curve& curve, const Nodes& nodes) : nodes_(nodes) {
    const double most = *std::max_element(curve.begin(), curve.end());
    double sum = 0;
    for (const double value : curve) cumulated_.push_back(sum += std::exp(value - most));
  }
  double At(double share) const {
    const double wanted = share * cumulated_.back();
    const auto node = static_cast<size_t>(
        std::lower_bound(cumulated_.begin(), cumulated_.end(), wanted) - cumulated_.begin());
    const double before = node == 0 ? 0 : cumulated_[node - 1];
    return nodes_.At(node) + kNodeStep * ((wanted - before) / (cumulated_[node] - before) - 0.5);
  }
  double Median() const { return At(0.5); }
  // Returns the standard deviation of the normal distribution with the same quartiles.
  double Sigma() const { return 0.5 * kSigmaPerMad * (At(0.75) - At(0.25)); }

 private:
  const Nodes& nodes_;
  std::vector<double> cumulated_;
};

FactorBelief Believe(std::span<const PatchMatches> patches, const MapCurves& curves,
                     const Curve& prediction, double depth_noise, const Nodes& nodes) {
  // The sigma with the map's own matches must be less than this share of that by the other maps.
  constexpr double kOwnSigma = 0.5;
  Curve posterior = prediction;
  for (size_t n = 0; n < posterior.size(); ++n) posterior[n] += curves.all[n];
  const Quantiles found(posterior, nodes);
  FactorBelief belief;
  belief.log_factor = found.Median();
  belief.sigma = found.Sigma();
  belief.is_own = belief.sigma < kOwnSigma * Quantiles(prediction, nodes).Sigma() ||
                  belief.sigma <= depth_noise;
  const auto likeliest =
      static_cast<size_t>(std::max_element(posterior.begin(), posterior.end()) - posterior.begin());
  for (const auto& [other, curve] : curves.of_pairs) {
    if (kPairs.Wrong(curve) > kPairs.Right(curve[likeliest])) belief.misled.push_back(other);
  }
  for (const PatchMatches& patch : patches) {
    if (std::find(belief.misled.begin(), belief.misled.end(), patch.other) == belief.misled.end()) {
      belief.num_independent += patch.of_places.size();
    }
  }
  return belief;
}

}  // namespace

int PlaceOf(const Eigen::Vector2d& pixel, const Camera& camera) {
  const auto along = [](double at, int size) {
    return static_cast<int>(std::clamp(at / size * kPlacesPerSide, 0.0, kPlacesPerSide - 1.0));
  };
  return along(pixel.y(), camera.height_px()) * kPlacesPerSide +
         along(pixel.x(), camera.width_px());
}

FactorBeliefs BelieveFactors(std::span<const MapMatches> maps, double keypoint_sigma_px,
                             int threads) {
  const Nodes nodes(maps);
  std::vector<std::vector<PatchMatches>> patches(maps.size());
  std::vector<size_t> asked;
  for (size_t i = 0; i < maps.size(); ++i) {
    patches[i] = ByPatch(maps[i]);
    if (!patches[i].empty()) asked.push_back(i);
  }
  std::vector<size_t> sample;
  for (const size_t k : EvenlySpaced(asked.size(), kMapsAsked)) sample.push_back(asked[k]);

  // The depths' noise is the one under which the sample's matches are likeliest.
  const auto curves_of = [&](size_t map, double depth) {
    return OfMap(patches[map], maps[map].extent_px, nodes, {keypoint_sigma_px, depth});
  };
  std::vector<double> likelihoods(kDepthNoises.size() * sample.size());
  ParallelFor(likelihoods.size(), threads, [&](size_t i) {
    likelihoods[i] =
        LogMeanExp(curves_of(sample[i % sample.size()], kDepthNoises[i / sample.size()]).all);
  });
  double depth_noise = kDepthNoises.front(), best = 0;
  for (size_t t = 0; t < kDepthNoises.size(); ++t) {
    double sum = 0;
    for (size_t k = 0; k < sample.size(); ++k) sum += likelihoods[t * sample.size() + k];
    if (t == 0 || sum > best) {
      best = sum;
      depth_noise = kDepthNoises[t];
    }
  }

  Evidence all;
  for (Curve& curve : all) curve.assign(nodes.count(), 0);
  std::vector<Evidence> of_sample(sample.size());
  ParallelFor(sample.size(), threads,
              [&](size_t k) { of_sample[k] = EvidenceOf(curves_of(sample[k], depth_noise).all); });
  for (const Evidence& evidence : of_sample) Add(evidence, 1, all);

  FactorBeliefs beliefs;
  beliefs.all_right = AllRight(all, nodes);
  beliefs.of_map.resize(maps.size());
  const Curve prediction = Prediction(all);
  ParallelFor(maps.size(), threads, [&](size_t i) {
    Curve by_others = prediction;
    const auto in_sample = std::find(sample.begin(), sample.end(), i);
    if (in_sample != sample.end()) {
      Evidence others = all;
      Add(of_sample[static_cast<size_t>(in_sample - sample.begin())], -1, others);
      by_others = Prediction(others);
    }
    beliefs.of_map[i] =
        Believe(patches[i], curves_of(i, depth_noise), by_others, depth_noise, nodes);
  });
  return beliefs;
}

}  // namespace raylift
