#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>

#include "base/statistics.h"
#include "estimation/refinement/joint/model.h"
#include "estimation/refinement/joint/student_t.h"
#include <Eigen/Geometry>

namespace raylift {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// No error is impossible.
constexpr double kLeastDensity = 1e-9;

// Beyond so many variances a density is none.
constexpr double kFarSquared = 40;

// Where a point that moves along the query's ray is seen in a reference: its residual is
// at_infinity + direction / (offset + slope * distance).
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
  // The distance of the smallest error, and that error.
  double BestDistance() const {
    const double inverse = -at_infinity.dot(direction) / direction.squaredNorm();
    return (1 / inverse - offset) / slope;
  }
  double SmallestSquaredError() const {
    const double cross = at_infinity.x() * direction.y() - at_infinity.y() * direction.x();
    return cross * cross / direction.squaredNorm();
  }
  // Pixels per unit of the distance's logarithm.
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

// An error that the evidence shows, and how much of it a pixel makes.
struct ObservedError {
  double squared;
  double squared_gain;  // variance of the error per squared pixel of noise
};

// A strided part is enough to tell a deviation to a few per cent.
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

// The likeliest variance, by factors of three of the deviation, and share of right errors.
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

}  // namespace

JointNoise InitializeNoise(const KeypointEvidence& evidence, const CamFromLocal& pose,
                           double keypoint_variance_px2) {
  JointNoise noise;
  noise.keypoint_px2 = keypoint_variance_px2;
  std::vector<ObservedError> depths, unanchored;
  std::vector<double> log_distances;
  for (const KeypointObservations& keypoint : evidence.keypoints) {
    const QueryRay ray(keypoint, pose);
    for (const Observation& observation : evidence.ObservationsOf(keypoint)) {
      const RayScan scan(observation, ray.origin, ray.direction);
      const double distance = scan.BestDistance();
      if (!(scan.SmallestSquaredError() < 9 * keypoint_variance_px2) || !(distance > 0) ||
          !std::isfinite(distance) || !scan.InFront(distance)) {
        continue;
      }
      log_distances.push_back(std::log(distance));
      if (!observation.has_depth) continue;
      const double error =
          std::log((ray.At(distance) - observation.center).norm()) - observation.log_distance;
      const double gain = scan.Gain(distance);
      depths.push_back({error * error, 2 / (gain * gain)});
    }
    for (const UnanchoredPoint& point : evidence.UnanchoredOf(keypoint)) {
      const Vector3d offset = point.point - ray.origin;
      const double along = offset.dot(ray.direction);
      const PixelResidual seen = ResidualOf(keypoint.image_from_cam, pose.rotation * offset);
      if (!(along > 0) || !seen.in_front) continue;
      const double squared = (offset - along * ray.direction).squaredNorm();
      if (seen.error_px.squaredNorm() < 100 * keypoint_variance_px2) {
        log_distances.push_back(std::log(along));
      }
      unanchored.push_back({squared, 2 / seen.jacobian.squaredNorm()});
    }
  }
  if (!log_distances.empty()) {
    noise.log_distance_mean = UpperMedianOr(log_distances, 0);
    // Half as wide again as the bulk, and a quarter of the distance at least.
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

// The density of evidence under two hypotheses, both in units of that of a wrong match.
struct Ratios {
  double with_depth = 0;     // right, and its depth too
  double without_depth = 0;  // right, its depth useless or unknown
};

// One keypoint's evidence along its ray, after LookAt().
class RayHypotheses {
 public:
  RayHypotheses(const KeypointEvidence& evidence, const CamFromLocal& pose, const JointNoise& noise,
                const std::vector<double>& epipolar_clutter)
      : evidence_(evidence),
        pose_(pose),
        noise_(noise),
        epipolar_clutter_(epipolar_clutter),
        depth_variance_(noise.depth + noise.common_depth),
        pixel_variance_(2 * noise.keypoint_px2),
        far_(StudentFar(noise.keypoint_tail)),
        fit_(StudentQuantile(0.01, noise.keypoint_tail)),
        right_(noise.right / (1 - noise.right) * evidence.matched_area_px2 /
               (2 * std::numbers::pi * pixel_variance_)),
        mean_distance_(std::exp(noise.log_distance_mean)) {}

  void LookAt(const KeypointObservations& keypoint) {
    observations_ = evidence_.ObservationsOf(keypoint);
    unanchored_ = evidence_.UnanchoredOf(keypoint);
    ray_ = QueryRay(keypoint, pose_);
    scans_.clear();
    depth_ratio_.clear();
    px2_.clear();
    for (const Observation& s : observations_) {
      scans_.emplace_back(s, ray_.origin, ray_.direction);
      depth_ratio_.push_back(s.has_depth ? DepthRatio(s) : 0);
    }
    for (const UnanchoredPoint& point : unanchored_) {
      const PixelResidual seen =
          ResidualOf(keypoint.image_from_cam, pose_.rotation * (point.point - ray_.origin));
      px2_.push_back(seen.in_front ? 0.5 * seen.jacobian.squaredNorm() : 0);
    }
  }

  const QueryRay& ray() const { return ray_; }

  // The distances that some evidence asks for.
  void Candidates(std::vector<double>& distances) const {
    distances.clear();
    for (size_t i = 0; i < observations_.size(); ++i) {
      if (!(scans_[i].SmallestSquaredError() < fit_ * pixel_variance_)) continue;
      double best = scans_[i].BestDistance();
      if (!(best > 0) || !std::isfinite(best)) {  // rays that do not meet: as good as parallel
        best = std::exp(noise_.log_distance_mean + 2 * std::sqrt(noise_.log_distance_variance));
      }
      distances.push_back(best);
      if (observations_[i].has_depth) {
        const Vector3d lifted = observations_[i].center +
                                std::exp(observations_[i].log_distance) * observations_[i].ray;
        const double along = (lifted - ray_.origin).dot(ray_.direction);
        if (along > 0 && std::abs(along - best) > 1e-3 * best) distances.push_back(along);
      }
    }
    for (const UnanchoredPoint& point : unanchored_) {
      const double along = (point.point - ray_.origin).dot(ray_.direction);
      if (along > 0) distances.push_back(along);
    }
    // Rays that are as good as parallel fit any distance.
    if (!distances.empty()) distances.push_back(mean_distance_);
  }

  Ratios RatiosOf(size_t i, double distance) const {
    const Observation& observation = observations_[i];
    if (!scans_[i].InFront(distance)) return {};
    const double squared = scans_[i].SquaredError(distance) / pixel_variance_;
    if (!(squared < far_)) return {};
    const double right = right_ * StudentDensity(squared, noise_.keypoint_tail) /
                         epipolar_clutter_[static_cast<size_t>(observation.reference)];
    if (!observation.has_depth) return {0, right};
    const double error =
        std::log((ray_.At(distance) - observation.center).norm()) - observation.log_distance;
    const double far = error * error / (depth_variance_ + observation.depth_variance);
    const double with_depth = far < kFarSquared ? depth_ratio_[i] * std::exp(-0.5 * far) : 0;
    return {right * noise_.depth_right * with_depth, right * (1 - noise_.depth_right)};
  }

  double RatioOfUnanchored(size_t i, double distance) const {
    const Vector3d off = unanchored_[i].point - ray_.At(distance);
    if (px2_[i] == 0) return 0;
    const double along = off.dot(ray_.direction);
    const double variance = noise_.unanchored + unanchored_[i].variance;
    const double across = variance + noise_.keypoint_px2 / px2_[i];
    return noise_.unanchored_right / (1 - noise_.unanchored_right) * evidence_.matched_area_px2 /
           px2_[i] * Normal2D(off.squaredNorm() - along * along, across) *
           Normal1D(along * along, variance + 1e-12 * distance * distance) /
           (DensityOfAnyDistance(noise_, std::log(distance)) / distance);
  }

  // How much likelier the evidence is with the keypoint at this distance, as a logarithm.
  double LogEvidence(double distance) const {
    LogOfProduct product;
    for (size_t i = 0; i < observations_.size(); ++i) {
      const Ratios ratios = RatiosOf(i, distance);
      product.Multiply(1 + ratios.with_depth + ratios.without_depth);
    }
    for (size_t i = 0; i < unanchored_.size(); ++i)
      product.Multiply(1 + RatioOfUnanchored(i, distance));
    return product.Sum() - 0.5 * Squared(std::log(distance) - noise_.log_distance_mean) /
                               noise_.log_distance_variance;
  }

 private:
  static double Squared(double x) { return x * x; }

  // The density of a right depth without error over that of any depth in the scene.
  double DepthRatio(const Observation& observation) const {
    return Normal1D(0, depth_variance_ + observation.depth_variance) /
           DensityOfAnyDistance(noise_, observation.log_distance);
  }

  const KeypointEvidence& evidence_;
  const CamFromLocal& pose_;
  const JointNoise& noise_;
  const std::vector<double>& epipolar_clutter_;
  double depth_variance_;
  double pixel_variance_;  // both pixels' noise shows in the reference
  double far_, fit_;       // squared, in variances of a pixel
  double right_;
  double mean_distance_;

  std::span<const Observation> observations_;
  std::span<const UnanchoredPoint> unanchored_;
  QueryRay ray_;
  std::vector<RayScan> scans_;
  std::vector<double> depth_ratio_;
  std::vector<double> px2_;  // squared pixels per squared local unit, of each unanchored point
};

// EvidenceWeights::epipolar_clutter, by the matches that lie beside their epipolar lines: beyond
// what is noise, and up to three times as far.
std::vector<double> EpipolarClutter(const KeypointEvidence& evidence, const CamFromLocal& pose,
                                    const JointNoise& noise) {
  const double near2 = StudentFar(noise.keypoint_tail) * 2 * noise.keypoint_px2;
  std::vector<double> wrong(evidence.num_references(), 0), beside(evidence.num_references(), 0);
  for (const KeypointObservations& keypoint : evidence.keypoints) {
    const QueryRay ray(keypoint, pose);
    for (const Observation& observation : evidence.ObservationsOf(keypoint)) {
      const double squared = RayScan(observation, ray.origin, ray.direction).SmallestSquaredError();
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

VotedPoints InitializeByVoting(const KeypointEvidence& evidence, const CamFromLocal& pose,
                               const JointNoise& noise) {
  VotedPoints voted;
  voted.points.resize(evidence.keypoints.size());
  EvidenceWeights& weights = voted.weights;
  weights.observation.assign(evidence.observations.size(), 0);
  weights.depth.assign(evidence.observations.size(), 0);
  weights.unanchored.assign(evidence.unanchored.size(), 0);
  weights.epipolar_clutter = EpipolarClutter(evidence, pose, noise);
  RayHypotheses hypotheses(evidence, pose, noise, weights.epipolar_clutter);
  const double mean_distance = std::exp(noise.log_distance_mean);
  std::vector<double> candidates;
  for (size_t k = 0; k < evidence.keypoints.size(); ++k) {
    const KeypointObservations& keypoint = evidence.keypoints[k];
    hypotheses.LookAt(keypoint);
    hypotheses.Candidates(candidates);
    double distance = mean_distance;
    double most = -std::numeric_limits<double>::infinity();
    for (const double candidate : candidates) {
      const double log_evidence = hypotheses.LogEvidence(candidate);
      if (log_evidence > most) {
        most = log_evidence;
        distance = candidate;
      }
    }
    voted.points[k] = hypotheses.ray().At(distance);
    if (candidates.empty()) continue;
    for (int i = keypoint.first_observation; i < keypoint.end_observation; ++i) {
      const Ratios ratios =
          hypotheses.RatiosOf(static_cast<size_t>(i - keypoint.first_observation), distance);
      const double right = ratios.with_depth + ratios.without_depth;
      weights.observation[i] = right / (right + 1);
      weights.depth[i] = right > 0 ? ratios.with_depth / right : 0;
    }
    for (int i = keypoint.first_unanchored; i < keypoint.end_unanchored; ++i) {
      const double right = hypotheses.RatioOfUnanchored(
          static_cast<size_t>(i - keypoint.first_unanchored), distance);
      weights.unanchored[i] = right / (right + 1);
    }
  }
  return voted;
}

}  // namespace raylift
