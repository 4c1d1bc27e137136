// Refining a pose by Levenberg-Marquardt on fixed-size normal equations that the kernels sum.

#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "estimation/joint_score.h"
#include "estimation/prepared_problem.h"
#include "estimation/solvers/p3p.h"
#include <Eigen/Core>

namespace raylift {

// Which residuals take part.
struct ResidualKinds {
  bool points = true;
  bool pairs = true;
};

// Local optimization inside RANSAC: a few steps on the MSAC cost (the sum of both kinds' normalized
// truncated residuals, as in scoring) of the matches near the pose, in single precision. Of many
// matches, a random part.
SolverPose OptimizeLocally(const PreparedProblem& problem, const SolverPose& pose,
                           ResidualKinds kinds, int max_steps);

struct FinalPose {
  SolverPose pose;
  // Of the step (w, v) in the camera's tangent frame, v in local units; none where singular.
  std::optional<Eigen::Matrix<double, 6, 6>> covariance;
};

// The final refinement, in double precision: maximum likelihood with each kind's noise estimated
// from its own inliers, so that inaccurate geometry does not drag the pose, and a robust loss.
//
// Where points and pairs contradict each other, the geometry is to blame: `search_by_pairs` is then
// asked for a pose that the pairs alone find (none: no search), and the refinement starts anew from
// that or from where the pairs lead from `pose`, whichever fits the pairs better.
using PoseSearch = std::function<std::optional<SolverPose>()>;
FinalPose RefineFinally(const PreparedProblem& problem, const SolverPose& pose, ResidualKinds kinds,
                        const PoseSearch& search_by_pairs = {});

// The squared normalized residual of every prepared match of some kinds (of the others none), in
// double precision; infinite where a match lies behind a camera.
struct Residuals {
  std::vector<double> points;
  std::vector<double> pairs;
};
Residuals ComputeResiduals(const PreparedProblem& problem, const SolverPose& pose,
                           ResidualKinds kinds = {});

}  // namespace raylift
