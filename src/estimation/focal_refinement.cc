#include "estimation/focal_refinement.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "estimation/local_optimization.h"
#include "estimation/maximum_likelihood.h"

#include "raylift/base/rng.h"

namespace raylift {
namespace {

Camera WithFocalScaled(const Camera& camera, double factor) {
  std::vector<double> params(camera.params().begin(), camera.params().end());
  const int num_focal_lengths = GetCameraModelInfo(camera.model()).num_focal_lengths;
  for (int i = 0; i < num_focal_lengths; ++i) {
    params[static_cast<size_t>(i)] *= factor;
  }
  return {camera.model(), camera.width_px(), camera.height_px(), params};
}

double TruncatedSum(const std::vector<double>& squared_residuals) {
  double sum = 0;
  for (const double e2 : squared_residuals) {
    sum += std::min(e2, 1.0);
  }
  return sum;
}

struct Trial {
  double log_factor;
  double cost;
  FocalRefinement refinement;
};

class FocalSearch {
 public:
  FocalSearch(const PoseProblem& problem, const Rigid3& start, ResidualKinds kinds,
              const EstimatorOptions& options)
      : problem_(problem), start_(start), kinds_(kinds), options_(options) {}

  Trial Try(double log_factor) const {
    PoseProblem scaled = problem_;
    scaled.query_camera = WithFocalScaled(problem_.query_camera, std::exp(log_factor));
    Rng rng(StreamSeed(options_.seed, problem_.name, "focal"));
    const PreparedProblem prepared(scaled, options_.reprojection_threshold_px,
                                   options_.sampson_threshold_px, rng, options_.point_sigma);
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
    const double cost = (kinds_.points ? TruncatedSum(residuals.points) : 0) +
                        (kinds_.pairs ? TruncatedSum(residuals.pairs) : 0);
    return {log_factor, cost, {scaled.query_camera, prepared.CamFromWorld(pose)}};
  }

 private:
  const PoseProblem& problem_;
  const Rigid3& start_;
  ResidualKinds kinds_;
  const EstimatorOptions& options_;
};

}  // namespace

FocalRefinement RefineFocal(const PoseProblem& problem, const Rigid3& cam_from_world,
                            ResidualKinds kinds, const EstimatorOptions& options) {
  const FocalSearch search(problem, cam_from_world, kinds, options);
  // A coarse grid finds the basin, golden sections its lowest point.
  constexpr double kStep = 0.03;
  constexpr int kSteps = 9;
  Trial best = search.Try(0);
  for (int i = -kSteps; i <= kSteps; ++i) {
    Trial trial = search.Try(i * kStep);
    if (trial.cost < best.cost) {
      best = std::move(trial);
    }
  }
  double low = best.log_factor - kStep;
  double high = best.log_factor + kStep;
  constexpr double kGolden = 1 / std::numbers::phi;
  Trial left = search.Try(high - kGolden * (high - low));
  Trial right = search.Try(low + kGolden * (high - low));
  for (int i = 0; i < 14; ++i) {
    if (left.cost < right.cost) {
      high = right.log_factor;
      right = std::move(left);
      left = search.Try(high - kGolden * (high - low));
    } else {
      low = left.log_factor;
      left = std::move(right);
      right = search.Try(low + kGolden * (high - low));
    }
  }
  for (Trial* trial : {&left, &right}) {
    if (trial->cost < best.cost) {
      best = std::move(*trial);
    }
  }
  return best.refinement;
}

}  // namespace raylift
