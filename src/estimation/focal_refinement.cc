#include "estimation/focal_refinement.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "base/rng.h"
#include "estimation/final_refinement.h"
#include "estimation/keypoint_evidence.h"
#include "estimation/local_optimization.h"
#include "estimation/maximum_likelihood.h"

namespace raylift {
namespace {

// How near, as a logarithm, a candidate is to any focal length in the range, and how far from its
// candidate a focal length is looked for.
constexpr double kCandidateReach = 0.1;
constexpr double kSearchStep = 0.03;
constexpr int kSearchSteps = 9;

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
  double log_factor;  // over the focal length of the search's problem
  double cost;
  Camera camera;
  Rigid3 cam_from_world;
};

class FocalSearch {
 public:
  FocalSearch(const PoseProblem& problem, const Rigid3& start, ResidualKinds kinds,
              const EstimatorOptions& options)
      : problem_(problem), start_(start), kinds_(kinds), options_(options) {}

  Trial Best(double shortest, double longest) const;
  // Newton's steps from there.
  FocalRefinement Polish(const Trial& from, double shortest, double longest) const;

 private:
  Trial Try(double log_factor) const;
  // Refines the pose with this camera first.
  std::optional<FocalStep> StepFrom(const Camera& camera, SolverPose& pose) const;
  // With its matches in the same order for every camera.
  PreparedProblem Prepare(const PoseProblem& problem) const {
    Rng rng(StreamSeed(options_.seed, problem_.name, "focal"));
    return {problem, options_.reprojection_threshold_px, options_.sampson_threshold_px, rng,
            options_.point_sigma};
  }

  const PoseProblem& problem_;
  const Rigid3& start_;
  ResidualKinds kinds_;
  const EstimatorOptions& options_;
};

Trial FocalSearch::Try(double log_factor) const {
  const PoseProblem scaled =
      WithCamera(problem_, WithFocalScaled(problem_.query_camera, std::exp(log_factor)));
  const PreparedProblem prepared = Prepare(scaled);
  // Inliers under a wrong focal length lie beyond the threshold: the local optimization reaches
  // for them first.
  const SolverPose near = OptimizeLocally(prepared, prepared.CamFromLocal(start_), kinds_, 10);
  SolverPose pose = near;
  if (options_.refinement == Refinement::kRobust) {
    MaximumLikelihood likelihood(prepared, kinds_);
    likelihood.Refine(near);
    pose = likelihood.pose();
  }
  const Residuals residuals = ComputeResiduals(prepared, pose);
  // Matches whose pixel has no ray cost as much as outliers.
  const double cost =
      (kinds_.points ? TruncatedSum(residuals.points, prepared.num_matches_2d3d) : 0) +
      (kinds_.pairs ? TruncatedSum(residuals.pairs, prepared.num_matches_2d2d) : 0);
  return {log_factor, cost, scaled.query_camera, prepared.CamFromWorld(pose)};
}

// A coarse grid finds the basin, golden sections its lowest point.
Trial FocalSearch::Best(double shortest, double longest) const {
  Trial best = Try(0);
  for (int i = -kSearchSteps; i <= kSearchSteps; ++i) {
    const double log_factor = i * kSearchStep;
    if (i == 0 || log_factor < shortest || log_factor > longest) continue;
    Trial trial = Try(log_factor);
    if (trial.cost < best.cost) {
      best = std::move(trial);
    }
  }
  double low = std::max(best.log_factor - kSearchStep, shortest);
  double high = std::min(best.log_factor + kSearchStep, longest);
  constexpr double kGolden = 1 / std::numbers::phi;
  Trial left = Try(high - kGolden * (high - low));
  Trial right = Try(low + kGolden * (high - low));
  for (int i = 0; i < 14; ++i) {
    if (left.cost < right.cost) {
      high = right.log_factor;
      right = std::move(left);
      left = Try(high - kGolden * (high - low));
    } else {
      low = left.log_factor;
      left = std::move(right);
      right = Try(low + kGolden * (high - low));
    }
  }
  for (Trial* trial : {&left, &right}) {
    if (trial->cost < best.cost) {
      best = std::move(*trial);
    }
  }
  return best;
}

std::optional<FocalStep> FocalSearch::StepFrom(const Camera& camera, SolverPose& pose) const {
  const PoseProblem problem = WithCamera(problem_, camera);
  const PreparedProblem prepared = Prepare(problem);
  if (kinds_.points && kinds_.pairs) {
    EstimatorOptions options = options_;
    options.refine_focal = true;
    const FinalPose refined =
        RefineFinally(prepared, GatherEvidence(problem, prepared), pose, kinds_, options);
    pose = refined.pose;
    return refined.focal;
  }
  MaximumLikelihood likelihood(prepared, kinds_);
  likelihood.Refine(pose);
  pose = likelihood.pose();
  constexpr double kDifference = 1e-4;
  const auto prepare = [&](double log_factor) {
    return Prepare(WithCamera(problem, WithFocalScaled(camera, std::exp(log_factor))));
  };
  return likelihood.StepOfFocal(prepare(-kDifference), prepare(kDifference), kDifference);
}

FocalRefinement FocalSearch::Polish(const Trial& from, double shortest, double longest) const {
  constexpr int kMaxSteps = 6;
  constexpr double kSettled = 0.05;                 // standard deviations
  const PreparedProblem frame = Prepare(problem_);  // the same for all cameras
  FocalRefinement result = {from.camera, std::nullopt};
  SolverPose pose = frame.CamFromLocal(from.cam_from_world);
  double log_factor = from.log_factor;
  for (int i = 0; i < kMaxSteps; ++i) {
    const std::optional<FocalStep> step = StepFrom(result.camera, pose);
    if (!step) break;
    Vector6d by_factor = step->pose_by_log_factor;
    // Nothing is less certain than anywhere in the range.
    const double variance =
        1 / (1 / step->variance + 12 / ((longest - shortest) * (longest - shortest)));
    const double taken = std::clamp(log_factor + step->log_factor, shortest, longest) - log_factor;
    log_factor += taken;
    result.camera = WithFocalScaled(problem_.query_camera, std::exp(log_factor));
    pose = Moved(pose, taken * by_factor);
    by_factor.tail<3>() *= frame.scale;
    result.covariance_by_focal = variance * by_factor * by_factor.transpose();
    if (std::abs(taken) < kSettled * std::sqrt(variance)) break;
  }
  return result;
}

}  // namespace

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

FocalRefinement RefineFocal(const PoseProblem& problem, const Rigid3& cam_from_world,
                            ResidualKinds kinds, const EstimatorOptions& options, double middle_px,
                            double range) {
  const double middle = std::log(middle_px / problem.query_camera.MeanFocalPx());
  const double shortest = middle - std::log(range);
  const double longest = middle + std::log(range);
  const FocalSearch search(problem, cam_from_world, kinds, options);
  const Trial best = search.Best(shortest, longest);
  if (options.refinement == Refinement::kPaper) {
    return {best.camera, std::nullopt};
  }
  return search.Polish(best, shortest, longest);
}

}  // namespace raylift
