// Joins the pose problems of a rig's photographs to one, and splits its estimate by photograph.

#pragma once

#include <span>

#include "raylift/estimation/pose_estimator.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

// Joins the problems. The first photograph's camera is the query's own. References that several of
// them have, by name, are one; covisibility clusters are left out.
PoseProblem JoinProblems(std::span<const PoseProblem* const> photographs,
                         std::span<const Rigid3> cam_from_rig);

// Returns the rig's estimate for the camera of one of the photographs: its pose, with that pose's
// covariance, and the inliers among its own matches. Scores, confidence and verdict are the rig's.
PoseEstimate EstimateOfCamera(const PoseProblem& joined, const PoseEstimate& estimate, int camera);

}  // namespace raylift
