// Judges how sure a smoothed walk is: the probability that frames which agree with each other are
// right.

#pragma once

#include <span>

#include "raylift/sequences/smoothing.h"

namespace raylift {

// Returns whether the frame's own pose, or one of its alternatives, is more likely right than
// wrong.
bool Agrees(const SmoothedFrame& frame);
// Returns the same of the pose that was found where the frame was predicted.
bool IsRematched(const SmoothedFrame& frame);

// Sets the confidence and `against_own` of each frame. Frames between which the odometry was not
// lost are right or wrong together; before the first and after the last one that agrees, or was
// surely found where the walk predicts it, the odometry may have been lost unnoticed.
//
// Frames that follow each other in one place are one witness, as what makes a pose wrong there
// makes the next ones wrong, too. W is the probability that a witness is wrong. A is the sum of log
// W over all witnesses that agree, A_3 that over the surest three, as structure that repeats along
// the walk makes all of them wrong, however many. D_0 is the sum of log W over the frames that do
// not agree, each of which counts with all of its poses; D_k is the sum over another walk k, which
// the other poses of the agreeing frames make, moving as the smoothed one does. The same share s
// makes all sides count as fewer:
//
//   confidence = (1 - exp(A_3)) / (1 - exp(A_3) + exp(A_3 - s D_0) (1 + sum_k (exp(-s D_k) - 1)))
//   s = A_3 / A
//
// A frame that does not agree has a pose of its own that is wrong with probability w, or the
// odometry's pose is not the photograph's, as when it is of another time, with a prior share l of
// such frames and none among those that agree:
//
//   against_own = w / (w + (1 - w) l)
void JudgeWalk(std::span<const WalkEvidence> frames, SmoothedWalk& walk);

}  // namespace raylift
