// How sure a smoothed walk is: the probability that frames which agree with each other are right.

#pragma once

#include <span>

#include "raylift/sequences/smoothing.h"

namespace raylift {

// Whether the frame's own pose, or one of its alternatives, is rather right.
bool Agrees(const SmoothedFrame& frame);

// Sets the confidence of each frame. Frames between which the odometry was not lost are right or
// wrong together; before the first and after the last one that agrees it may have been lost without
// a sign of it.
//
// Frames that follow each other in one place are one witness, as what makes a pose wrong there makes
// the next ones wrong, too. W is the probability that a witness is wrong, A the sum of log W over
// all that agree, A_3 that of the surest three, as what repeats along the walk makes all of them
// wrong, however many. Against them speak the frames that do not agree, each by all that it says,
// by the sum D_0 of their log W; and, by D_k, each other walk that the other poses of those that
// agree make, moving as the smoothed one does. All sides count as fewer by the same share:
//
//   confidence = (1 - exp(A_3)) / (1 - exp(A_3) + exp(A_3 - s D_0) (1 + sum_k (exp(-s D_k) - 1)))
//   s = A_3 / A
void JudgeWalk(std::span<const WalkEvidence> frames, SmoothedWalk& walk);

}  // namespace raylift
