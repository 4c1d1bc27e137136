#include "estimation/ransac.h"

#include <algorithm>
#include <limits>

namespace raylift {
namespace {

constexpr int kLocalSteps = 6;

// The first samples are soon beaten by others: not worth optimizing.
constexpr int kFirstOptimization = 10;

// A sample comes near the best one if it gains so much of what that gains over no fit at all.
constexpr double kNearBestGain = 0.85;
constexpr int kMaxNearBest = 10;

// The state of one run.
class Ransac {
 public:
  Ransac(const PreparedProblem& problem, const Objective& objective,
         const std::vector<RansacSolver>& solvers, const EstimatorOptions& options)
      : problem_(problem), solvers_(solvers), options_(options), scorer_(problem, objective) {
    JointScore none;
    none.points.cost = problem.num_matches_2d3d;
    none.pairs.cost = problem.num_matches_2d2d;
    worst_value_ = objective.Value(none);
  }

  RansacReport Run(Rng& rng) {
    std::vector<SolverPose> poses;
    int iteration = 0;
    while (iteration < options_.max_iterations &&
           (iteration < options_.min_iterations || iteration < required_iterations_)) {
      ++iteration;
      for (const RansacSolver& solver : solvers_) {
        solver.generator->Generate(rng, poses);
        for (const SolverPose& pose : poses) {
          Consider({pose, solver.solver, solver.refined_kinds});
        }
      }
      if (iteration >= kFirstOptimization) {
        Optimize();
      }
    }
    Optimize();
    return {best_, iteration};
  }

 private:
  // Keeps a sample's pose for optimization if it beats those of all samples before. As the optimum
  // of a second best sample can be the better one (a plane has two, half as many more are made by
  // noise), a few that come near the best are optimized as well.
  void Consider(const RansacResult& hypothesis) {
    const Objective& objective = scorer_.objective();
    const double near_best =
        near_best_left_ > 0
            ? worst_value_ - kNearBestGain * (worst_value_ - std::min(sample_value_, worst_value_))
            : sample_value_;
    const double bound = pending_ ? std::min(near_best, pending_value_) : near_best;
    const auto score = scorer_.ScoreIfBetter(hypothesis.pose, bound);
    if (!score) {
      return;
    }
    pending_ = hypothesis;
    pending_value_ = objective.Value(*score);
    near_best_left_ -= pending_value_ < sample_value_ ? 0 : 1;
    sample_value_ = std::min(sample_value_, pending_value_);
  }

  void Optimize() {
    if (!pending_) {
      return;
    }
    bool improved = TakeIfBetter(*pending_);
    RansacResult optimized = *pending_;
    optimized.pose =
        OptimizeLocally(problem_, pending_->pose, pending_->refined_kinds, kLocalSteps);
    improved = TakeIfBetter(optimized) || improved;
    if (improved) {
      UpdateRequiredIterations();
    }
    pending_.reset();
  }

  bool TakeIfBetter(const RansacResult& candidate) {
    const auto score = scorer_.ScoreIfBetter(candidate.pose, best_value_);
    if (!score) {
      return false;
    }
    best_ = candidate;
    best_value_ = scorer_.objective().Value(*score);
    return true;
  }

  void UpdateRequiredIterations() {
    const InlierCounts inliers = scorer_.CountInliers(best_->pose);
    required_iterations_ = std::numeric_limits<double>::infinity();
    for (const RansacSolver& s : solvers_) {
      required_iterations_ = std::min(required_iterations_,
                                      s.generator->RequiredSamples(inliers, options_.confidence));
    }
  }

  const PreparedProblem& problem_;
  const std::vector<RansacSolver>& solvers_;
  const EstimatorOptions& options_;
  Scorer scorer_;
  double worst_value_;                                             // of a pose that nothing fits
  double sample_value_ = std::numeric_limits<double>::infinity();  // of the best sample
  int near_best_left_ = kMaxNearBest;
  std::optional<RansacResult> pending_;  // to be optimized
  double pending_value_ = std::numeric_limits<double>::infinity();
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
