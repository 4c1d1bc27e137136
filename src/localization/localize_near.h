// Localizes a query again of whose pose something is known besides.

#pragma once

#include <span>

#include <Eigen/Core>

#include "raylift/geometry/rigid3.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/match_source.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// A pose with the covariance of its step (w, v), as PoseEstimate has it.
struct PredictedPose {
  Rigid3 cam_from_world;
  Eigen::Matrix<double, 6, 6> covariance;
};

// Adds a prediction to what is known of a pose, in place of what is known of the same: the center
// with deviations along the axes of the world in which its distribution is nowhere narrower than
// the prediction's, and the orientation with its largest deviation.
PosePriors WithPrediction(PosePriors priors, const PredictedPose& predicted);

// Localizes the query by its matches in `matches` with these references, best first, near where
// they are seen from the predicted pose: RANSAC draws with the prediction as prior, and its pose is
// refined without, so that the estimate is what the matches and the query's own priors say. It is
// as sure as with the prediction, which tells how far away the matched scene is where they do not.
// Throws InputError as MatchWithin() and GeometrySource::Lift() do.
QueryResult LocalizeNear(const PredictedPose& predicted, const Localizer& localizer,
                         const MatchSource& matches, const Query& query,
                         std::span<const PosedImage> references);

}  // namespace raylift
