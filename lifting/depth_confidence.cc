#include "raylift/lifting/depth_confidence.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>

#include "base/index_sets.h"
#include "base/statistics.h"
#include "lifting/depth_correction_fit.h"
#include "lifting/factor_belief.h"
#include "lifting/reference_matches.h"

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

// A keypoint of a map as its match in another image sees it.
struct Observation : EpipolarError {
  double confidence;
  size_t bin = 0;  // of the confidences
};
using Observations = std::vector<std::vector<Observation>>;  // by reference

// Returns the confidence of the map's sample that is nearest to a pixel.
double ConfidenceAt(const DepthMap& confidences, const Camera& camera,
                    const Eigen::Vector2d& pixel) {
  const auto place = [](double at, int size_px, int map_px) {
    return std::clamp(static_cast<int>(at / size_px * map_px), 0, map_px - 1);
  };
  return static_cast<double>(
      confidences.At(place(pixel.x(), camera.width_px(), confidences.width_px),
                     place(pixel.y(), camera.height_px(), confidences.height_px)));
}

std::optional<EpipolarError> ErrorAt(const DepthObservation& seen, double z) {
  const auto projection = seen.other_camera->ImgFromCamWithJacobian(seen.line_in_other.At(z));
  if (!(z > 0) || !projection) return std::nullopt;
  return SplitByLine(projection->pixel - seen.other_px,
                     projection->jacobian * (seen.line_in_other.direction * z));
}

// Returns the half of the map's places that a pixel is in: places alternate as the squares of a
// chessboard.
size_t HalfOf(const Eigen::Vector2d& pixel, const Camera& camera) {
  const int place = PlaceOf(pixel, camera);
  return static_cast<size_t>(place / kPlacesPerSide + place % kPlacesPerSide) % 2;
}

// Returns the correction of each half of a map's places by the matches of the other half: those
// that it was fitted to do not show what a correction leaves wrong.
std::array<DepthCorrection, 2> HeldOutCorrections(const std::vector<DepthObservation>& seen,
                                                  const Camera& camera, AlignMode mode,
                                                  const MapAlignment& map) {
  if (mode == AlignMode::kOff || !map.own_correction) return {map.correction, map.correction};
  const double log_factor = UpperMedianOr(map.correction.log_factors, 0);
  std::array<std::vector<DepthObservation>, 2> shown;
  for (const DepthObservation& o : seen) shown[1 - HalfOf(o.pixel, camera)].push_back(o);
  const auto fit = [&](const std::vector<DepthObservation>& by) {
    return FitCorrection(by, camera, log_factor, std::nullopt, mode);
  };
  return {fit(shown[0]), fit(shown[1])};
}

// Returns the observations of one map; of many, some that are evenly spread.
std::vector<Observation> ObserveMap(const std::vector<DepthObservation>& seen,
                                    const DepthMap& confidences, const Camera& camera,
                                    const std::array<DepthCorrection, 2>& corrections) {
  constexpr size_t kMostOfMap = 500;
  std::vector<Observation> observations;
  for (const size_t i : EvenlySpaced(seen.size(), kMostOfMap)) {
    const Eigen::Vector2d& pixel = seen[i].pixel;
    const double confidence = ConfidenceAt(confidences, camera, pixel);
    if (!std::isfinite(confidence)) continue;
    const double z = corrections[HalfOf(pixel, camera)].Correct(seen[i].z, camera, pixel);
    if (const auto error = ErrorAt(seen[i], z)) observations.push_back({*error, confidence});
  }
  return observations;
}

// Drops matches that are off the epipolar lines, and returns the noise of keypoints.
double KeepAgreeing(Observations& observations, double extent_px) {
  constexpr double kGate = 3;  // deviations
  std::vector<double> across;
  for (const auto& of_map : observations) {
    for (const Observation& o : of_map) across.push_back(o.across_px);
  }
  const double noise_px = DeviationAmongOutliers(across, 0.5 * extent_px);
  for (auto& of_map : observations) {
    std::erase_if(
        of_map, [&](const Observation& o) { return !(std::abs(o.across_px) < kGate * noise_px); });
  }
  return noise_px;
}

// Puts the observations into bins of as many each, by confidence; equal ones into one. Returns the
// median confidence of each bin.
std::vector<double> SortIntoBins(Observations& observations) {
  constexpr size_t kBins = 16;
  std::vector<double> sorted;
  for (const auto& of_map : observations) {
    for (const Observation& o : of_map) sorted.push_back(o.confidence);
  }
  std::sort(sorted.begin(), sorted.end());
  std::vector<double> begins;  // the least confidence of each bin
  for (size_t i = 0; i < kBins && !sorted.empty(); ++i) {
    const double least = sorted[i * sorted.size() / kBins];
    if (begins.empty() || least > begins.back()) begins.push_back(least);
  }
  const auto bin_of = [&](double confidence) {
    return static_cast<size_t>(std::upper_bound(begins.begin(), begins.end(), confidence) -
                               begins.begin()) -
           1;
  };
  std::vector<std::vector<double>> of_bin(begins.size());
  for (const double confidence : sorted) of_bin[bin_of(confidence)].push_back(confidence);
  for (auto& of_map : observations) {
    for (Observation& o : of_map) o.bin = bin_of(o.confidence);
  }
  std::vector<double> medians;
  for (const auto& within : of_bin) medians.push_back(within[within.size() / 2]);
  return medians;
}

// The sigmas that are compared: 1e-4 to 1, a fifth apart.
constexpr size_t kNumSigmas = 51;
double SigmaOf(size_t level) {
  return std::pow(10, -4 * (1 - static_cast<double>(level) / (kNumSigmas - 1)));
}

// The log likelihood of each bin's observations for each sigma.
using Table = std::vector<std::array<double, kNumSigmas>>;

void Add(const Table& table, double factor, Table& sum) {
  for (size_t bin = 0; bin < sum.size(); ++bin) {
    for (size_t k = 0; k < kNumSigmas; ++k) sum[bin][k] += factor * table[bin][k];
  }
}

// The index of a sigma for each bin.
struct Levels {
  std::vector<size_t> of_bin;
  double likelihood = 0;
};

Levels SameForAll(const Table& table) {
  std::array<double, kNumSigmas> sum{};
  for (const auto& of_bin : table) {
    for (size_t k = 0; k < kNumSigmas; ++k) sum[k] += of_bin[k];
  }
  const auto best = std::max_element(sum.begin(), sum.end());
  return {std::vector<size_t>(table.size(), static_cast<size_t>(best - sum.begin())), *best};
}

// Returns the likeliest levels that never rise, by dynamic programming.
Levels Falling(const Table& table) {
  // For the bins so far, if the last one has this level or a lower one: the largest likelihood, and
  // the index of that level.
  std::vector<std::array<size_t, kNumSigmas>> chosen(table.size());
  std::array<double, kNumSigmas> most{};
  for (size_t bin = table.size(); bin-- > 0;) {
    // From the last bin to the first the levels never fall.
    double best = -std::numeric_limits<double>::infinity();
    size_t best_level = 0;
    for (size_t k = 0; k < kNumSigmas; ++k) {
      const double value = most[k] + table[bin][k];
      if (value > best) {
        best = value;
        best_level = k;
      }
      most[k] = best;
      chosen[bin][k] = best_level;
    }
  }
  Levels levels{.of_bin = {}, .likelihood = most.back()};
  size_t bound = kNumSigmas - 1;
  for (const auto& of_bin : chosen) levels.of_bin.push_back(bound = of_bin[bound]);
  return levels;
}

Levels Monotone(const Table& table) {
  const Levels falling = Falling(table);
  Levels rising = Falling({table.rbegin(), table.rend()});
  if (falling.likelihood >= rising.likelihood) return falling;
  std::reverse(rising.of_bin.begin(), rising.of_bin.end());
  return rising;
}

// Returns the least sigma that a bin's n observations distinguish from zero: it adds to their
// variance as much as that varies by chance, sqrt(2 / n) of it.
double LeastSigma(const Observations& observations, size_t num_bins, double noise_px) {
  std::vector<double> gains;
  for (const auto& of_map : observations) {
    for (const Observation& o : of_map) gains.push_back(o.gain_px);
  }
  const double per_bin = static_cast<double>(gains.size()) / static_cast<double>(num_bins);
  return noise_px / UpperMedianOr(std::move(gains), 1) * std::pow(2 / per_bin, 0.25);
}

class Likelihood {
 public:
  Likelihood(const Observations& observations, size_t num_bins, double noise_px, double extent_px,
             int threads)
      : observations_(observations),
        num_bins_(num_bins),
        noise_px_(noise_px),
        extent_px_(extent_px),
        least_sigma_(LeastSigma(observations, num_bins, noise_px)),
        threads_(threads) {}

  double Sigma(size_t level) const { return std::max(SigmaOf(level), least_sigma_); }

  // Levels by a choice, with the share of wrong matches that is likeliest with them.
  struct Fit {
    Levels levels;
    std::vector<Table> of_map;
    Table sum;
  };
  Fit FitBy(Levels (*choose)(const Table&)) const {
    constexpr int kRounds = 5;
    double wrong_share = 0.1;
    Fit fit;
    for (int round = 0; round < kRounds; ++round) {
      fit.of_map.assign(observations_.size(), {});
      ParallelFor(observations_.size(), threads_,
                  [&](size_t i) { fit.of_map[i] = TableOf(observations_[i], wrong_share); });
      fit.sum = Table(num_bins_);
      for (const Table& table : fit.of_map) Add(table, 1, fit.sum);
      fit.levels = choose(fit.sum);
      wrong_share = WrongShare(fit.levels, wrong_share);
    }
    return fit;
  }

 private:
  double Density(const Observation& o, size_t level) const {
    const double sigma_px = std::hypot(noise_px_, o.gain_px * Sigma(level));
    const double error = o.along_px / sigma_px;
    return std::exp(-0.5 * error * error) / (sigma_px * std::sqrt(2 * std::numbers::pi));
  }

  Table TableOf(const std::vector<Observation>& observations, double wrong_share) const {
    Table table(num_bins_);
    for (const Observation& o : observations) {
      for (size_t k = 0; k < kNumSigmas; ++k) {
        table[o.bin][k] += std::log((1 - wrong_share) * Density(o, k) + wrong_share / extent_px_);
      }
    }
    return table;
  }

  double WrongShare(const Levels& levels, double share) const {
    double wrong = 0;
    size_t count = 0;
    for (const auto& of_map : observations_) {
      for (const Observation& o : of_map) {
        const double if_wrong = share / extent_px_;
        wrong += if_wrong / (if_wrong + (1 - share) * Density(o, levels.of_bin[o.bin]));
        ++count;
      }
    }
    return wrong / static_cast<double>(count);
  }

  const Observations& observations_;
  size_t num_bins_;
  double noise_px_, extent_px_, least_sigma_;
  int threads_;
};

// Returns the likelihood of each map by the fit to the others.
std::vector<double> HeldOut(const Likelihood::Fit& fit, Levels (*choose)(const Table&)) {
  std::vector<double> values;
  for (const Table& own : fit.of_map) {
    Table others = fit.sum;
    Add(own, -1, others);
    const Levels levels = choose(others);
    double value = 0;
    for (size_t bin = 0; bin < own.size(); ++bin) value += own[bin][levels.of_bin[bin]];
    values.push_back(value);
  }
  return values;
}

// Returns the knots without those between two that are equal to them.
std::vector<ConfidenceWorth::Knot> KnotsOf(const Levels& levels,
                                           const std::vector<double>& confidences,
                                           const Likelihood& likelihood) {
  std::vector<ConfidenceWorth::Knot> knots;
  const std::vector<size_t>& of_bin = levels.of_bin;
  for (size_t i = 0; i < of_bin.size(); ++i) {
    const bool is_between =
        i > 0 && i + 1 < of_bin.size() && of_bin[i - 1] == of_bin[i] && of_bin[i + 1] == of_bin[i];
    if (!is_between) knots.push_back({confidences[i], likelihood.Sigma(of_bin[i])});
  }
  return knots;
}

}  // namespace

double ConfidenceWorth::SigmaAt(double confidence) const {
  RAYLIFT_CHECK(tells());
  if (std::isnan(confidence)) return std::max(knots.front().sigma, knots.back().sigma);
  const auto next = std::find_if(knots.begin(), knots.end(),
                                 [&](const Knot& knot) { return knot.confidence > confidence; });
  if (next == knots.begin()) return next->sigma;
  const Knot& before = *std::prev(next);
  if (next == knots.end()) return before.sigma;
  const double share = (confidence - before.confidence) / (next->confidence - before.confidence);
  return before.sigma * std::pow(next->sigma / before.sigma, share);
}

ConfidenceWorth LearnConfidence(const GeometrySource& source, const DepthFolder& maps,
                                const DepthAlignment& alignment,
                                std::span<const PosedImage> references,
                                std::span<const ReferenceMatch> matches, int threads) {
  constexpr double kFewestMaps = 8;
  const auto halves = HalvesByReference(matches, references.size());
  Observations observations(references.size());
  ParallelFor(references.size(), threads, [&](size_t i) {
    const auto confidences = maps.LoadConfidence(references[i]);
    if (confidences == nullptr) return;
    const Camera& camera = references[i].camera;
    const auto seen = ObserveDepth(source, references, references[i], halves[i],
                                   std::numeric_limits<double>::infinity());
    const MapAlignment map = alignment.maps.empty() ? MapAlignment() : alignment.maps[i];
    observations[i] = ObserveMap(seen, *confidences, camera,
                                 HeldOutCorrections(seen, camera, alignment.mode, map));
  });
  double extent_px = 0;
  for (const PosedImage& reference : references) {
    extent_px =
        std::max(extent_px, std::hypot(reference.camera.width_px(), reference.camera.height_px()));
  }
  const double noise_px = KeepAgreeing(observations, extent_px);
  std::erase_if(observations, [](const auto& of_map) { return of_map.empty(); });

  ConfidenceWorth worth;
  for (const auto& of_map : observations) worth.num_matches += of_map.size();
  if (observations.size() < 2) return worth;
  const std::vector<double> confidences = SortIntoBins(observations);
  const Likelihood likelihood(observations, confidences.size(), noise_px, extent_px, threads);
  const Likelihood::Fit common = likelihood.FitBy(&SameForAll);
  const Likelihood::Fit monotone = likelihood.FitBy(&Monotone);
  worth.common_sigma = likelihood.Sigma(common.levels.of_bin.front());
  const std::vector<double> by_common = HeldOut(common, &SameForAll);
  const std::vector<double> by_monotone = HeldOut(monotone, &Monotone);
  double squares = 0;
  for (size_t i = 0; i < by_common.size(); ++i) {
    const double difference = by_monotone[i] - by_common[i];
    worth.gain += difference;
    squares += difference * difference;
  }
  const auto num_maps = static_cast<double>(by_common.size());
  const double variance =
      (squares - worth.gain * worth.gain / num_maps) * num_maps / (num_maps - 1);
  worth.gain_sigma = std::sqrt(std::max(variance, 0.0));
  if (num_maps >= kFewestMaps && worth.gain > 2 * worth.gain_sigma) {
    worth.knots = KnotsOf(monotone.levels, confidences, likelihood);
  }
  return worth;
}

WeighedSource::WeighedSource(std::shared_ptr<const GeometrySource> source,
                             std::shared_ptr<const DepthFolder> maps, ConfidenceWorth worth)
    : source_(std::move(source)), maps_(std::move(maps)), worth_(std::move(worth)) {
  RAYLIFT_CHECK(source_ != nullptr && maps_ != nullptr && worth_.tells());
}

std::vector<std::optional<SurfacePoint>> WeighedSource::Lift(
    const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const {
  auto points = source_->Lift(reference, pixels);
  const auto confidences = maps_->LoadConfidence(reference);
  if (confidences == nullptr) return points;
  for (size_t i = 0; i < points.size(); ++i) {
    if (!points[i]) continue;
    points[i]->log_depth_sigma =
        worth_.SigmaAt(ConfidenceAt(*confidences, reference.camera, pixels[i]));
  }
  return points;
}

}  // namespace raylift
