#include "diagnosis/convention_residuals.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <set>
#include <utility>

#include "base/rng.h"
#include "base/statistics.h"
#include "diagnosis/match_agreement.h"

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr size_t kFewestOfMap = 10;

// Returns the standard error of the median of values, from their median deviation as of normal
// ones.
double StandardErrorOfMedian(const std::vector<double>& values) {
  return kMedianErrorPerMeanError * kSigmaPerMad *
         UpperDeviation(values, UpperMedianOr(values, 0)) /
         std::sqrt(std::max<double>(1, static_cast<double>(values.size())));
}

Eigen::Vector2d Oriented(const Eigen::Vector2d& pixel, const Camera& camera,
                         MapOrientation orientation) {
  const double width = camera.width_px();
  const double height = camera.height_px();
  switch (orientation) {
    case MapOrientation::kAsStored:
      return pixel;
    case MapOrientation::kFlippedX:
      return {width - pixel.x(), pixel.y()};
    case MapOrientation::kFlippedY:
      return {pixel.x(), height - pixel.y()};
    case MapOrientation::kHalfTurn:
      return {width - pixel.x(), height - pixel.y()};
    case MapOrientation::kTransposed:
      return {pixel.y() * width / height, pixel.x() * height / width};
  }
  RAYLIFT_CHECK(false);
}

}  // namespace

double KnownUnit(double log_factor) {
  // Powers of ten, inches, feet, and TUM's 1/5000 taken as millimeters.
  constexpr std::array<double, 10> kUnits = {1, 10, 100, 1000, 1e4, 1e5, 0.0254, 0.3048, 0.2, 5000};
  constexpr double kNear = 0.03;
  for (const double unit : kUnits) {
    for (const double known : {std::log(unit), -std::log(unit)}) {
      if (std::abs(log_factor - known) < kNear) return known;
    }
  }
  return log_factor;
}

DataConvention Scaled(const DataConvention& convention, double log_factor) {
  DataConvention scaled = convention;
  scaled.scale *=
      convention.kind == DepthKind::kInverse ? std::exp(-log_factor) : std::exp(log_factor);
  return scaled;
}

ConventionResiduals::ConventionResiduals(const DoctorInput& input,
                                         std::span<const ReferenceMatch> matches)
    : input_(input) {
  const auto halves = HalvesByReference(matches, input.references.size());
  for (size_t map = 0; map < halves.size(); ++map) {
    for (const HalfMatch& match : halves[map]) {
      const auto ray = input_.references[map].camera.RayInCam(match.pixel);
      if (!ray || !(ray->z() > 0)) continue;
      keypoints_.push_back(
          {static_cast<int>(map), match.other, match.pixel, match.other_px, ray->z()});
    }
  }
}

size_t ConventionResiduals::NumPairs() const {
  std::set<std::pair<int, int>> pairs;
  for (const Keypoint& keypoint : keypoints_) {
    pairs.insert(std::minmax(keypoint.map, keypoint.other));
  }
  return pairs.size();
}

ConventionResiduals::Key ConventionResiduals::KeyOf(const DataConvention& convention) const {
  // What a depth map stores does not depend on the poses.
  return {convention.orientation, convention.first_sample_px,
          input_.map_size_px ? input_.as_read.poses : convention.poses};
}

void ConventionResiduals::Prepare(std::span<const DataConvention> conventions, int threads) {
  for (const DataConvention& convention : conventions) {
    const Key key = KeyOf(convention);
    if (!stored_.contains(key)) stored_.emplace(key, LookUp(convention, threads));
    if (observations_.contains(convention.poses)) continue;
    std::vector<Observation>& observations = observations_[convention.poses];
    observations.resize(keypoints_.size());
    ParallelFor(keypoints_.size(), threads,
                [&](size_t i) { observations[i] = Observe(keypoints_[i], convention.poses); });
  }
}

// Returns where the source, as it is read, has what the other reading finds at the keypoint.
Eigen::Vector2d ConventionResiduals::PlaceInMap(const Keypoint& keypoint,
                                                const DataConvention& convention) const {
  if (!input_.map_size_px) return keypoint.pixel;
  const Camera& camera = input_.references[static_cast<size_t>(keypoint.map)].camera;
  const auto relative = Combined(input_.as_read.orientation, convention.orientation);
  RAYLIFT_CHECK(relative.has_value());
  const Eigen::Vector2d image_px_per_map_px(
      static_cast<double>(camera.width_px()) / input_.map_size_px->width_px,
      static_cast<double>(camera.height_px()) / input_.map_size_px->height_px);
  const double shift_px = input_.as_read.first_sample_px - convention.first_sample_px;
  return Oriented(keypoint.pixel + shift_px * image_px_per_map_px, camera, *relative);
}

std::vector<std::optional<double>> ConventionResiduals::LookUp(const DataConvention& convention,
                                                               int threads) const {
  const std::vector<size_t> begins = MapBegins();
  std::vector<std::optional<double>> stored(keypoints_.size());
  ParallelFor(begins.size() - 1, threads, [&](size_t group) {
    const size_t begin = begins[group];
    const PosedImage& reference = input_.references[static_cast<size_t>(keypoints_[begin].map)];
    std::vector<Eigen::Vector2d> places;
    for (size_t i = begin; i < begins[group + 1]; ++i) {
      places.push_back(PlaceInMap(keypoints_[i], convention));
    }
    const auto points =
        input_.source.Lift(ReadAs(reference, input_.as_read.poses, convention.poses), places);
    for (size_t i = 0; i < places.size(); ++i) {
      if (!points[i]) continue;
      const double z = points[i]->depth_z;
      const auto ray = reference.camera.RayInCam(places[i]);
      if (!(z > 0) || !ray || !(ray->z() > 0)) continue;
      stored[begin + i] = input_.as_read.kind == DepthKind::kInverse ? 1 / z
                          : input_.as_read.kind == DepthKind::kRay   ? z / ray->z()
                                                                     : z;
      // Maps are float, and interpolated, as z where they store ray lengths.
      const double same_value = input_.as_read.kind == DepthKind::kRay ? 2e-4 : 1e-5;
      const bool masked = std::any_of(masked_.begin(), masked_.end(), [&](double value) {
        return std::abs(*stored[begin + i] / value - 1) < same_value;
      });
      if (masked) stored[begin + i].reset();
    }
  });
  return stored;
}

ConventionResiduals::Observation ConventionResiduals::Observe(const Keypoint& keypoint,
                                                              PoseConvention poses) const {
  const PosedImage map =
      ReadAs(input_.references[static_cast<size_t>(keypoint.map)], input_.as_read.poses, poses);
  const PosedImage other =
      ReadAs(input_.references[static_cast<size_t>(keypoint.other)], input_.as_read.poses, poses);
  const auto line = LineInOther(map, keypoint.pixel, other);
  RAYLIFT_CHECK(line.has_value());
  Observation observation{*line, TriangulateDepth(*line, other.camera, keypoint.other_px)};
  if (observation.depth && (observation.depth->projected_px - keypoint.other_px).norm() >
                               EpipolarThresholdPx(other.camera)) {
    observation.depth.reset();
  }
  return observation;
}

std::vector<std::optional<double>> ConventionResiduals::Depths(
    const DataConvention& convention) const {
  std::vector<std::optional<double>> depths = stored_.at(KeyOf(convention));
  const double change = convention.scale / input_.as_read.scale;
  for (size_t i = 0; i < depths.size(); ++i) {
    if (!depths[i]) continue;
    double& depth = *depths[i];
    depth *= change;
    if (convention.kind == DepthKind::kRay) depth *= keypoints_[i].ray_z;
    if (convention.kind == DepthKind::kInverse) depth = 1 / depth;
  }
  return depths;
}

MapScales ConventionResiduals::FitScales(const DataConvention& convention) const {
  MapScales scales;
  scales.log_factors.assign(num_maps(), 0);
  if (!input_.map_size_px) return scales;
  const std::vector<Observation>& observations = observations_.at(convention.poses);
  const auto depths = Depths(convention);
  std::vector<std::vector<WeightedValue>> of_map(num_maps());
  for (size_t i = 0; i < keypoints_.size(); ++i) {
    if (!depths[i] || !observations[i].depth) continue;
    of_map[static_cast<size_t>(keypoints_[i].map)].push_back(
        {std::log(observations[i].depth->z / *depths[i]), observations[i].depth->gain_px});
  }
  std::vector<WeightedValue> all;
  std::vector<double> own;
  for (const auto& values : of_map) {
    all.insert(all.end(), values.begin(), values.end());
    if (values.size() >= kFewestOfMap) own.push_back(WeightedMedian(values));
  }
  scales.common = {WeightedMedian(std::move(all)), StandardErrorOfMedian(own)};
  for (size_t m = 0; m < of_map.size(); ++m) {
    scales.log_factors[m] =
        of_map[m].size() >= kFewestOfMap ? WeightedMedian(of_map[m]) : scales.common.log_factor;
  }
  return scales;
}

std::vector<std::optional<TriangulatedDepth>> ConventionResiduals::Triangulated(
    PoseConvention poses) const {
  std::vector<std::optional<TriangulatedDepth>> depths;
  for (const Observation& observation : observations_.at(poses))
    depths.push_back(observation.depth);
  return depths;
}

std::vector<size_t> ConventionResiduals::MapBegins() const {
  std::vector<size_t> begins = {0};
  for (size_t i = 1; i < keypoints_.size(); ++i) {
    if (keypoints_[i].map != keypoints_[i - 1].map) begins.push_back(i);
  }
  begins.push_back(keypoints_.size());
  return begins;
}

std::vector<size_t> ConventionResiduals::Shuffled() const {
  std::vector<size_t> order(keypoints_.size());
  std::iota(order.begin(), order.end(), size_t{0});
  Rng rng(0);
  const std::vector<size_t> begins = MapBegins();
  for (size_t group = 0; group + 1 < begins.size(); ++group) {
    for (size_t i = begins[group]; i < begins[group + 1]; ++i) {
      const auto before = static_cast<uint32_t>(i - begins[group]);
      std::swap(order[i], order[begins[group] + rng.UniformIndex(before + 1)]);
    }
  }
  return order;
}

ConventionFit MakeFit(std::vector<double> errors_px, std::vector<double> chance_px) {
  ConventionFit fit{.asked = errors_px.size(), .count = errors_px.size()};
  const auto upper = [](std::vector<double>& values) {
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(values.size() * 3 / 4);
    std::nth_element(values.begin(), at, values.end());
    return *at;
  };
  if (!errors_px.empty()) {
    fit.upper_px = upper(errors_px);
    fit.median_px = UpperMedianInPlace(std::span(errors_px));
  }
  if (!chance_px.empty()) {
    fit.upper_chance_px = upper(chance_px);
    fit.median_chance_px = UpperMedianInPlace(std::span(chance_px));
  }
  return fit;
}

double ConventionResiduals::ErrorAt(const DataConvention& convention, size_t keypoint,
                                    double z) const {
  const Keypoint& k = keypoints_[keypoint];
  const Camera& camera = input_.references[static_cast<size_t>(k.other)].camera;
  const auto projected =
      camera.ImgFromCam(observations_.at(convention.poses)[keypoint].line_in_other.At(z));
  return projected ? std::min((*projected - k.other_px).norm(), kLargestPx) : kLargestPx;
}

ConventionFit ConventionResiduals::FitOf(const DataConvention& convention,
                                         std::span<const double> log_factor_of_map) const {
  const std::vector<Observation>& observations = observations_.at(convention.poses);
  const auto depths = Depths(convention);
  const std::vector<size_t> shuffled = Shuffled();
  std::vector<double> errors, chance;
  size_t asked = 0;
  for (size_t i = 0; i < keypoints_.size(); ++i) {
    if (!observations[i].depth) continue;
    ++asked;
    const double factor = std::exp(log_factor_of_map[static_cast<size_t>(keypoints_[i].map)]);
    if (depths[i]) errors.push_back(ErrorAt(convention, i, *depths[i] * factor));
    if (const auto& other = depths[shuffled[i]]) {
      chance.push_back(ErrorAt(convention, i, *other * factor));
    }
  }
  ConventionFit fit = MakeFit(std::move(errors), std::move(chance));
  fit.asked = asked;
  fit.coverage = static_cast<double>(fit.count) / std::max<double>(1, static_cast<double>(asked));
  return fit;
}

void ConventionResiduals::LimitChance(const DataConvention& convention,
                                      std::span<const std::optional<double>> depths,
                                      ConventionFit& fit) const {
  const std::vector<Observation>& observations = observations_.at(convention.poses);
  const auto right_depth = [&](size_t i) {
    return depths[i] ? observations[i].depth : std::optional<TriangulatedDepth>();
  };
  const std::vector<size_t> shuffled = Shuffled();
  std::vector<double> chance;
  for (size_t i = 0; i < keypoints_.size(); ++i) {
    const auto other = right_depth(shuffled[i]);
    if (right_depth(i) && other) chance.push_back(ErrorAt(convention, i, other->z));
  }
  if (chance.empty()) return;
  const ConventionFit of_right = MakeFit({}, std::move(chance));
  fit.median_chance_px = std::min(fit.median_chance_px, of_right.median_chance_px);
  fit.upper_chance_px = std::min(fit.upper_chance_px, of_right.upper_chance_px);
}

std::vector<std::optional<double>> ConventionResiduals::Errors(
    const DataConvention& convention, std::span<const double> log_factor_of_map) const {
  const auto depths = Depths(convention);
  std::vector<std::optional<double>> errors(keypoints_.size());
  for (size_t i = 0; i < keypoints_.size(); ++i) {
    if (!depths[i]) {
      if (!input_.map_size_px) errors[i] = kLargestPx;  // the ray passes the surface by
      continue;
    }
    errors[i] =
        ErrorAt(convention, i,
                *depths[i] * std::exp(log_factor_of_map[static_cast<size_t>(keypoints_[i].map)]));
  }
  return errors;
}

std::vector<std::optional<double>> ConventionResiduals::Errors(const DataConvention& convention,
                                                               double log_factor) const {
  return Errors(convention, std::vector<double>(num_maps(), log_factor));
}

}  // namespace raylift
