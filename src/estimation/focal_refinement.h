// The focal length of the query, found with its pose.

#pragma once

#include <optional>
#include <vector>

#include "estimation/match_residuals.h"
#include "estimation/normal_equations.h"

#include "raylift/estimation/pose_estimator.h"
#include "raylift/geometry/camera.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

// Where a focal length that is within a factor of the camera's is looked for: so close to each
// other that the pose found with the nearest one leads to the true one. The camera itself is the
// first.
std::vector<Camera> FocalCandidates(const Camera& camera, double range);

struct FocalRefinement {
  Camera camera;
  // What the pose's covariance lacks where the camera is taken for granted: of the step (w, v) in
  // the camera's tangent frame, scene units. None where the matches do not tell.
  std::optional<Matrix6d> covariance_by_focal;
};

// The focal length near the problem's, and within a factor of `middle_px`, that the kinds of matches
// in use speak for. A search along one dimension for the lowest MSAC cost, with the pose
// refined at each point, and from there, where poses are refined by maximum likelihood, Newton's
// steps on the likelihood. Starts from a pose of the problem as it is.
FocalRefinement RefineFocal(const PoseProblem& problem, const Rigid3& cam_from_world,
                            ResidualKinds kinds, const EstimatorOptions& options, double middle_px,
                            double range);

}  // namespace raylift
