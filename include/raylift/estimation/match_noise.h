// What matches are worth: what the estimate of one query found, and what the queries of a scene
// tell of a new one's.

#pragma once

#include <span>

namespace raylift {

// What Adaptive found the matches of a query to be worth, as standard deviations (of pixels, as
// scales).
struct MatchNoise {
  // Of a keypoint's pixel: the scale of Student's t, and the inverse of its degrees of freedom (0:
  // normal).
  double keypoint_px = 0;
  double keypoint_tail = 0;
  // Of lifted points along their rays, as a share of the distance: each by itself, what those of a
  // keypoint have in common, and the factors of whole references (0: not looked for).
  double depth = 0;
  double common_depth = 0;
  double reference_factor = 0;
  // Of the references' poses, per axis; 0: not looked for.
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

// What is common to a scene's queries. A single query with few keypoints cannot tell the noise of
// its depths from its own pose's error.
struct SceneNoise {
  KnownNoise keypoint_px, depth, common_depth;
  // Mean and variance over the queries; no variance: not known.
  double keypoint_tail = 0;
  double keypoint_tail_variance = 0;

  bool operator==(const SceneNoise&) const = default;
};

// By a random-effects model of the variances (DerSimonian and Laird, Controlled Clinical Trials
// 1986): what differs from query to query is worth few errors. What fewer than three queries have
// shown is not known.
SceneNoise PoolNoise(std::span<const MatchNoise> queries);

}  // namespace raylift
