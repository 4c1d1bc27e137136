#include "estimation/ransac/best_of_2d2d.h"

#include <algorithm>
#include <cmath>

namespace raylift {

bool AreApart(const CamFromLocal& a, const CamFromLocal& b) {
  constexpr double kRotation = 0.01;
  constexpr double kTranslation = 0.1;
  const Eigen::Matrix3d rotation = a.rotation * b.rotation.transpose();
  const Eigen::Vector3d translation =
      a.rotation.transpose() * a.translation - b.rotation.transpose() * b.translation;
  return rotation.trace() < 1 + 2 * std::cos(kRotation) || translation.norm() > kTranslation;
}

BestOf2D2D::BestOf2D2D(const NormalizedProblem& problem, OptimizedMatches matches)
    : problem_(problem),
      matches_(matches),
      pose_score_(MatchSets::k2D2D, ScoreCombination::kSumMsac, problem.num_matches_2d3d,
                  problem.num_matches_2d2d),
      scorer_(problem, pose_score_) {}

void BestOf2D2D::Consider(const RansacResult& hypothesis) {
  for (BestOfSolver& best : best_) {
    if (hypothesis.solver != best.solver) continue;
    const auto score = scorer_.ScoreIfBetter(hypothesis.pose, best.value);
    if (!score) return;
    best.result = hypothesis;
    best.value = pose_score_.Value(*score);
  }
}

std::vector<RansacResult> BestOf2D2D::ApartFrom(const RansacResult& best,
                                                const Scorer& scorer) const {
  std::vector<RansacResult> others;
  const SetScores of_best = scorer.ScoreAll(best.pose);
  for (const BestOfSolver& of_solver : best_) {
    if (!of_solver.result) continue;
    RansacResult optimized = *of_solver.result;
    optimized.pose =
        OptimizeLocally(problem_, optimized.pose, MatchSets::k2D2D, kLocalSteps, matches_);
    const bool is_new = AreApart(optimized.pose, best.pose) &&
                        std::all_of(others.begin(), others.end(), [&](const RansacResult& other) {
                          return AreApart(other.pose, optimized.pose);
                        });
    if (is_new && IsInDoubt(of_best, scorer.ScoreAll(optimized.pose))) others.push_back(optimized);
  }
  return others;
}

// The 2D-2D matches contradict the best pose where it explains fewer of them than another pose, by
// three standard deviations of their number, or a much smaller share of the 2D-3D matches than of
// the 2D-2D matches. Then depths of some references are wrong together.
bool BestOf2D2D::IsInDoubt(const SetScores& of_best, const SetScores& of_other) const {
  constexpr double kShare = 0.75;
  const double inliers = of_best.of_2d2d.inliers;
  const double of_2d3d = of_best.of_2d3d.inliers / std::max(1.0, 1.0 * problem_.num_matches_2d3d);
  const double of_2d2d = inliers / std::max(1.0, 1.0 * problem_.num_matches_2d2d);
  return of_2d3d < kShare * of_2d2d ||
         of_best.of_2d2d.cost - of_other.of_2d2d.cost > 3 * std::sqrt(inliers);
}

}  // namespace raylift
