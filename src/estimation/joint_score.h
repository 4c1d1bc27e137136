// The scores of a pose on both match sets, and the one number by which poses are compared (Eqs. 1
// to 5 of the paper).

#pragma once

#include <limits>
#include <vector>

#include "estimation/prepared_problem.h"
#include "estimation/solvers/p3p.h"

#include "raylift/estimation/pose_estimator.h"

namespace raylift {

// A match set's part: `cost` is the MSAC sum over the squared threshold, M / t^2, over all matches.
struct SetScore {
  double cost = 0;
  int inliers = 0;
};

struct JointScore {
  SetScore points;   // 2D-3D
  SetScore pairs;    // 2D-2D
  double prior = 0;  // PreparedPriors::Cost(): what the pose's priors cost, in matches
};

// The inliers of a pose.
struct InlierCounts {
  SolverPose pose;
  int points = 0;
  std::vector<int> pairs;  // one per view (PreparedProblem::ViewOf())
  // How much more the counts of blocks vary than those of independent matches would: a block's
  // pairs are of one reference, and references are good or bad as a whole.
  double pair_clustering = 1;
};

// What an estimator optimizes: one set's MSAC score, or a combination of both.
class Objective {
 public:
  enum class Sets { kPoints, kPairs, kBoth };

  // `num_points` and `num_pairs`: all matches of the problem.
  Objective(Sets sets, ScoreCombination combination, int num_points, int num_pairs,
            Refinement refinement = Refinement::kRobust);

  bool UsesPoints() const { return sets_ != Sets::kPairs; }
  bool UsesPairs() const { return sets_ != Sets::kPoints; }

  // Smaller is better. Monotone: it grows with each cost and falls with either inlier count, so a
  // bound on each gives a bound on the whole. Priors cost like so many matches of each set.
  double Value(const JointScore& score) const;

 private:
  Sets sets_;
  ScoreCombination combination_;
  Refinement refinement_;
  double num_points_;
  double num_pairs_;
};

// Scores poses of one problem with the kernels. Holds references to its arguments.
class Scorer {
 public:
  Scorer(const PreparedProblem& problem, const Objective& objective);

  // The full score, or none if it is not below `best_value`, or as soon as a part of the matches
  // leaves little hope that it will be.
  std::optional<JointScore> ScoreIfBetter(const SolverPose& pose, double best_value) const;

  // From now on a part of the pairs tells the less of the whole, the more they are clustered.
  void ExpectClusters(double pair_clustering) { pair_clustering_ = pair_clustering; }

  // Both sets, whatever the objective uses.
  JointScore ScoreAll(const SolverPose& pose) const;

  // Inliers of both sets, whatever the objective uses.
  InlierCounts CountInliers(const SolverPose& pose) const;

  const Objective& objective() const { return objective_; }

 private:
  kernels::KernelScore ScorePoints(const SolverPose& pose, int begin, int count) const;

  const PreparedProblem& problem_;
  const Objective& objective_;
  double pair_clustering_ = 1;
};

// The pose as the kernels take it, and for each view the reference's center from the camera's.
template <typename T>
kernels::KernelPose<T> ToKernelPose(const SolverPose& pose);
template <typename T>
std::vector<T> CentersInCam(const PreparedProblem& problem, const SolverPose& pose);

// Hands the runs of blocks that are of one camera to `use(camera, begin, count)`. `camera_of` says
// which camera block i is of.
template <typename CameraOf, typename Use>
void ForEachCamera(int begin, int count, const CameraOf& camera_of, const Use& use) {
  for (int i = begin; i < begin + count;) {
    const int camera = camera_of(i);
    int end = i + 1;
    while (end < begin + count && camera_of(end) == camera) ++end;
    use(camera, i, end - i);
    i = end;
  }
}

}  // namespace raylift
