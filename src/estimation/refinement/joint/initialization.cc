#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>

#include "base/statistics.h"
#include "estimation/kernels/kernel_table.h"
#include "estimation/refinement/joint/model.h"
#include "estimation/refinement/joint/student_t.h"
#include <Eigen/Geometry>

namespace raylift {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// No error is impossible.
constexpr double kLeastDensity = 1e-9;

// The residual in a reference, pixels, of a point that moves along the query's ray:
//   at_infinity + direction / (offset + slope * distance).
struct RayScan {
  Vector2d at_infinity, direction;
  double offset, slope;

  RayScan(const Observation& observation, const Vector3d& origin, const Vector3d& ray) {
    const Vector3d start = observation.image_from_ray * (origin - observation.center);
    const Vector3d turn = observation.image_from_ray * ray;
    offset = start.z();
    slope = turn.z();
    at_infinity = turn.head<2>() / slope;
    direction = start.head<2>() - offset * at_infinity;
  }

  bool InFront(double distance) const { return offset + slope * distance > 0; }
  double SquaredError(double distance) const {
    return (at_infinity + direction / (offset + slope * distance)).squaredNorm();
  }
  // Return the distance of the smallest error, and that error squared.
  double BestDistance() const {
    const double inverse = -at_infinity.dot(direction) / direction.squaredNorm();
    return (1 / inverse - offset) / slope;
  }
  double SmallestSquaredError() const {
    const double cross = at_infinity.x() * direction.y() - at_infinity.y() * direction.x();
    return cross * cross / direction.squaredNorm();
  }
  // Returns the pixels per unit of the distance's logarithm.
  double Gain(double distance) const {
    const double depth = offset + slope * distance;
    return direction.norm() * std::abs(slope) * distance / (depth * depth);
  }
};

struct QueryRay {
  Vector3d origin, direction;  // local frame

  QueryRay() = default;
  QueryRay(const KeypointObservations& keypoint, const CamFromLocal& pose)
      : origin(keypoint.CenterOfCamera(pose)) {
    const Vector3d ray = keypoint.image_from_cam.row(0).cross(keypoint.image_from_cam.row(1));
    direction = pose.rotation.transpose() *
                (keypoint.image_from_cam.row(2).dot(ray) > 0 ? ray : -ray).normalized();
  }
  Vector3d At(double distance) const { return origin + distance * direction; }
};

// An error of a depth or a point that the evidence shows.
struct ObservedError {
  double squared;
  double squared_gain;  // variance of the error per squared pixel of noise
};

// Returns evenly spaced errors, as a part is enough to tell a deviation to a few per cent.
constexpr size_t kEnoughErrors = 400;
std::vector<ObservedError> Strided(const std::vector<ObservedError>& errors) {
  const size_t stride = errors.size() / kEnoughErrors + 1;
  std::vector<ObservedError> strided;
  for (size_t i = 0; i < errors.size(); i += stride) strided.push_back(errors[i]);
  return strided;
}

struct VarianceAndShare {
  double variance, share;
};

// Returns the likeliest variance, on a grid of factors of three of the deviation, and share of
// right errors.
template <typename Right, typename Wrong>
VarianceAndShare Likeliest(const std::vector<ObservedError>& errors, double largest_variance,
                           const Right& right, const Wrong& wrong) {
  constexpr std::array kShares = {0.3, 0.6, 0.9};
  double best = -std::numeric_limits<double>::infinity();
  VarianceAndShare found{largest_variance, kShares[1]};
  double variance = largest_variance;
  for (int i = 0; i < 9; ++i, variance /= 9) {
    std::array<LogOfProduct, kShares.size()> logs;
    for (const ObservedError& error : errors) {
      const double p = right(error, variance);
      const double q = wrong(error, variance);
      for (size_t s = 0; s < kShares.size(); ++s) {
        logs[s].Multiply(kShares[s] * p + (1 - kShares[s]) * q + kLeastDensity);
      }
    }
    for (size_t s = 0; s < kShares.size(); ++s) {
      if (const double sum = logs[s].Sum(); sum > best) {
        best = sum;
        found = {variance, kShares[s]};
      }
    }
  }
  return found;
}

// The errors of observations at a pose, where keypoints have something near their rays.
struct ErrorsAtPose {
  std::vector<ObservedError> depths, unanchored;
  std::vector<double> log_distances;  // of what the rays meet
};

ErrorsAtPose CollectErrors(const KeypointEvidence& evidence, const CamFromLocal& pose,
                           double keypoint_variance_px2) {
  ErrorsAtPose errors;
  for (const KeypointObservations& keypoint : evidence.keypoints) {
    const QueryRay ray(keypoint, pose);
    for (const Observation& observation : evidence.ObservationsOf(keypoint)) {
      const RayScan scan(observation, ray.origin, ray.direction);
      const double distance = scan.BestDistance();
      if (!(scan.SmallestSquaredError() < 9 * keypoint_variance_px2) || !(distance > 0) ||
          !std::isfinite(distance) || !scan.InFront(distance)) {
        continue;
      }
      errors.log_distances.push_back(std::log(distance));
      if (!observation.has_depth) continue;
      const double error =
          std::log((ray.At(distance) - observation.center).norm()) - observation.log_distance;
      const double gain = scan.Gain(distance);
      errors.depths.push_back({error * error, 2 / (gain * gain)});
    }
    for (const UnanchoredPoint& point : evidence.UnanchoredOf(keypoint)) {
      const Vector3d offset = point.point - ray.origin;
      const double along = offset.dot(ray.direction);
      const PixelResidual seen = ResidualOf(keypoint.image_from_cam, pose.rotation * offset);
      if (!(along > 0) || !seen.in_front) continue;
      const double squared = (offset - along * ray.direction).squaredNorm();
      if (seen.error_px.squaredNorm() < 100 * keypoint_variance_px2) {
        errors.log_distances.push_back(std::log(along));
      }
      errors.unanchored.push_back({squared, 2 / seen.jacobian.squaredNorm()});
    }
  }
  return errors;
}

}  // namespace

JointNoise InitializeNoise(const KeypointEvidence& evidence, const CamFromLocal& pose,
                           double keypoint_variance_px2) {
  const auto [depths, unanchored, log_distances] =
      CollectErrors(evidence, pose, keypoint_variance_px2);
  JointNoise noise;
  noise.keypoint_px2 = keypoint_variance_px2;
  if (!log_distances.empty()) {
    noise.log_distance_mean = UpperMedianOr(log_distances, 0);
    // The prior is half as wide again as the bulk, and a quarter of the distance at least.
    const double deviation =
        1.5 * kSigmaPerMad * UpperDeviation(log_distances, noise.log_distance_mean);
    noise.log_distance_variance = std::max(0.0625, deviation * deviation);
  }
  if (!depths.empty()) {
    const auto [variance, share] = Likeliest(
        Strided(depths), 1,
        [&](const ObservedError& error, double v) {
          return Normal1D(error.squared, keypoint_variance_px2 * error.squared_gain + v);
        },
        [&](const ObservedError& error, double v) {
          return Normal1D(error.squared, keypoint_variance_px2 * error.squared_gain + v +
                                             noise.log_distance_variance);
        });
    noise.depth = noise.common_depth = 0.5 * variance;
    noise.depth_right = share;
  }
  if (!unanchored.empty()) {
    const double extent = std::exp(noise.log_distance_mean);
    const auto [variance, share] = Likeliest(
        Strided(unanchored), extent * extent,
        [&](const ObservedError& error, double v) {
          return Normal2D(error.squared, keypoint_variance_px2 * error.squared_gain + v);
        },
        [&](const ObservedError& error, double) {
          return 1 / (evidence.matched_area_px2 * error.squared_gain);
        });
    noise.unanchored = variance;
    noise.unanchored_right = share;
  }
  return noise;
}

namespace {

// Returns JointModel::epipolar_clutter by the matches that lie beside their epipolar lines: beyond
// what is noise, and up to three times as far.
std::vector<double> EpipolarClutter(const JointModel& model, double far) {
  const KeypointEvidence& evidence = model.evidence;
  const double near2 = far * 2 * model.noise.keypoint_px2;
  std::vector<double> wrong(evidence.num_references(), 0), beside(evidence.num_references(), 0);
  for (size_t k = 0; k < evidence.keypoints.size(); ++k) {
    const auto [block, lane] = model.blocks.LaneOf(k);
    int n = 0;
    for (const Observation& observation : evidence.ObservationsOf(evidence.keypoints[k])) {
      const double squared = model.blocks.ObservationAt(block, n++).smallest_px2[lane];
      if (!(squared > near2)) continue;
      wrong[static_cast<size_t>(observation.reference)] += 1;
      if (squared < 9 * near2) beside[static_cast<size_t>(observation.reference)] += 1;
    }
  }
  // Two strips of twice the noise's width, along a line as long as the image.
  const double share = std::min(1.0, 4 * std::sqrt(near2 / evidence.matched_area_px2));
  std::vector<double> epipolar_clutter;
  for (size_t r = 0; r < wrong.size(); ++r) {
    epipolar_clutter.push_back(std::max(1.0, (beside[r] + 1) / (wrong[r] * share + 1)));
  }
  return epipolar_clutter;
}

}  // namespace

void InitializeByVoting(JointModel& model) {
  const kernels::KernelTable& kernels = kernels::ActiveKernels();
  const kernels::JointParameters parameters = model.ForKernels();
  const kernels::JointVoting voting = {.far = StudentFar(model.noise.keypoint_tail),
                                       .fit = StudentQuantile(0.01, model.noise.keypoint_tail)};
  kernels.scan_jointly(model.blocks.ForKernels(), parameters);
  model.epipolar_clutter = EpipolarClutter(model, voting.far);
  for (size_t k = 0; k < model.evidence.keypoints.size(); ++k) {
    const auto [block, lane] = model.blocks.LaneOf(k);
    int n = 0;
    for (const Observation& observation :
         model.evidence.ObservationsOf(model.evidence.keypoints[k])) {
      model.blocks.ObservationAt(block, n++).epipolar_clutter[lane] =
          model.epipolar_clutter[static_cast<size_t>(observation.reference)];
    }
  }
  kernels.vote_jointly(model.blocks.ForKernels(), parameters, voting);
}

}  // namespace raylift
