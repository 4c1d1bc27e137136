#include "diagnosis/stored_faults.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <tuple>
#include <utility>

#include "base/index_sets.h"
#include "base/rng.h"
#include "base/statistics.h"
#include "diagnosis/value_models.h"
#include "lifting/depth_convention.h"
#include <fmt/format.h>

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr size_t kMaps = 24;  // that are looked at
constexpr double kSameValue = 1e-6;

// Statistics of one map, in the unit of what it stores.
struct MapStatistics {
  size_t count = 0;
  double largest = 0;
  double smallest = std::numeric_limits<double>::infinity();
  size_t at_largest = 0;
  size_t at_smallest = 0;
};

std::vector<double> StoredValues(const DepthMap& map, const PosedImage& reference,
                                 const DoctorInput& input) {
  std::vector<float> ray_z;
  if (input.as_read.kind == DepthKind::kRay) {
    ray_z = RayZOfPixels(reference.camera.Scaled(map.width_px, map.height_px));
  }
  std::vector<double> values;
  for (size_t i = 0; i < map.z.size(); ++i) {
    double value = double{map.z[i]};
    if (!(value > 0)) continue;
    if (!ray_z.empty()) value /= double{ray_z[i]};
    if (input.as_read.kind == DepthKind::kInverse) value = 1 / value;
    values.push_back(value / input.stored->unit);
  }
  return values;
}

// Returns the nearest value that a file can store, a float or an integer; a map's z, multiplied by
// the unit, is not exactly it.
double NearestStored(double value) {
  const double integer = std::round(value);
  constexpr double kNear = 2e-7;
  return std::abs(value - integer) <= kNear * value ? integer : value;
}

MapStatistics Measure(const std::vector<double>& values) {
  MapStatistics statistics{.count = values.size()};
  if (values.empty()) return statistics;
  const auto [smallest, largest] = std::minmax_element(values.begin(), values.end());
  statistics.smallest = *smallest;
  statistics.largest = *largest;
  statistics.at_smallest = CountAt(values, *smallest, kSameValue);
  statistics.at_largest = CountAt(values, *largest, kSameValue);
  return statistics;
}

// Returns the extreme of all maps where many pixels of several maps have it.
std::optional<StoredExtreme> CommonExtreme(const std::vector<MapStatistics>& maps, bool largest) {
  constexpr double kLeastShare = 0.002;
  double value = largest ? 0 : std::numeric_limits<double>::infinity();
  size_t pixels = 0;
  for (const MapStatistics& map : maps) {
    value = largest ? std::max(value, map.largest) : std::min(value, map.smallest);
    pixels += map.count;
  }
  size_t at = 0;
  size_t maps_at = 0;
  for (const MapStatistics& map : maps) {
    const double extreme = largest ? map.largest : map.smallest;
    if (std::abs(extreme - value) > kSameValue * value) continue;
    const size_t count = largest ? map.at_largest : map.at_smallest;
    at += count;
    if (count > 1) ++maps_at;
  }
  if (pixels == 0 || maps_at < std::min<size_t>(maps.size(), 2)) return std::nullopt;
  const double share = static_cast<double>(at) / static_cast<double>(pixels);
  if (share < kLeastShare) return std::nullopt;
  return StoredExtreme{NearestStored(value), share, largest};
}

// Returns the moduli just above the largest value: powers of two of a stored 1, or of units from
// which floats were made.
std::vector<double> Moduli(double largest, double unit) {
  constexpr std::array<double, 5> kUnits = {1e-3, 1e-4, 2e-4, 1e-2, 1.0 / 256};
  std::vector<double> steps = {1};
  for (const double scene_units : kUnits) steps.push_back(scene_units / unit);
  std::vector<double> moduli;
  for (const double step : steps) {
    for (int bits = 7; bits <= 24; ++bits) {
      const double modulus = std::ldexp(step, bits);
      constexpr double kAbove = 1.1;
      if (largest > modulus || modulus > kAbove * largest) continue;
      const bool known = std::any_of(moduli.begin(), moduli.end(), [&](double other) {
        return std::abs(other / modulus - 1) < kSameValue;
      });
      if (!known) moduli.push_back(modulus);
    }
  }
  return moduli;
}

// The multiple of a modulus that is to be added to a depth, and the error then.
struct Unwrapped {
  double error_px;
  int multiples;
};

Unwrapped Unwrap(const ConventionResiduals& data, const DataConvention& convention, size_t keypoint,
                 double z, double modulus, double triangulated_z) {
  const int most = static_cast<int>(std::clamp(triangulated_z / modulus + 1, 0.0, 100.0));
  Unwrapped best{data.ErrorAt(convention, keypoint, z), 0};
  for (int k = 1; k <= most; ++k) {
    const double error_px = data.ErrorAt(convention, keypoint, z + k * modulus);
    if (error_px < best.error_px) best = {error_px, k};
  }
  return best;
}

// Depths with multiples of a modulus.
class UnwrapTrial {
 public:
  UnwrapTrial(const ConventionResiduals& data, const DataConvention& convention,
              double baseline_error_px)
      : data_(data),
        convention_(convention),
        depths_(data.Depths(convention)),
        triangulated_(data.Triangulated(convention.poses)),
        shuffled_(data.Shuffled()),
        exact_px_(ExactPx(baseline_error_px)) {}

  // Its share is of the keypoints that multiples mend: far off without them, about exact with.
  WrapFault Try(double z_modulus) const {
    constexpr double kFarOff = 5;
    WrapFault fault;
    fault.errors_px.resize(depths_.size());
    std::vector<double> errors_px, chance_px;
    size_t mended = 0;
    for (size_t i = 0; i < depths_.size(); ++i) {
      if (!depths_[i] || !triangulated_[i]) continue;
      const double z = triangulated_[i]->z;
      const Unwrapped unwrapped = Unwrap(data_, convention_, i, *depths_[i], z_modulus, z);
      errors_px.push_back(unwrapped.error_px);
      fault.errors_px[i] = unwrapped.error_px;
      const double before_px = data_.ErrorAt(convention_, i, *depths_[i]);
      if (unwrapped.error_px <= exact_px_ && before_px > kFarOff * unwrapped.error_px) ++mended;
      if (const auto& other = depths_[shuffled_[i]]) {
        chance_px.push_back(Unwrap(data_, convention_, i, *other, z_modulus, z).error_px);
      }
    }
    fault.share =
        static_cast<double>(mended) / std::max<double>(1, static_cast<double>(errors_px.size()));
    fault.fit = MakeFit(std::move(errors_px), std::move(chance_px));
    return fault;
  }

 private:
  const ConventionResiduals& data_;
  const DataConvention& convention_;
  std::vector<std::optional<double>> depths_;
  std::vector<std::optional<TriangulatedDepth>> triangulated_;
  std::vector<size_t> shuffled_;
  double exact_px_;
};

class AffineSearch {
 public:
  AffineSearch(const DoctorInput& input, const ConventionResiduals& data,
               const DataConvention& convention)
      : unit_(input.stored ? input.stored->unit : 1),
        data_(data),
        convention_(convention),
        depths_(data.Depths(convention)),
        triangulated_(data.Triangulated(convention.poses)),
        shuffled_(data.Shuffled()),
        halves_(SplitKeypoints(data)) {}

  std::optional<AffineFault> Fit(const AffineForm& form) const {
    const auto [inverse, common] = form;
    std::vector<std::vector<LineSample>> samples(common ? 1 : data_.num_maps());
    for (size_t i = 0; i < depths_.size(); ++i) {
      const auto& keypoint = data_.keypoints()[i];
      if (!depths_[i] || !triangulated_[i] || halves_[i] != Half::kFitting) continue;
      const double z = triangulated_[i]->z;
      samples[common ? 0 : static_cast<size_t>(keypoint.map)].push_back(
          {Value(i), inverse ? 1 / z : z, triangulated_[i]->gain_px});
    }
    std::vector<std::optional<ValueLine>> fits;
    for (const auto& of_map : samples) fits.push_back(FitLineRobustly(of_map));
    AffineFault fault{.form = form};
    const auto first =
        std::find_if(fits.begin(), fits.end(), [](const auto& f) { return f.has_value(); });
    if (first == fits.end()) return std::nullopt;
    fault.factor = (*first)->factor;
    fault.shift = (*first)->shift;
    fault.errors_px.resize(depths_.size());
    std::vector<double> errors_px, chance_px;
    for (size_t i = 0; i < depths_.size(); ++i) {
      const auto& keypoint = data_.keypoints()[i];
      if (!depths_[i] || !triangulated_[i] || halves_[i] != Half::kHeldOut) continue;
      const auto& fit = fits[common ? 0 : static_cast<size_t>(keypoint.map)];
      if (!fit) continue;
      errors_px.push_back(ErrorPx(i, Value(i), *fit, inverse));
      fault.errors_px[i] = errors_px.back();
      if (!depths_[shuffled_[i]]) continue;
      chance_px.push_back(ErrorPx(i, Value(shuffled_[i]), *fit, inverse));
    }
    fault.fit = MakeFit(std::move(errors_px), std::move(chance_px));
    return fault;
  }

 private:
  // Returns the depth as stored, along the axis.
  double Value(size_t i) const {
    return (convention_.kind == DepthKind::kInverse ? 1 / *depths_[i] : *depths_[i]) / unit_;
  }

  double ErrorPx(size_t i, double value, const ValueLine& fit, bool inverse) const {
    const double target = fit(value);
    if (!(target > 0)) return ConventionResiduals::kLargestPx;
    return data_.ErrorAt(convention_, i, inverse ? 1 / target : target);
  }

  double unit_;
  const ConventionResiduals& data_;
  const DataConvention& convention_;
  std::vector<std::optional<double>> depths_;
  std::vector<std::optional<TriangulatedDepth>> triangulated_;
  std::vector<size_t> shuffled_;
  std::vector<Half> halves_;
};

}  // namespace

std::vector<Half> SplitKeypoints(const ConventionResiduals& data) {
  std::map<std::pair<int, int>, Half> of_pair;
  std::vector<Half> halves;
  for (const ConventionResiduals::Keypoint& keypoint : data.keypoints()) {
    const auto pair = std::minmax(keypoint.map, keypoint.other);
    const auto [found, is_new] = of_pair.try_emplace(pair, Half::kFitting);
    if (is_new && StreamSeed(0, fmt::format("{} {}", pair.first, pair.second), "halves") % 2 == 0) {
      found->second = Half::kHeldOut;
    }
    halves.push_back(found->second);
  }
  // Pixels that are in both halves stay in one of them, by turns.
  struct PixelHalves {
    bool fitting = false;
    bool held_out = false;
    std::optional<Half> stays = std::nullopt;
  };
  std::map<std::tuple<int, double, double>, PixelHalves> pixels;
  const auto pixel_of = [&](size_t i) -> PixelHalves& {
    const ConventionResiduals::Keypoint& keypoint = data.keypoints()[i];
    return pixels[{keypoint.map, keypoint.pixel.x(), keypoint.pixel.y()}];
  };
  for (size_t i = 0; i < halves.size(); ++i) {
    (halves[i] == Half::kFitting ? pixel_of(i).fitting : pixel_of(i).held_out) = true;
  }
  Half turn = Half::kFitting;
  for (size_t i = 0; i < halves.size(); ++i) {
    PixelHalves& pixel = pixel_of(i);
    if (!pixel.fitting || !pixel.held_out) continue;
    if (!pixel.stays) {
      pixel.stays = turn;
      turn = turn == Half::kFitting ? Half::kHeldOut : Half::kFitting;
    }
    if (halves[i] != *pixel.stays) halves[i] = Half::kNeither;
  }
  return halves;
}

StoredStatistics LookAtMaps(const DoctorInput& input, int threads) {
  StoredStatistics statistics;
  if (!input.stored) return statistics;
  const std::vector<size_t> sample = EvenlySpaced(input.references.size(), kMaps);
  std::vector<MapStatistics> maps(sample.size());
  ParallelFor(sample.size(), threads, [&](size_t i) {
    const PosedImage& reference = input.references[sample[i]];
    const auto map = input.stored->load(reference);
    if (map != nullptr) maps[i] = Measure(StoredValues(*map, reference, input));
  });
  std::erase_if(maps, [](const MapStatistics& map) { return map.count == 0; });
  for (const bool largest : {true, false}) {
    if (const auto extreme = CommonExtreme(maps, largest)) statistics.extremes.push_back(*extreme);
  }
  for (const MapStatistics& map : maps) {
    statistics.largest = std::max(statistics.largest, map.largest);
  }
  return statistics;
}

std::optional<ClampFault> FindClamp(const ConventionResiduals& data,
                                    const ConventionResiduals& unmasked,
                                    const DataConvention& convention, const StoredExtreme& extreme,
                                    double usual_px) {
  constexpr size_t kFewestAtExtreme = 10;
  constexpr double kFarWorse = 3;
  const auto masked = data.Depths(convention);
  const auto depths = unmasked.Depths(convention);
  const auto triangulated = unmasked.Triangulated(convention.poses);
  const std::vector<double> log_factors = data.FitScales(convention).log_factors;
  std::vector<double> errors_px, ratios;
  for (size_t i = 0; i < depths.size(); ++i) {
    if (masked[i] || !depths[i] || !triangulated[i]) continue;
    const double factor = std::exp(log_factors[static_cast<size_t>(data.keypoints()[i].map)]);
    errors_px.push_back(unmasked.ErrorAt(convention, i, *depths[i] * factor));
    ratios.push_back(triangulated[i]->z / (*depths[i] * factor));
  }
  if (errors_px.size() < kFewestAtExtreme) return std::nullopt;
  if (UpperMedianOr(std::move(errors_px), 0) < kFarWorse * usual_px) return std::nullopt;
  const size_t num_keypoints = ratios.size();
  const double ratio = UpperMedianOr(std::move(ratios), 1);
  const bool farthest = extreme.largest != (convention.kind == DepthKind::kInverse);
  return ClampFault{.extreme = extreme,
                    .depth_ratio = ratio,
                    .num_keypoints = num_keypoints,
                    .is_cut_off = (ratio > 1) == farthest};
}

std::optional<WrapFault> FindWrap(const DoctorInput& input, const ConventionResiduals& data,
                                  const DataConvention& convention, double largest,
                                  double baseline_error_px, IsGoodFit is_good) {
  if (!input.stored || convention.kind != DepthKind::kZ) return std::nullopt;
  constexpr double kLeastShare = 0.03;
  // Multiples of any modulus mend some errors; those of the right one far more.
  constexpr std::array<double, 3> kControls = {0.83, 1.13, 1.29};
  constexpr double kTimesControl = 3;
  const UnwrapTrial trial(data, convention, baseline_error_px);
  std::optional<WrapFault> best;
  for (const double modulus : Moduli(largest, input.stored->unit)) {
    const double z_modulus = modulus * input.stored->unit;
    WrapFault fault = trial.Try(z_modulus);
    fault.modulus = modulus;
    if (fault.share < kLeastShare || !is_good(fault.fit, baseline_error_px)) continue;
    double control = 0;
    for (const double factor : kControls) {
      control = std::max(control, trial.Try(factor * z_modulus).share);
    }
    if (fault.share < kTimesControl * control) continue;
    if (!best || fault.fit.median_px < best->fit.median_px) best = std::move(fault);
  }
  return best;
}

std::optional<AffineFault> FindAffine(const DoctorInput& input, const ConventionResiduals& data,
                                      const DataConvention& convention,
                                      std::span<const AffineForm> forms, double baseline_error_px,
                                      IsGoodFit is_good) {
  constexpr size_t kFewest = 50;
  constexpr double kClearlyBetter = 0.9;
  const AffineSearch search(input, data, convention);
  std::optional<AffineFault> best;
  for (const AffineForm& form : forms) {
    auto fault = search.Fit(form);
    if (!fault || fault->fit.count < kFewest || !is_good(fault->fit, baseline_error_px)) continue;
    if (!best || fault->fit.median_px < kClearlyBetter * best->fit.median_px) {
      best = std::move(fault);
    }
  }
  return best;
}

}  // namespace raylift
