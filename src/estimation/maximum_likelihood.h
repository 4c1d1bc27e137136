// Refining a pose, in double precision, with each kind's noise estimated from its own inliers, so
// that inaccurate geometry does not drag the pose, and a robust loss.

#pragma once

#include <optional>
#include <vector>

#include "estimation/focal_step.h"
#include "estimation/match_residuals.h"
#include "estimation/pose_minimizer.h"
#include "estimation/prepared_problem.h"
#include "estimation/solvers/p3p.h"

namespace raylift {

// Holds a reference to the problem.
class MaximumLikelihood {
 public:
  MaximumLikelihood(const PreparedProblem& problem, ResidualKinds kinds)
      : problem_(problem), kinds_(kinds) {}

  void Refine(const SolverPose& start);

  // Takes the pose as it is, for its covariance.
  void StayAt(const SolverPose& pose);

  // Of the step (w, v) in the camera's tangent frame; none where singular.
  std::optional<Matrix6d> Covariance() const;

  // What the matches near the pose say of the focal length. `shorter` and `longer` are the problem
  // with it divided and multiplied by exp(log_factor), a small number. None where matches have a ray
  // in one of them alone.
  std::optional<FocalStep> StepOfFocal(const PreparedProblem& shorter,
                                       const PreparedProblem& longer, double log_factor) const;

  const SolverPose& pose() const { return pose_; }

 private:
  // Blocks of the matches near the pose.
  struct GatheredMatches {
    PointBlocks<double> points;
    PairBlocks<double> pairs;

    ActiveMatches<double> Active() const {
      return {points.blocks, points.block_camera, pairs.blocks, pairs.block_view};
    }
  };

  void Gather();
  void Minimize();

  const PreparedProblem& problem_;
  ResidualKinds kinds_;
  SolverPose pose_;
  KindWeights weights_;
  GatheredMatches near_;
};

}  // namespace raylift
