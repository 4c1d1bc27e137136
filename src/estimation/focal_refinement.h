// The focal length of the query, refined with its pose.

#pragma once

#include "estimation/match_residuals.h"

#include "raylift/estimation/pose_estimator.h"
#include "raylift/geometry/camera.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

struct FocalRefinement {
  Camera camera;
  Rigid3 cam_from_world;
};

// The focal length, within 30 % of the camera's, under which the refined pose has the lowest MSAC
// cost of the kinds of matches in use: a search along one dimension, with the pose refined at each
// point. Starts from a pose of the problem as it is.
FocalRefinement RefineFocal(const PoseProblem& problem, const Rigid3& cam_from_world,
                            ResidualKinds kinds, const EstimatorOptions& options);

}  // namespace raylift
