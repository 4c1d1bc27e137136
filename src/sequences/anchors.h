// Which frames of a walk agree with each other by odometry: the likeliest set of frames whose own
// poses are right, by dynamic programming along the walk.

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

// How many frames with a pose back one may be tied to.
inline constexpr size_t kWindow = 30;

// The probability that the odometry is lost in a step.
inline constexpr double kLost = 0.01;

// A frame, and which of its own poses is right.
struct Anchor {
  size_t frame = 0;
  size_t single = 0;
  bool lost_before = false;  // the odometry does not tell how it lies to the anchor before
};

// How far the camera went and turned from the frame before.
StepLength LengthOfStep(const WalkEvidence& before, const WalkEvidence& frame);

// The steps before each frame, each over the walk's mean one: half by their length, half by their
// angle; 0 for the first.
std::vector<double> StepAmounts(std::span<const WalkEvidence> frames);

// cam_from_cam of the later frame from the earlier one by odometry.
Rigid3 OdometryStep(const Rigid3& later, const Rigid3& earlier, double scale);

// The confidences that a frame's own poses count with: neither surely wrong nor together as sure as
// that the odometry holds. Where the first has alternatives, one more that was not found is as likely
// as these are on average.
std::vector<double> UsedConfidences(const WalkEvidence& frame);

// The density of wrong poses, as Mixture has it, where the scene has this size.
double LogDensityAnywhere(double extent);

// How far the walk reaches in the scene.
double ExtentOf(std::span<const WalkEvidence> frames, double scale);

// Scene units per unit of odometry, the one that most pairs of frames with a pose agree on; nullopt
// where no three frames, which lie apart, do.
std::optional<double> ScaleByPairs(std::span<const WalkEvidence> frames);

std::vector<Anchor> FindAnchors(std::span<const WalkEvidence> frames, double scale,
                                const StepNoise& noise);

}  // namespace raylift
