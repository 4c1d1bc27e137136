// Finds the query's focal length with its pose: by RANSAC with some focal lengths of the range, a
// search along one dimension for the lowest MSAC cost about the best of them, and from there, where
// poses are refined by maximum likelihood, Newton's steps on the likelihood. If nobody has
// calibrated the lens, a radial term is searched for in turn with the focal length.

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <utility>

#include "base/rng.h"
#include "estimation/confidence/confidence.h"
#include "estimation/methods/assumed_lens.h"
#include "estimation/methods/methods.h"
#include "estimation/problem/observations.h"
#include "estimation/refinement/refinement.h"
#include "estimation/refinement/single_set.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {
namespace {

// Every focal length in the range is within kCandidateReach of a candidate, and the search goes up
// to kSearchSteps steps of kSearchStep from its candidate; all are logarithms.
constexpr double kCandidateReach = 0.1;
constexpr double kSearchStep = 0.03;
constexpr int kSearchSteps = 9;
constexpr double kRadialStep = 0.05;
constexpr int kRadialSteps = 16;  // from one end of the searched range to the other
constexpr int kLensRounds = 3;

Camera WithFocalScaled(const Camera& camera, double factor) {
  std::vector<double> params(camera.params().begin(), camera.params().end());
  const int num_focal_lengths = GetCameraModelInfo(camera.model()).num_focal_lengths;
  for (int i = 0; i < num_focal_lengths; ++i) {
    params[static_cast<size_t>(i)] *= factor;
  }
  return {camera.model(), camera.width_px(), camera.height_px(), params};
}

double TruncatedSum(const std::vector<double>& squared_residuals, int num_matches) {
  double sum = num_matches - static_cast<double>(squared_residuals.size());
  for (const double e2 : squared_residuals) {
    sum += std::min(e2, 1.0);
  }
  return sum;
}

PoseProblem WithCamera(const PoseProblem& problem, const Camera& camera) {
  PoseProblem changed = problem;
  changed.query_camera = camera;
  return changed;
}

struct Trial {
  double at;  // what was varied, over the search's start
  double cost;
  Camera camera;
  Rigid3 cam_from_world;
};

struct FocalRefinement {
  Camera camera;
  // The part of the pose's covariance that is due to the lens: that of the step (w, v) in the
  // camera's tangent frame, scene units. nullopt where the matches do not tell.
  std::optional<Matrix6d> covariance_by_lens;
};

// A searched value of the camera: a grid of steps of `step`, at most `num_steps` either way and
// between two bounds.
struct SearchedValue {
  std::function<Camera(double)> camera_at;
  double step;
  int num_steps;
  double low;
  double high;
};

// Returns the problem with its matches in the same order for every camera.
NormalizedProblem Prepare(const PoseProblem& problem, const EstimatorOptions& options) {
  Rng rng(StreamSeed(options.seed, problem.name, "focal"));
  return Normalize(problem, options, rng);
}

// Searches for the lens near the problem's, from a pose found with that, by the sets in use.
class FocalSearch {
 public:
  FocalSearch(const PoseProblem& problem, MatchSets sets, const EstimatorOptions& options)
      : problem_(problem), sets_(sets), options_(options) {}

  // Searches for the focal length, between two factors of the problem's, as logarithms, and for the
  // radial term where the lens is assumed.
  Trial Best(const Rigid3& start, double shortest, double longest) const;
  // Refines the focal length by Newton's steps from there.
  FocalRefinement Polish(const Trial& from, double shortest, double longest) const;

 private:
  Trial Try(const SearchedValue& value, double at, const Rigid3& start) const;
  Trial Lowest(const SearchedValue& value, const Rigid3& start) const;
  // Refines the pose with this camera, and returns the step of the focal length there.
  std::optional<FocalStep> StepFrom(const Camera& camera, CamFromLocal& pose) const;

  const PoseProblem& problem_;
  MatchSets sets_;
  const EstimatorOptions& options_;
};

Trial FocalSearch::Try(const SearchedValue& value, double at, const Rigid3& start) const {
  const PoseProblem changed = WithCamera(problem_, value.camera_at(at));
  const NormalizedProblem normalized = Prepare(changed, options_);
  // Inliers under a wrong focal length lie beyond the threshold: the local optimization reaches
  // for them first.
  const CamFromLocal near = OptimizeLocally(normalized, normalized.ToLocal(start), sets_, 10);
  CamFromLocal pose = near;
  if (options_.refinement == Refinement::kRobust) {
    MaximumLikelihood likelihood(normalized, sets_);
    likelihood.Refine(near);
    pose = likelihood.pose();
  }
  const Residuals residuals = ComputeResiduals(normalized, pose);
  // Matches whose pixel has no ray cost as much as outliers.
  const double cost =
      (Has2D3D(sets_) ? TruncatedSum(residuals.of_2d3d, normalized.num_matches_2d3d) : 0) +
      (Has2D2D(sets_) ? TruncatedSum(residuals.of_2d2d, normalized.num_matches_2d2d) : 0);
  return {at, cost, changed.query_camera, normalized.ToWorld(pose)};
}

// Searches for the lowest cost: a coarse grid finds the basin, golden sections its lowest point.
Trial FocalSearch::Lowest(const SearchedValue& value, const Rigid3& start) const {
  Trial best = Try(value, 0, start);
  for (int i = -value.num_steps; i <= value.num_steps; ++i) {
    const double at = i * value.step;
    if (i == 0 || at < value.low || at > value.high) continue;
    Trial trial = Try(value, at, start);
    if (trial.cost < best.cost) {
      best = std::move(trial);
    }
  }
  double low = std::max(best.at - value.step, value.low);
  double high = std::min(best.at + value.step, value.high);
  constexpr double kGolden = 1 / std::numbers::phi;
  Trial left = Try(value, high - kGolden * (high - low), start);
  Trial right = Try(value, low + kGolden * (high - low), start);
  for (int i = 0; i < 14; ++i) {
    if (left.cost < right.cost) {
      high = right.at;
      right = std::move(left);
      left = Try(value, high - kGolden * (high - low), start);
    } else {
      low = left.at;
      left = std::move(right);
      right = Try(value, low + kGolden * (high - low), start);
    }
  }
  for (Trial* trial : {&left, &right}) {
    if (trial->cost < best.cost) {
      best = std::move(*trial);
    }
  }
  return best;
}

Trial FocalSearch::Best(const Rigid3& start, double shortest, double longest) const {
  const auto best_focal = [&](const Trial& from) {
    const double taken = from.at;
    Trial found = Lowest({[&](double at) { return WithFocalScaled(from.camera, std::exp(at)); },
                          kSearchStep, kSearchSteps, shortest - taken, longest - taken},
                         from.cam_from_world);
    found.at += taken;
    return found;
  };
  Trial best = best_focal({0, 0, problem_.query_camera, start});
  if (!LensIsAssumed(problem_.query_camera, problem_.priors)) return best;
  best.camera = WithRadialTerms(best.camera);
  for (int round = 0; round < kLensRounds; ++round) {
    const double radial = RadialTerm(best.camera);
    Trial found = Lowest({[&](double at) { return WithRadialMoved(best.camera, at); }, kRadialStep,
                          kRadialSteps, -kFurthestRadial - radial, kFurthestRadial - radial},
                         best.cam_from_world);
    found.at = best.at;
    best = best_focal(found);
  }
  return best;
}

std::optional<FocalStep> FocalSearch::StepFrom(const Camera& camera, CamFromLocal& pose) const {
  const PoseProblem problem = WithCamera(problem_, camera);
  NormalizedProblem normalized = Prepare(problem, options_);
  if (sets_ == MatchSets::kBoth) {
    const RefinedPose refined =
        RefineByEvidence(normalized, GatherEvidence(problem, normalized), pose,
                         KnownNoiseOf(normalized, options_), FocalDerivatives::kAtPose);
    pose = refined.pose;
    return refined.focal;
  }
  normalized.TakeFocalSigma(problem, kMaxFocalSigma);
  MaximumLikelihood likelihood(normalized, sets_);
  likelihood.Refine(pose);
  pose = likelihood.pose();
  return likelihood.StepOfFocal();
}

FocalRefinement FocalSearch::Polish(const Trial& from, double shortest, double longest) const {
  constexpr int kMaxSteps = 6;
  constexpr double kSettled = 0.05;                             // standard deviations
  const NormalizedProblem frame = Prepare(problem_, options_);  // the same for all cameras
  FocalRefinement result = {from.camera, std::nullopt};
  CamFromLocal pose = frame.ToLocal(from.cam_from_world);
  double log_factor = from.at;
  for (int i = 0; i < kMaxSteps; ++i) {
    const std::optional<FocalStep> step = StepFrom(result.camera, pose);
    if (!step) break;
    Vector6d by_factor = step->pose_by_log_factor;
    // The focal length is no less certain than a uniform one in the range.
    const double variance =
        1 / (1 / step->variance + 12 / ((longest - shortest) * (longest - shortest)));
    const double taken = std::clamp(log_factor + step->log_factor, shortest, longest) - log_factor;
    log_factor += taken;
    result.camera = WithFocalScaled(problem_.query_camera, std::exp(log_factor));
    pose = Moved(pose, taken * by_factor);
    by_factor.tail<3>() *= frame.scale;
    result.covariance_by_lens = variance * by_factor * by_factor.transpose();
    if (std::abs(taken) < kSettled * std::sqrt(variance)) break;
  }
  return result;
}

// Returns focal lengths within a factor of the camera's, the camera itself first, so close to each
// other that the pose found with the nearest one leads to the true one.
std::vector<Camera> FocalCandidates(const Camera& camera, double range) {
  std::vector<Camera> candidates = {camera};
  const double outermost = std::log(range) - kCandidateReach;
  const int steps = static_cast<int>(std::ceil(std::max(outermost, 0.0) / (2 * kCandidateReach)));
  for (int i = 1; i <= steps; ++i) {
    for (const int sign : {-1, 1}) {
      candidates.push_back(WithFocalScaled(camera, std::exp(sign * i * outermost / steps)));
    }
  }
  return candidates;
}

// Refines the focal length from the problem's, within the factor `range` of `middle_px`, by the
// sets in use.
FocalRefinement RefineFocal(const PoseProblem& problem, const Rigid3& cam_from_world,
                            MatchSets sets, const EstimatorOptions& options, double middle_px,
                            double range) {
  const double middle = std::log(middle_px / problem.query_camera.MeanFocalPx());
  const double shortest = middle - std::log(range);
  const double longest = middle + std::log(range);
  const FocalSearch search(problem, sets, options);
  const Trial best = search.Best(cam_from_world, shortest, longest);
  if (options.refinement == Refinement::kPaper) {
    return {best.camera, std::nullopt};
  }
  if (LensIsAssumed(problem.query_camera, problem.priors)) {
    const Camera assumed = WithRadialTerms(WithFocalScaled(problem.query_camera, std::exp(middle)));
    const auto lens =
        RefineAssumedLens(problem, Prepare(problem, options), best.camera, best.cam_from_world,
                          assumed, range, options.reprojection_threshold_px);
    if (!lens) return {best.camera, std::nullopt};
    return {lens->camera, lens->pose_covariance};
  }
  return search.Polish(best, shortest, longest);
}

// Lowers the confidence by the position's standard deviation, which now includes the lens's part.
void DoubtByPosition(const PoseProblem& problem, MatchSets scored, const EstimatorOptions& options,
                     PoseEstimate& estimate) {
  const NormalizedProblem local = Prepare(problem, options);
  const double distance = SceneDistance(local, local.ToLocal(*estimate.cam_from_world), scored);
  Conclude(estimate.confidence,
           ProbabilityOfPosition(estimate.position_sigma / local.scale, distance), estimate);
}

// Adds the lens's part to the covariances of the alternatives, which take the lens for granted;
// drops these where it is nullopt (not known).
void DoubtByLens(const std::optional<Matrix6d>& covariance_by_lens, PoseEstimate& estimate) {
  for (AlternativePose& other : estimate.alternatives) {
    if (other.covariance && covariance_by_lens) {
      *other.covariance += *covariance_by_lens;
    } else {
      other.covariance.reset();
    }
  }
}

int NumInliers(const PoseEstimate& estimate) {
  return estimate.score_2d3d.num_inliers + estimate.score_2d2d.num_inliers;
}

// Throws InputError unless all focal lengths in the range are normal numbers.
void RequireFocalRange(const PoseProblem& problem, double range) {
  const Camera& camera = problem.query_camera;
  for (const double focal_px : {camera.focal_x_px(), camera.focal_y_px()}) {
    if (focal_px / range >= std::numeric_limits<double>::min() && std::isfinite(focal_px * range)) {
      continue;
    }
    throw InputError(
        fmt::format("{}: query camera: no focal lengths within a factor of {} of {} px",
                    problem.name, range, focal_px));
  }
}

}  // namespace

double FocalSigma(const PoseProblem& problem, const EstimatorOptions& options) {
  const double sigma = problem.priors.focal_sigma.value_or(0);
  if (!(sigma >= 0 && sigma <= kMaxFocalSigma)) {
    throw InputError(fmt::format("focal length's sigma: expected a share from 0 to {}, found {}",
                                 kMaxFocalSigma, sigma));
  }
  return options.focal_sigma.value_or(sigma);
}

std::optional<double> UnknownFocalRange(const PoseProblem& problem,
                                        const EstimatorOptions& options) {
  const double prior = problem.priors.focal_range;
  if (!(prior >= 1 && prior <= kMaxFocalRange)) {
    throw InputError(fmt::format("focal range prior: expected a factor from 1 to {}, found {}",
                                 kMaxFocalRange, prior));
  }
  const double range = std::max(options.refine_focal ? options.focal_range : 1, prior);
  if (range == 1 || problem.query_camera.is_panorama()) return std::nullopt;
  if (!problem.other_cameras.empty()) {
    throw InputError(problem.name + ": the focal lengths of a rig's cameras must be known");
  }
  RequireFocalRange(problem, range);
  return range;
}

// Refines the focal length at the best of the poses found with some in its range, and makes the
// estimate anew, as a better focal length has more inliers.
PoseEstimate EstimateWithFocal(const RansacEstimator& estimator, const PoseProblem& problem,
                               const EstimatorOptions& options, double range) {
  const double focal_px = problem.query_camera.MeanFocalPx();
  PoseProblem changed = problem;
  std::optional<PoseEstimate> first;
  Camera camera;
  int iterations = 0;
  for (const Camera& candidate : FocalCandidates(problem.query_camera, range)) {
    changed.query_camera = candidate;
    PoseEstimate estimate = estimator.EstimateWithCamera(changed);
    iterations += estimate.iterations;
    const bool is_better =
        first && estimate.cam_from_world &&
        (!first->cam_from_world || estimate.refined_value < first->refined_value);
    if (!first || is_better) {
      first = std::move(estimate);
      camera = candidate;
    }
  }
  first->iterations = iterations;
  if (!first->cam_from_world) return *first;
  first->refined_camera = camera;
  if (!first->position_observable) return *first;
  changed.query_camera = camera;
  const FocalRefinement refined =
      RefineFocal(changed, *first->cam_from_world, estimator.RefinedSets(first->solver), options,
                  focal_px, range);
  changed.query_camera = refined.camera;
  PoseEstimate second = estimator.EstimateWithCamera(changed);
  second.iterations += iterations;
  second.refined_camera = refined.camera;
  if (!second.cam_from_world || NumInliers(second) < kKeptGain * NumInliers(*first)) {
    DropCovariance(*first);  // it takes the camera for granted
    DoubtByLens(std::nullopt, *first);
    changed.query_camera = camera;
    DoubtByPosition(changed, estimator.scored(), options, *first);
    return *first;
  }
  if (refined.covariance_by_lens && second.covariance) {
    SetCovariance(*second.covariance + *refined.covariance_by_lens, second);
  } else {
    DropCovariance(second);
  }
  DoubtByLens(refined.covariance_by_lens, second);
  DoubtByPosition(changed, estimator.scored(), options, second);
  return second;
}

}  // namespace raylift
