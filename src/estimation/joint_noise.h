// What the matches of one query are worth: the variances and shares that the joint refinement
// estimates together with the pose.

#pragma once

namespace raylift {

struct JointNoise {
  // Of a keypoint's pixel, in either image: squared scale and tail of Student's t (student_t.h).
  double keypoint_px2 = 1;
  double keypoint_tail = 0.25;
  // Of the logarithm of a lifted point's distance: of each point by itself, and what the points of
  // one keypoint have in common, as a mesh is wrong alike for all references.
  double depth = 1e-4;
  double common_depth = 5e-5;
  double loose = 1e-6;  // of each coordinate of a loose point, local units squared
  // Shares: of right matches, of right depths among those, of right loose points.
  double right = 0.7;
  double depth_right = 0.8;
  double loose_right = 0.7;
  // How many errors have shown the variances of pixels, depths and common depths.
  double keypoint_errors = 0;
  double depth_errors = 0;
  double common_depth_errors = 0;
  // Of the logarithm of the distance from the query, over all keypoints.
  double log_distance_mean = 0;
  double log_distance_variance = 1;
  // Of what is common to a reference: the logarithm of its depths' factor, and its pose (radians
  // and local units, per axis). 0: not looked for.
  double reference_factor = 0;
  double reference_rotation = 0;
  double reference_center = 0;
};

}  // namespace raylift
