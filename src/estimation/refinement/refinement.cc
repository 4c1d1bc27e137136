#include "estimation/refinement/refinement.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "base/statistics.h"
#include "estimation/refinement/single_set.h"
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

// Returns the prior of the noise by what is known of the scene; where nothing is known of its
// keypoints, it is as if four errors had shown kPriorVariance.
NoisePrior PriorOf(const std::optional<SceneNoise>& scene, double threshold2, double local_unit) {
  NoisePrior prior;
  prior.keypoint_px2 = {threshold2 * kPriorVariance, 4};
  if (!scene) return prior;
  const auto variance = [](const KnownNoise& known, double unit = 1) {
    constexpr double kMost = 1e100;  // stays a number whatever it is multiplied with
    return VariancePrior{std::min(kMost, std::pow(known.sigma / unit, 2)), known.errors};
  };
  if (scene->keypoint_px.errors > 4) prior.keypoint_px2 = variance(scene->keypoint_px);
  prior.depth = variance(scene->depth);
  prior.common_depth = variance(scene->common_depth);
  prior.reference_scale = variance(scene->reference_factor);
  prior.reference_rotation = variance(scene->reference_rotation_deg, 180 / std::numbers::pi);
  prior.reference_center = variance(scene->reference_position, local_unit);
  if (scene->keypoint_tail_variance > 0) {
    prior.keypoint_tail = TailPrior{scene->keypoint_tail, scene->keypoint_tail_variance};
  }
  return prior;
}

// Returns the point of the query's ray that is nearest to an observation's, at a pose.
Eigen::Vector3d Triangulate(const KeypointObservations& keypoint, const Observation& observation,
                            const CamFromLocal& pose) {
  const Eigen::Vector3d center = keypoint.CenterOfCamera(pose);
  const Eigen::Vector3d ray =
      pose.rotation.transpose() * keypoint.image_from_cam.inverse().col(2).normalized();
  const Eigen::Vector3d normal = ray.cross(observation.ray);
  const double along =
      (observation.center - center).cross(observation.ray).dot(normal) / normal.squaredNorm();
  return center + along * ray;
}

// Returns the logarithm by which each reference's depths are too small for where its matches are
// triangulated, their median by weight: an error of a pixel moves the logarithm of a distance by
// the inverse of the angle between the rays. 0 where fewer than five matches tell.
std::vector<double> LogScales(const KeypointEvidence& evidence, const CamFromLocal& pose,
                              double largest_error_px) {
  std::vector<std::vector<WeightedValue>> errors(evidence.num_references());
  for (const KeypointObservations& keypoint : evidence.keypoints) {
    for (const Observation& observation : evidence.ObservationsOf(keypoint)) {
      if (!observation.has_depth) continue;
      const Eigen::Vector3d point = Triangulate(keypoint, observation, pose);
      const PixelResidual seen = ResidualOf(observation.image_from_ray, point - observation.center);
      const bool fits = seen.in_front && seen.error_px.norm() < largest_error_px &&
                        keypoint.PointInCamera(pose, point).z() > 0;
      if (!fits) continue;
      const Eigen::Vector3d from_query = (point - keypoint.CenterOfCamera(pose)).normalized();
      errors[static_cast<size_t>(observation.reference)].push_back(
          {std::log((point - observation.center).norm()) - observation.log_distance,
           from_query.cross(observation.ray).norm()});
    }
  }
  std::vector<double> scales;
  for (std::vector<WeightedValue>& of_reference : errors) {
    scales.push_back(of_reference.size() < 5 ? 0 : WeightedMedian(std::move(of_reference)));
  }
  return scales;
}

// Returns the pose with its covariance. An uncertain focal length moves the pose of one match set
// by d = d pose / d log f, and is not refined with it: a keypoint counts there once per match,
// which would make the matches too sure of f. So the covariance has all of sigma's part, sigma^2 d
// d'.
RefinedPose WithCovariance(const NormalizedProblem& problem, const MaximumLikelihood& likelihood) {
  RefinedPose refined = {.pose = likelihood.pose(), .covariance = likelihood.Covariance()};
  if (problem.focal.sigma == 0 || !refined.covariance) return refined;
  if (const std::optional<FocalStep> step = likelihood.StepOfFocal()) {
    const Vector6d by_sigma = problem.focal.sigma * step->pose_by_log_factor;
    *refined.covariance += by_sigma * by_sigma.transpose();
  }
  return refined;
}

}  // namespace

std::optional<SceneNoise> KnownNoiseOf(const NormalizedProblem& problem,
                                       const EstimatorOptions& options) {
  std::optional<SceneNoise> known = options.scene_noise;
  const auto take = [&](const std::optional<double>& by_options,
                        const std::optional<double>& by_problem, KnownNoise SceneNoise::*noise) {
    const std::optional<double> sigma = by_options ? by_options : by_problem;
    if (!sigma) return;
    if (!(*sigma >= 0) || !std::isfinite(*sigma)) {
      throw InputError(
          fmt::format("reference_sigmas: expected standard deviations, found {}", *sigma));
    }
    if (!known) known.emplace();
    // More errors than a problem can have.
    constexpr double kAsGiven = 1e9;
    (*known).*noise = {*sigma, kAsGiven};
  };
  const ReferenceSigmas& sigmas = problem.reference_sigmas;
  take(options.reference_factor_sigma, sigmas.factor, &SceneNoise::reference_factor);
  take(options.reference_rotation_sigma_deg, sigmas.rotation_deg,
       &SceneNoise::reference_rotation_deg);
  take(options.reference_position_sigma, sigmas.position, &SceneNoise::reference_position);
  return known;
}

RefinedPose KeepPose(const NormalizedProblem& problem, const CamFromLocal& pose, MatchSets sets) {
  MaximumLikelihood likelihood(problem, sets);
  likelihood.StayAt(pose);
  return WithCovariance(problem, likelihood);
}

RefinedPose RefineByEvidence(const NormalizedProblem& problem, const KeypointEvidence& evidence,
                             const CamFromLocal& pose, const std::optional<SceneNoise>& scene,
                             FocalDerivatives focal, ReferenceErrors reference_errors) {
  const double threshold2 = problem.sampson_threshold_px * problem.sampson_threshold_px;
  const double variance =
      problem.matches_2d2d.empty()
          ? kPriorVariance
          : NoiseVariance(ComputeResiduals(problem, pose, MatchSets::k2D2D).of_2d2d, kModel2D2D);
  return RefineJointly(evidence, pose, threshold2 * variance,
                       PriorOf(scene, threshold2, problem.scale), problem.priors, focal,
                       reference_errors, problem.focal.sigma);
}

RefinedPose RefineFinally(const NormalizedProblem& problem,
                          const std::optional<KeypointEvidence>& evidence, const CamFromLocal& pose,
                          MatchSets sets, const EstimatorOptions& options) {
  if (options.refinement == Refinement::kPaper) return KeepPose(problem, pose, sets);
  if (sets != MatchSets::kBoth) {
    MaximumLikelihood likelihood(problem, sets);
    likelihood.Refine(pose);
    return WithCovariance(problem, likelihood);
  }
  RAYLIFT_CHECK(evidence.has_value());
  return RefineByEvidence(problem, *evidence, pose, KnownNoiseOf(problem, options));
}

RefinedPose RefineWithScales(const NormalizedProblem& problem, const KeypointEvidence& evidence,
                             const CamFromLocal& pose, const EstimatorOptions& options) {
  const std::vector<double> log_scales =
      LogScales(evidence, pose, 2 * problem.sampson_threshold_px);
  KeypointEvidence scaled = evidence;
  for (Observation& observation : scaled.observations) {
    observation.log_distance += log_scales[static_cast<size_t>(observation.reference)];
  }
  const std::optional<SceneNoise> known = KnownNoiseOf(problem, options);
  RefinedPose refined = RefineByEvidence(problem, scaled, pose, known, FocalDerivatives::kNone,
                                         ReferenceErrors::kAlways);
  const double sigma =
      known && known->reference_factor.errors > 0 ? known->reference_factor.sigma : 0;
  const double variance =
      sigma > 0 ? sigma * sigma : refined.noise->depth + refined.noise->common_depth;
  for (const double log_scale : log_scales) {
    const double squared = log_scale * log_scale / variance;
    refined.log_likelihood -=
        (sigma > 0 ? 0.5 * squared : std::log1p(squared)) + 0.5 * std::log(variance);
  }
  return refined;
}

}  // namespace raylift
