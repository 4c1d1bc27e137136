// Agreement of the matches between references with the references' poses, which does not depend
// on any depth: a keypoint's match must lie on its epipolar line, in front of both cameras.

#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/lifting/depth_alignment.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

// Returns what the errors of keypoints and of poses that were estimated from them amount to: a
// match farther than this from its epipolar line is wrong, or its poses are.
double EpipolarThresholdPx(const Camera& camera);

// Returns the reference as another convention reads its pose, which is in memory as `as_read`.
PosedImage ReadAs(const PosedImage& reference, PoseConvention as_read, PoseConvention poses);

struct MatchAgreement {
  PoseConvention poses = PoseConvention::kCamFromWorld;
  std::vector<bool> agrees = {};  // of each match
  size_t num_agreeing = 0;
  double chance = 0;      // the share that agrees where keypoints are matched at random
  size_t num_random = 0;  // of those; few tell nothing of chance
  double median_px = 0;   // distance from the epipolar line of those that agree

  // Returns the share of all matches that agree by more than chance.
  double Skill() const;
  // Returns that share of the matches that agree.
  double Purity() const;
};

MatchAgreement Agreement(std::span<const PosedImage> references,
                         std::span<const ReferenceMatch> matches, PoseConvention as_read,
                         PoseConvention poses, int threads);

}  // namespace raylift
