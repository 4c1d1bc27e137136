#include "raylift/lifting/depth_alignment.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>
#include <utility>

#include "base/index_sets.h"
#include "base/statistics.h"
#include "lifting/depth_correction_fit.h"
#include "lifting/factor_belief.h"
#include "lifting/reference_matches.h"

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

// Returns how far the projections are from the matches: infinitely where there is none.
std::vector<double> MatchDistances(const std::vector<DepthObservation>& observations,
                                   const Camera& camera, const DepthCorrection& correction) {
  std::vector<double> distances;
  for (const DepthObservation& o : observations) {
    const double z = correction.Correct(o.z, camera, o.pixel);
    const auto projected = o.other_camera->ImgFromCam(o.line_in_other.At(z));
    distances.push_back(projected ? (*projected - o.other_px).norm()
                                  : std::numeric_limits<double>::infinity());
  }
  return distances;
}

double RobustLogFactor(const std::vector<DepthObservation>& observations) {
  std::vector<WeightedValue> factors;
  for (const DepthObservation& o : observations) {
    const auto depth = TriangulateDepth(o.line_in_other, *o.other_camera, o.other_px);
    if (depth) factors.push_back({std::log(depth->z / o.z), depth->gain_px});
  }
  return WeightedMedian(std::move(factors));
}

// Matches farther than this from the epipolar line are wrong and not used.
constexpr double kEpipolarThresholdPx = 3;
// A map with fewer matches takes the factor that the other maps make likely.
constexpr size_t kMinMatches = 10;
constexpr std::array kModes = {AlignMode::kOff, AlignMode::kScale, AlignMode::kAffine,
                               AlignMode::kGrid};

// The loss of a group of matches under each mode: the sum of Cauchy's losses.
using Losses = std::array<double, kModes.size()>;

// Corrects one half of the groups of matches by a fit to the other half, and the other way around.
// Groups are of the other references, as all matches with one may be wrong together, of a place
// that looks alike; with one other reference alone of places of the map, as matches of one place
// are not independent. Returns the losses of each group.
std::vector<Losses> HeldOutLosses(const std::vector<DepthObservation>& observations,
                                  const Camera& camera) {
  // A match that is farther off is rather wrong, and as wrong as any: where Cauchy's density
  // 1 / (pi w (1 + (d / w)^2)) falls below that of a match anywhere along the epipolar line.
  const double extent_px = std::hypot(camera.width_px(), camera.height_px());
  const double width_px = kLossWidthPx;
  const double wrong_px =
      width_px * std::sqrt(std::max(extent_px / (std::numbers::pi * width_px) - 1, 0.0));
  std::map<int, std::vector<DepthObservation>> groups;
  for (const DepthObservation& o : observations) groups[o.other].push_back(o);
  if (groups.size() == 1) {
    groups.clear();
    for (const DepthObservation& o : observations) groups[PlaceOf(o.pixel, camera)].push_back(o);
  }
  std::vector<Losses> losses;
  for (const size_t half : {0, 1}) {
    std::vector<DepthObservation> shown;
    size_t index = 0;
    for (const auto& [key, group] : groups) {
      if (index++ % 2 != half) shown.insert(shown.end(), group.begin(), group.end());
    }
    if (shown.empty()) continue;
    std::array<DepthCorrection, kModes.size()> corrections;
    const double log_factor = RobustLogFactor(shown);
    for (size_t m = 0; m < kModes.size(); ++m) {
      if (kModes[m] == AlignMode::kOff) continue;
      corrections[m] = FitCorrection(shown, camera, log_factor, std::nullopt, kModes[m]);
    }
    index = 0;
    for (const auto& [key, group] : groups) {
      if (index++ % 2 != half) continue;
      Losses& of_group = losses.emplace_back();
      for (size_t m = 0; m < kModes.size(); ++m) {
        for (const double distance : MatchDistances(group, camera, corrections[m])) {
          const double loss = std::min(distance, wrong_px) / width_px;
          of_group[m] += std::log1p(loss * loss);
        }
      }
    }
  }
  return losses;
}

// Says whether the second mode leaves less by more than two standard errors.
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

// Chooses by some 30 of the maps that have matches for two fits.
AlignMode ChooseMode(const std::vector<std::vector<DepthObservation>>& observations,
                     std::span<const PosedImage> references, int threads) {
  constexpr size_t kMaps = 30;
  std::vector<size_t> rich;
  for (size_t i = 0; i < references.size(); ++i) {
    if (observations[i].size() >= 2 * kMinMatches) rich.push_back(i);
  }
  const std::vector<size_t> chosen = EvenlySpaced(rich.size(), kMaps);
  std::vector<std::vector<Losses>> of_maps(chosen.size());
  ParallelFor(chosen.size(), threads, [&](size_t k) {
    const size_t i = rich[chosen[k]];
    of_maps[k] = HeldOutLosses(observations[i], references[i].camera);
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

// Returns what the matches tell of the maps' factors.
FactorBeliefs BeliefsOf(const std::vector<std::vector<DepthObservation>>& observations,
                        std::span<const PosedImage> references, int threads) {
  std::vector<MapMatches> maps(observations.size());
  std::vector<double> epipolar_px;
  for (size_t i = 0; i < maps.size(); ++i) {
    const Camera& camera = references[i].camera;
    maps[i].extent_px = std::hypot(camera.width_px(), camera.height_px());
    for (const DepthObservation& o : observations[i]) {
      epipolar_px.push_back(o.epipolar_px);
      if (const auto depth = TriangulateDepth(o.line_in_other, *o.other_camera, o.other_px)) {
        maps[i].matches.push_back(
            {o.other, PlaceOf(o.pixel, camera), std::log(depth->z / o.z), depth->gain_px});
      }
    }
  }
  // The least noise of poses and pixels.
  constexpr double kLeastNoisePx = 0.25;
  const double noise_px =
      std::max(kLeastNoisePx, kSigmaPerMad * UpperMedianOr(std::move(epipolar_px), 0));
  return BelieveFactors(maps, noise_px, threads);
}

// Returns the observations but for those of references whose matches are wrong together.
std::vector<DepthObservation> WithoutMisled(const std::vector<DepthObservation>& observations,
                                            const FactorBelief& belief) {
  std::vector<DepthObservation> kept;
  for (const DepthObservation& o : observations) {
    if (std::find(belief.misled.begin(), belief.misled.end(), o.other) == belief.misled.end()) {
      kept.push_back(o);
    }
  }
  return kept;
}

// Returns a map's own correction, which its matches tell.
DepthCorrection OwnCorrection(const std::vector<DepthObservation>& observations,
                              const Camera& camera, const FactorBelief& belief, AlignMode mode) {
  // A fit is finer than a belief.
  constexpr double kLeastSigma = 0.01;
  const KnownFactor known = {
      .log_factor = belief.log_factor,
      .sigma = std::max(belief.sigma, kLeastSigma),
      .repeats = std::max(1.0, static_cast<double>(observations.size()) /
                                   static_cast<double>(belief.num_independent))};
  return FitCorrection(observations, camera, belief.log_factor, known, mode);
}

// Returns the median of the factors of the maps with a correction of their own; 0 for none.
double MedianLogFactor(std::span<const MapAlignment> maps) {
  std::vector<double> means;
  for (const MapAlignment& map : maps) {
    if (!map.own_correction) continue;
    const std::vector<double>& nodes = map.correction.log_factors;
    means.push_back(std::accumulate(nodes.begin(), nodes.end(), 0.0) /
                    static_cast<double>(nodes.size()));
  }
  return UpperMedianOr(std::move(means), 0);
}

// Returns the first mode that predicts as well as any; kOff where no map needs a factor.
AlignMode ModeOf(const std::vector<std::vector<DepthObservation>>& observations,
                 const FactorBeliefs& beliefs, std::span<const PosedImage> references,
                 AlignMode mode, int threads) {
  if (mode != AlignMode::kAuto) return mode;
  const AlignMode chosen = ChooseMode(observations, references, threads);
  return chosen == AlignMode::kScale && beliefs.all_right ? AlignMode::kOff : chosen;
}

double MedianOfAll(const std::vector<std::vector<double>>& lists) {
  std::vector<double> all;
  for (const auto& list : lists) all.insert(all.end(), list.begin(), list.end());
  return UpperMedianOr(std::move(all), 0);
}

// The cell of a grid and the position in it, for a coordinate in [0, extent] over nodes from end to
// end.
struct GridCoordinate {
  int cell;
  double fraction;
};

GridCoordinate LocateOnGrid(double coordinate, double extent, int nodes) {
  const double position = std::clamp(coordinate / extent, 0.0, 1.0) * (nodes - 1);
  const int cell = std::clamp(static_cast<int>(position), 0, std::max(nodes - 2, 0));
  return {cell, position - cell};
}

}  // namespace

std::array<GridWeight, 4> GridWeights(int columns, int rows, const Camera& camera,
                                      const Eigen::Vector2d& pixel) {
  const GridCoordinate x = LocateOnGrid(pixel.x(), camera.width_px(), columns);
  const GridCoordinate y = LocateOnGrid(pixel.y(), camera.height_px(), rows);
  const auto node = [&](int dx, int dy) {
    const int column = std::min(x.cell + dx, columns - 1);
    const int row = std::min(y.cell + dy, rows - 1);
    return static_cast<size_t>(row) * static_cast<size_t>(columns) + static_cast<size_t>(column);
  };
  return {{{node(0, 0), (1 - x.fraction) * (1 - y.fraction)},
           {node(1, 0), x.fraction * (1 - y.fraction)},
           {node(0, 1), (1 - x.fraction) * y.fraction},
           {node(1, 1), x.fraction * y.fraction}}};
}

double DepthCorrection::Correct(double z, const Camera& camera,
                                const Eigen::Vector2d& pixel) const {
  double log_factor = 0;
  for (const auto& [node, weight] : GridWeights(columns, rows, camera, pixel)) {
    log_factor += weight * log_factors[node];
  }
  return z * std::exp(log_factor) + shift;
}

AlignedSource::AlignedSource(std::shared_ptr<const GeometrySource> source,
                             std::map<std::string, DepthCorrection> correction_of_reference)
    : source_(std::move(source)), corrections_(std::move(correction_of_reference)) {
  RAYLIFT_CHECK(source_ != nullptr);
}

std::string AlignedSource::Description() const { return source_->Description() + ", aligned"; }

std::vector<std::optional<SurfacePoint>> AlignedSource::Lift(
    const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const {
  auto points = source_->Lift(reference, pixels);
  const auto correction = corrections_.find(reference.name);
  if (correction == corrections_.end()) return points;
  const Eigen::Vector3d center_in_world = reference.cam_from_world.OriginInSource();
  for (size_t i = 0; i < points.size(); ++i) {
    if (!points[i]) continue;
    SurfacePoint& point = *points[i];
    const double z = correction->second.Correct(point.depth_z, reference.camera, pixels[i]);
    if (!(z > 0)) {
      points[i].reset();
      continue;
    }
    const double factor = z / point.depth_z;
    point.point_in_world = center_in_world + factor * (point.point_in_world - center_in_world);
    point.depth_z = z;
  }
  return points;
}

std::map<std::string, DepthCorrection> DepthAlignment::Corrections() const {
  std::map<std::string, DepthCorrection> corrections;
  for (const MapAlignment& map : maps) corrections.emplace(map.reference, map.correction);
  return corrections;
}

DepthAlignment AlignDepth(const GeometrySource& source, std::span<const PosedImage> references,
                          std::span<const ReferenceMatch> matches, AlignMode mode, int threads) {
  RAYLIFT_CHECK(mode != AlignMode::kOff);
  const auto halves = HalvesByReference(matches, references.size());
  std::vector<std::vector<DepthObservation>> observations(references.size());
  ParallelFor(references.size(), threads, [&](size_t i) {
    observations[i] =
        ObserveDepth(source, references, references[i], halves[i], kEpipolarThresholdPx);
  });
  const FactorBeliefs beliefs = BeliefsOf(observations, references, threads);
  std::vector<std::vector<DepthObservation>> believed(references.size());
  for (size_t i = 0; i < references.size(); ++i) {
    believed[i] = WithoutMisled(observations[i], beliefs.of_map[i]);
  }

  DepthAlignment alignment;
  alignment.mode = ModeOf(believed, beliefs, references, mode, threads);
  alignment.maps.resize(references.size());
  ParallelFor(references.size(), threads, [&](size_t i) {
    MapAlignment& map = alignment.maps[i];
    const FactorBelief& belief = beliefs.of_map[i];
    map.reference = references[i].name;
    map.num_matches = belief.num_independent;
    map.own_correction =
        alignment.mode != AlignMode::kOff && belief.is_own && map.num_matches >= kMinMatches;
    if (map.own_correction) {
      map.correction = OwnCorrection(believed[i], references[i].camera, belief, alignment.mode);
    }
  });
  alignment.median_factor = std::exp(MedianLogFactor(alignment.maps));

  std::vector<std::vector<double>> before(references.size()), after(references.size());
  ParallelFor(references.size(), threads, [&](size_t i) {
    MapAlignment& map = alignment.maps[i];
    const Camera& camera = references[i].camera;
    if (alignment.mode != AlignMode::kOff && !map.own_correction) {
      // Few matches move a factor from what the others have as far as they are sure of it.
      const bool has_matches = map.num_matches > 0;
      map.correction.log_factors = {has_matches ? beliefs.of_map[i].log_factor
                                                : std::log(alignment.median_factor)};
    }
    before[i] = MatchDistances(observations[i], camera, {});
    after[i] = MatchDistances(observations[i], camera, map.correction);
    map.median_before_px = UpperMedianOr(before[i], 0);
    map.median_after_px = UpperMedianOr(after[i], 0);
  });
  alignment.median_before_px = MedianOfAll(before);
  alignment.median_after_px = MedianOfAll(after);
  return alignment;
}

}  // namespace raylift
