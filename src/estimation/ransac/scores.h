// The scores of a pose on both match sets, and the one number by which poses are compared (Eqs. 1
// to 5 of the paper).

#pragma once

#include <optional>
#include <vector>

#include "estimation/problem/normalized_problem.h"

#include "raylift/estimation/options.h"

namespace raylift {

// Holds a match set's part: `cost` is the MSAC sum over the squared threshold, M / t^2, over all
// matches.
struct SetScore {
  double cost = 0;
  int inliers = 0;
};

// Both sets' parts, and the priors'.
struct SetScores {
  SetScore of_2d3d;
  SetScore of_2d2d;
  double prior = 0;  // NormalizedPriors::Cost(): what the pose's priors cost, in matches
};

// The inliers of a pose.
struct InlierCounts {
  CamFromLocal pose;
  int of_2d3d = 0;
  std::vector<int> of_2d2d;  // by NormalizedProblem::CameraReferenceIndex()
  // The variance of the blocks' inlier counts over that of independent matches, at least 1: a
  // block's matches are of one reference, and references are good or bad as a whole.
  double clustering_2d2d = 1;
};

// The number by which poses are compared: one set's MSAC score, or a combination of both
// (EstimatorOptions::score).
class PoseScore {
 public:
  // `num_2d3d` and `num_2d2d` count all matches of the problem.
  PoseScore(MatchSets sets, ScoreCombination combination, int num_2d3d, int num_2d2d,
            Refinement refinement = Refinement::kRobust);

  MatchSets sets() const { return sets_; }

  // Returns the pose's value, smaller is better. It grows with each cost and falls with either
  // inlier count, so that a bound on each gives a bound on the whole. Priors cost like so many
  // matches of each set.
  double Value(const SetScores& score) const;

 private:
  MatchSets sets_;
  ScoreCombination combination_;
  Refinement refinement_;
  double num_2d3d_;
  double num_2d2d_;
};

// Scores poses of one problem with the kernels. Holds references to its arguments.
class Scorer {
 public:
  Scorer(const NormalizedProblem& problem, const PoseScore& pose_score);

  // Returns the full scores; nullopt if their value is not below `best_value`, which is told as
  // soon as a part of the matches leaves little hope that it will be.
  std::optional<SetScores> ScoreIfBetter(const CamFromLocal& pose, double best_value) const;

  // Sets how clustered the 2D-2D matches are: the more, the less a part of them tells of the whole.
  void ExpectClusters(double clustering_2d2d) { clustering_2d2d_ = clustering_2d2d; }

  // Scores both sets, whatever the pose score uses.
  SetScores ScoreAll(const CamFromLocal& pose) const;

  // Counts the inliers of both sets, whatever the pose score uses.
  InlierCounts CountInliers(const CamFromLocal& pose) const;

  const PoseScore& pose_score() const { return pose_score_; }

 private:
  kernels::KernelScore Score2D3D(const CamFromLocal& pose, int begin, int count) const;

  const NormalizedProblem& problem_;
  const PoseScore& pose_score_;
  double clustering_2d2d_ = 1;
};

}  // namespace raylift
