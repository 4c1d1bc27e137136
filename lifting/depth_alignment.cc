#include "raylift/lifting/depth_alignment.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <utility>

#include "base/hash.h"
#include "base/index_sets.h"
#include "base/statistics.h"
#include "depth_fit.h"

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {

namespace {

constexpr std::array kModes = {AlignMode::kOff, AlignMode::kScale, AlignMode::kAffine,
                               AlignMode::kGrid};

// What each mode leaves of a keypoint's matches: the sum of Cauchy's losses.
using Losses = std::array<double, kModes.size()>;

// Half of a map's keypoints are corrected by what the other half says, and the other way around.
std::vector<Losses> HeldOutLosses(const std::vector<DepthObservation>& observations,
                                  const Camera& camera, const AlignOptions& options) {
  std::map<uint64_t, Losses> losses;
  const auto hash = [](const DepthObservation& o) {
    return HashBytes64(AsBytes(std::span(o.pixel.data(), 2)));
  };
  for (const uint64_t half : {0, 1}) {
    std::vector<DepthObservation> shown, held_out;
    for (const DepthObservation& o : observations) {
      (hash(o) % 2 == half ? held_out : shown).push_back(o);
    }
    if (shown.empty()) continue;
    const double log_factor = RobustLogFactor(shown);
    for (size_t m = 0; m < kModes.size(); ++m) {
      AlignOptions fit = options;
      fit.mode = kModes[m];
      const DepthCorrection correction = kModes[m] == AlignMode::kOff
                                             ? DepthCorrection{}
                                             : FitCorrection(shown, camera, log_factor, fit);
      const auto distances = MatchDistances(held_out, camera, correction);
      for (size_t i = 0; i < held_out.size(); ++i) {
        // What does not project is as wrong as can be.
        const double most_px = std::hypot(camera.width_px(), camera.height_px());
        const double loss = std::min(distances[i], most_px) / options.loss_width_px;
        losses[hash(held_out[i])][m] += std::log1p(loss * loss);
      }
    }
  }
  std::vector<Losses> by_keypoint;
  by_keypoint.reserve(losses.size());
  for (const auto& [keypoint, loss] : losses) by_keypoint.push_back(loss);
  return by_keypoint;
}

// Whether the second mode leaves less by more than two standard errors.
bool IsWorse(const std::vector<Losses>& losses, size_t first, size_t second) {
  double sum = 0, squares = 0;
  for (const Losses& loss : losses) {
    const double difference = loss[first] - loss[second];
    sum += difference;
    squares += difference * difference;
  }
  const double variance = squares - sum * sum / static_cast<double>(losses.size());
  return sum > 2 * std::sqrt(std::max(variance, 0.0));
}

// By some 30 of the maps that have matches for two fits.
AlignMode ChooseMode(const std::vector<std::vector<DepthObservation>>& observations,
                     std::span<const PosedImage> references, const AlignOptions& options,
                     int threads) {
  constexpr size_t kMaps = 30;
  std::vector<size_t> rich;
  for (size_t i = 0; i < references.size(); ++i) {
    if (observations[i].size() >= 2 * options.min_matches) rich.push_back(i);
  }
  const std::vector<size_t> chosen = EvenlySpaced(rich.size(), kMaps);
  std::vector<std::vector<Losses>> of_maps(chosen.size());
  ParallelFor(chosen.size(), threads, [&](size_t k) {
    const size_t i = rich[chosen[k]];
    of_maps[k] = HeldOutLosses(observations[i], references[i].camera, options);
  });
  std::vector<Losses> losses;
  Losses sums{};
  for (const auto& of_map : of_maps) {
    for (const Losses& loss : of_map) {
      losses.push_back(loss);
      for (size_t m = 0; m < kModes.size(); ++m) sums[m] += loss[m];
    }
  }
  const auto best = static_cast<size_t>(std::min_element(sums.begin(), sums.end()) - sums.begin());
  size_t mode = 0;
  while (mode < best && IsWorse(losses, mode, best)) ++mode;
  return kModes[mode];
}

}  // namespace

std::map<std::string, DepthCorrection> DepthAlignment::Corrections() const {
  std::map<std::string, DepthCorrection> corrections;
  for (const MapAlignment& map : maps) corrections.emplace(map.reference, map.correction);
  return corrections;
}

DepthAlignment AlignDepth(const GeometrySource& source, std::span<const PosedImage> references,
                          std::span<const ReferenceMatch> matches, const AlignOptions& options,
                          int threads) {
  RAYLIFT_CHECK(options.mode != AlignMode::kOff);
  const auto halves = HalvesByReference(matches, references.size());
  std::vector<std::vector<DepthObservation>> observations(references.size());
  std::vector<double> log_factors(references.size(), 0);
  DepthAlignment alignment;
  alignment.maps.resize(references.size());
  ParallelFor(references.size(), threads, [&](size_t i) {
    observations[i] = ObserveDepth(source, references, references[i], halves[i], options);
    log_factors[i] = RobustLogFactor(observations[i]);
    MapAlignment& map = alignment.maps[i];
    map.reference = references[i].name;
    map.num_matches = observations[i].size();
  });
  alignment.mode = options.mode == AlignMode::kAuto
                       ? ChooseMode(observations, references, options, threads)
                       : options.mode;
  AlignOptions fit = options;
  fit.mode = alignment.mode;
  for (MapAlignment& map : alignment.maps) {
    map.own_correction =
        alignment.mode != AlignMode::kOff && map.num_matches >= options.min_matches;
  }

  std::vector<double> own_log_factors;
  for (size_t i = 0; i < references.size(); ++i) {
    if (alignment.maps[i].own_correction) own_log_factors.push_back(log_factors[i]);
  }
  const double median_log_factor = UpperMedianOr(own_log_factors, 0);
  alignment.median_factor = std::exp(median_log_factor);

  std::vector<std::vector<double>> before(references.size()), after(references.size());
  ParallelFor(references.size(), threads, [&](size_t i) {
    MapAlignment& map = alignment.maps[i];
    const Camera& camera = references[i].camera;
    map.correction.log_factors = {median_log_factor};
    if (map.own_correction) {
      map.correction = FitCorrection(observations[i], camera, log_factors[i], fit);
    }
    before[i] = MatchDistances(observations[i], camera, {});
    after[i] = MatchDistances(observations[i], camera, map.correction);
    map.median_before_px = UpperMedianOr(before[i], 0);
    map.median_after_px = UpperMedianOr(after[i], 0);
  });
  const auto median_of_all = [](const std::vector<std::vector<double>>& lists) {
    std::vector<double> all;
    for (const auto& list : lists) all.insert(all.end(), list.begin(), list.end());
    return UpperMedianOr(std::move(all), 0);
  };
  alignment.median_before_px = median_of_all(before);
  alignment.median_after_px = median_of_all(after);
  return alignment;
}

}  // namespace raylift
