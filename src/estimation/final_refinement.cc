#include "estimation/final_refinement.h"

#include <algorithm>

#include "estimation/local_optimization.h"
#include "estimation/maximum_likelihood.h"

namespace raylift {
namespace {

// Where both kinds disagree by more than noise explains (one case in 100), the geometry is to
// blame, which pairs do not need: its errors are common to many points, and their residuals do not
// show them. The refinement then starts anew from where the pairs alone lead, and the points'
// variance is raised fourfold until both agree well.
constexpr double kLargestPull = 16.8;
constexpr double kSettledPull = 0.5;
constexpr int kMaxInflations = 8;
constexpr int kStepsOfPairsAlone = 20;

constexpr ResidualKinds kPairsAlone{.points = false, .pairs = true};

double PairCost(const PreparedProblem& problem, const SolverPose& pose) {
  double cost = 0;
  for (const double e2 : ComputeResiduals(problem, pose, kPairsAlone).pairs) {
    cost += std::min(e2, 1.0);
  }
  return cost;
}

// Where the pairs lead from a pose, or what a search by them finds if that fits them better.
SolverPose BestByPairs(const PreparedProblem& problem, const SolverPose& pose,
                       const PoseSearch& search_by_pairs) {
  const SolverPose led = OptimizeLocally(problem, pose, kPairsAlone, kStepsOfPairsAlone);
  const auto found = search_by_pairs ? search_by_pairs() : std::nullopt;
  return found && PairCost(problem, *found) < PairCost(problem, led) ? *found : led;
}

}  // namespace

FinalPose RefineFinally(const PreparedProblem& problem, const SolverPose& pose, ResidualKinds kinds,
                        const PoseSearch& search_by_pairs) {
  MaximumLikelihood refinement(problem, kinds);
  refinement.Refine(pose);
  if (kinds.points && kinds.pairs && refinement.PullOnPairs() > kLargestPull) {
    refinement.Refine(BestByPairs(problem, pose, search_by_pairs));
    for (int i = 0; i < kMaxInflations && refinement.PullOnPairs() > kSettledPull; ++i) {
      refinement.DistrustPoints();
    }
  }
  return {refinement.pose(), refinement.Covariance()};
}

}  // namespace raylift
