// The noise of matches: as estimated with one query's pose, and pooled over a scene's queries as
// the prior of a new one's.

#pragma once

#include <span>

namespace raylift {

// The noise of one query's matches as the joint refinement found it, by standard deviations (those
// of pixels are scales).
struct MatchNoise {
  // A keypoint's pixel errs by Student's t: its scale, and the inverse of its degrees of freedom
  // (0: normal).
  double keypoint_px = 0;
  double keypoint_tail = 0;
  // Lifted points err along their rays, by a share of the distance: each by itself, those of a
  // keypoint in common, and whole references by a factor (0 where that is not estimated).
  double depth = 0;
  double common_depth = 0;
  double reference_factor = 0;
  // These are the standard deviations of the references' poses, per axis; 0 where they are not
  // estimated.
  double reference_rotation_deg = 0;
  double reference_position = 0;  // scene units

  // Numbers of errors from which the noise of pixels, depths and common depths was estimated (less
  // than one: a guess).
  double keypoint_errors = 0;
  double depth_errors = 0;
  double common_depth_errors = 0;
};

// A prior of a standard deviation (of pixels: of the scale), as strong as `errors` observed errors.
struct KnownNoise {
  double sigma = 0;
  double errors = 0;

  bool operator==(const KnownNoise&) const = default;
};

// The noise that a scene's queries have in common. A single query with few keypoints cannot tell
// the noise of its depths from its own pose's error.
struct SceneNoise {
  KnownNoise keypoint_px, depth, common_depth;
  // These are the mean and the variance of the tail over the queries; where the variance is 0, they
  // are not known.
  double keypoint_tail = 0;
  double keypoint_tail_variance = 0;
  // Priors of the references' errors (as MatchNoise has them). If one of them is known (from some
  // errors), the joint refinement estimates each reference's errors from the beginning; else only
  // if references disagree.
  KnownNoise reference_factor = {}, reference_rotation_deg = {}, reference_position = {};

  bool operator==(const SceneNoise&) const = default;
};

// Pools the queries' noise by a random-effects model of the variances (DerSimonian and Laird,
// Controlled Clinical Trials 1986): the more a variance differs between queries, the fewer errors
// it is worth. Noise that fewer than three queries have shown stays unknown.
SceneNoise PoolNoise(std::span<const MatchNoise> queries);

}  // namespace raylift
