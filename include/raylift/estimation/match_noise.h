// The noise of matches: as the estimate of one query found it, and as the queries of a scene
// foretell a new one's.

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
  // keypoint in common, and whole references by a factor (0: not looked for).
  double depth = 0;
  double common_depth = 0;
  double reference_factor = 0;
  // The references' poses err by this, per axis; 0: not looked for.
  double reference_rotation_deg = 0;
  double reference_position = 0;  // scene units

  // How many errors have shown it (less than one: a guess).
  double keypoint_errors = 0;
  double depth_errors = 0;
  double common_depth_errors = 0;
};

// A standard deviation (of pixels, a scale) that is known before, as if so many errors had shown
// it.
struct KnownNoise {
  double sigma = 0;
  double errors = 0;

  bool operator==(const KnownNoise&) const = default;
};

// The noise that a scene's queries have in common. A single query with few keypoints cannot tell
// the noise of its depths from its own pose's error.
struct SceneNoise {
  KnownNoise keypoint_px, depth, common_depth;
  // Mean and variance over the queries; no variance: not known.
  double keypoint_tail = 0;
  double keypoint_tail_variance = 0;
  // How whole references err (MatchNoise's). Where it is known, each reference's error is unknown
  // from the beginning; where it is not (no errors), only if references disagree.
  KnownNoise reference_factor = {}, reference_rotation_deg = {}, reference_position = {};

  bool operator==(const SceneNoise&) const = default;
};

// By a random-effects model of the variances (DerSimonian and Laird, Controlled Clinical Trials
// 1986): what differs from query to query is worth few errors. Noise that fewer than three queries
// have shown is not known.
SceneNoise PoolNoise(std::span<const MatchNoise> queries);

}  // namespace raylift
