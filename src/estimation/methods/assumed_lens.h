// The lens of a photograph of an unknown camera, of which no more than a range of focal lengths is
// known: the principal point is somewhere near the middle, and the lens distorts.

#pragma once

#include <optional>

#include "estimation/problem/cam_from_local.h"
#include "estimation/problem/normalized_problem.h"

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

// These are the standard deviation of a lens's radial term, and the furthest from 0 that it is
// searched for.
inline constexpr double kRadialSigma = 0.2;
inline constexpr double kFurthestRadial = 2 * kRadialSigma;

// Returns whether the query's camera is no more than a guess: its focal length is to be found, and
// it has its principal point in the middle and no distortion.
bool LensIsAssumed(const Camera& camera, const PosePriors& priors);

// Returns a SIMPLE_PINHOLE camera as RADIAL.
Camera WithRadialTerms(const Camera& camera);
// Returns a RADIAL camera whose first radial term is more by so much.
Camera WithRadialMoved(const Camera& camera, double by);
double RadialTerm(const Camera& camera);

struct AssumedLens {
  Camera camera;
  // The part of the pose's covariance that is due to the lens: that of the step (w, v) in the
  // camera's tangent frame, scene units.
  Matrix6d pose_covariance;
};

// Refines lens and pose by Gauss-Newton on the 2D-3D matches and the priors of lenses and of the
// pose, from a lens (RADIAL) and a pose that they fit. The focal length is within a factor of
// `range` of that of `assumed`. Where the matches tell little, the lens stays as uncertain as
// lenses are; nullopt where they are too few. `normalized` is of the problem with any camera.
std::optional<AssumedLens> RefineAssumedLens(const PoseProblem& problem,
                                             const NormalizedProblem& normalized,
                                             const Camera& start, const Rigid3& cam_from_world,
                                             const Camera& assumed, double range,
                                             double threshold_px);

}  // namespace raylift
