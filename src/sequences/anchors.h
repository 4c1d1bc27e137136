// Finds the anchors of a walk, the frames whose own poses agree with each other by odometry: the
// likeliest set of frames whose poses are right, by dynamic programming along the walk.

#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "sequences/chain.h"

#include "raylift/sequences/smoothing.h"

namespace raylift {

// The odometry's noise: variances over a step of amount 1 (StepAmounts()).
struct StepNoise {
  double position_variance = 0;
  double rotation_variance = 0;  // radians squared
};

// The number of frames with a pose, before a frame, that it may be tied to.
inline constexpr size_t kWindow = 30;

// The probability that the odometry is lost in a step.
inline constexpr double kLost = 0.01;

// A frame whose own pose is right, and which of its own poses that is.
struct Anchor {
  size_t frame = 0;
  size_t single = 0;
  bool lost_before = false;  // the odometry does not tell how it lies to the anchor before
};

// Returns how far the camera went and turned from the frame before.
StepLength LengthOfStep(const WalkEvidence& before, const WalkEvidence& frame);

// Returns the amount of the step before each frame, relative to the walk's mean step: half by its
// length, half by its angle; 0 for the first frame.
std::vector<double> StepAmounts(std::span<const WalkEvidence> frames);

// Returns later_from_earlier, the camera's motion by odometry: later * earlier^-1, its translation
// times `scale`.
Rigid3 OdometryStep(const Rigid3& later, const Rigid3& earlier, double scale);

// Returns the confidences that a frame's own poses count with: neither surely wrong nor together as
// sure as that the odometry holds. Where the first has alternatives, one more that was not found is
// as likely as these are on average.
std::vector<double> UsedConfidences(std::span<const SinglePose> singles);

// Returns the logarithm of the density of wrong poses, as Mixture has it, in a scene of this size.
double LogDensityAnywhere(double extent);

// Returns how far the walk reaches in the scene, in scene units.
double ExtentOf(std::span<const WalkEvidence> frames, double scale);

// Returns the scale, scene units per unit of odometry, that most pairs of frames with a pose agree
// on; nullopt where no two pairs of frames that lie apart agree.
std::optional<double> ScaleByPairs(std::span<const WalkEvidence> frames);

std::vector<Anchor> FindAnchors(std::span<const WalkEvidence> frames, double scale,
                                const StepNoise& noise);

}  // namespace raylift
