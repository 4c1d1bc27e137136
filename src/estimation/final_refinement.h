// The final refinement of the pose that RANSAC found, and which kind of matches it believes.

#pragma once

#include <functional>
#include <optional>

#include "estimation/match_residuals.h"
#include "estimation/prepared_problem.h"
#include "estimation/solvers/p3p.h"
#include <Eigen/Core>

namespace raylift {

struct FinalPose {
  SolverPose pose;
  // Of the step (w, v) in the camera's tangent frame, v in local units; none where singular.
  std::optional<Eigen::Matrix<double, 6, 6>> covariance;
};

// Maximum likelihood (see MaximumLikelihood) of the kinds of matches in use.
//
// Where points and pairs contradict each other, the geometry is to blame: `search_by_pairs` is then
// asked for a pose that the pairs alone find (none: no search), and the refinement starts anew from
// that or from where the pairs lead from `pose`, whichever fits the pairs better.
using PoseSearch = std::function<std::optional<SolverPose>()>;
FinalPose RefineFinally(const PreparedProblem& problem, const SolverPose& pose, ResidualKinds kinds,
                        const PoseSearch& search_by_pairs = {});

}  // namespace raylift
