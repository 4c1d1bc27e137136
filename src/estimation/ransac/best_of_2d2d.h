// What depths say that are wrong together may outvote the 2D-2D matches: of the poses that E5+1 and
// D3+1 make, those that the 2D-2D matches alone like best are kept.

#pragma once

#include <array>
#include <limits>
#include <optional>
#include <vector>

#include "estimation/ransac/ransac.h"

namespace raylift {

// Poses so far apart in rotation (.01 radians) or place (.1 local units) are different answers.
bool AreApart(const CamFromLocal& a, const CamFromLocal& b);

class BestOf2D2D {
 public:
  BestOf2D2D(const NormalizedProblem& problem, OptimizedMatches matches);
  BestOf2D2D(const BestOf2D2D&) = delete;
  BestOf2D2D& operator=(const BestOf2D2D&) = delete;

  // Scorer::ExpectClusters().
  void ExpectClusters(double clustering_2d2d) { scorer_.ExpectClusters(clustering_2d2d); }
  void Consider(const RansacResult& hypothesis);
  // Returns them, locally optimized, where they are other answers than the best pose and leave it
  // in doubt. `scorer` scores that.
  std::vector<RansacResult> ApartFrom(const RansacResult& best, const Scorer& scorer) const;

 private:
  struct BestOfSolver {
    Solver solver;
    std::optional<RansacResult> result = std::nullopt;
    double value = std::numeric_limits<double>::infinity();
  };
  bool IsInDoubt(const SetScores& of_best, const SetScores& of_other) const;

  const NormalizedProblem& problem_;
  OptimizedMatches matches_;
  PoseScore pose_score_;
  Scorer scorer_;
  std::array<BestOfSolver, 2> best_ = {{{Solver::kE5p1}, {Solver::kD3p1}}};
};

}  // namespace raylift
