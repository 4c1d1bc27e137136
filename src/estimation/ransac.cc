#include "estimation/ransac.h"

#include <algorithm>
#include <limits>

namespace raylift {
namespace {

constexpr int kLocalSteps = 6;

std::vector<bool> BelowOne(const std::vector<double>& squared_residuals) {
  std::vector<bool> inliers(squared_residuals.size());
  for (size_t i = 0; i < inliers.size(); ++i) {
    inliers[i] = squared_residuals[i] < 1;
  }
  return inliers;
}

// The state of one run.
class Ransac {
 public:
  Ransac(const PreparedProblem& problem, const Objective& objective,
         const std::vector<RansacSolver>& solvers, const EstimatorOptions& options)
      : problem_(problem), solvers_(solvers), options_(options), scorer_(problem, objective) {}

  RansacReport Run(Rng& rng) {
    std::vector<SolverPose> poses;
    int iteration = 0;
    while (iteration < options_.max_iterations &&
           (iteration < options_.min_iterations || iteration < required_iterations_)) {
      ++iteration;
      const RansacSolver* new_best = nullptr;
      for (const RansacSolver& solver : solvers_) {
        solver.generator->Generate(rng, poses);
        for (const SolverPose& pose : poses) {
          if (TakeIfBetter(pose, solver)) {
            new_best = &solver;
          }
        }
      }
      if (new_best != nullptr) {
        Optimize(*new_best);
      }
    }
    return {best_, iteration};
  }

 private:
  bool TakeIfBetter(const SolverPose& pose, const RansacSolver& solver) {
    const auto score = scorer_.ScoreIfBetter(pose, best_value_);
    if (!score) {
      return false;
    }
    best_ = {pose, solver.solver, solver.refined_kinds};
    best_value_ = scorer_.objective().Value(*score);
    return true;
  }

  void Optimize(const RansacSolver& solver) {
    const SolverPose pose =
        OptimizeLocally(problem_, best_->pose, solver.refined_kinds, kLocalSteps);
    TakeIfBetter(pose, solver);
    const Residuals residuals = ComputeResiduals(problem_, best_->pose);
    const std::vector<bool> points = BelowOne(residuals.points);
    const std::vector<bool> pairs = BelowOne(residuals.pairs);
    required_iterations_ = std::numeric_limits<double>::infinity();
    for (const RansacSolver& s : solvers_) {
      required_iterations_ = std::min(
          required_iterations_, s.generator->RequiredSamples(points, pairs, options_.confidence));
    }
  }

  const PreparedProblem& problem_;
  const std::vector<RansacSolver>& solvers_;
  const EstimatorOptions& options_;
  Scorer scorer_;
  std::optional<RansacResult> best_;
  double best_value_ = std::numeric_limits<double>::infinity();
  double required_iterations_ = std::numeric_limits<double>::infinity();
};

}  // namespace

RansacReport RunRansac(const PreparedProblem& problem, const Objective& objective,
                       const std::vector<RansacSolver>& solvers, const EstimatorOptions& options,
                       Rng& rng) {
  if (solvers.empty()) {
    return {};
  }
  return Ransac(problem, objective, solvers, options).Run(rng);
}

}  // namespace raylift
