// The joint refinement's keypoints in blocks of eight, and its kernels on them: the normal
// equations with the points eliminated, their step, and the E step. README.md in src/estimation has
// the equations.
//
// The blocks have the evidence and the unknowns that belong to keypoints. A block's pieces are
// slots: slot j has the j-th observation of each of the block's keypoints. A lane that has none
// counts for nothing. Plain declarations only: this header is compiled for several instruction
// sets.

#pragma once

namespace raylift::kernels {

using Row = double[8];

struct alignas(64) JointKeypoints {
  Row image_from_cam[9];
  Row camera_center[3];
  Row px_by_log_focal[2];
  // These are the unknowns, the probability that the query's pixel is right, and its precision over
  // the mean one.
  Row point[3];
  Row common;  // error of the depths
  Row query_right, query_precision;

  // After linearizing `covariance` is H_pp^-1, the upper triangle row by row, and `gradient` is
  // g_p; both are zero where nothing tells of the point. `query_hessian` is the query's Hessian by
  // the point and the mean distance, `by_focal` is d^2 cost / d p d focal length's logarithm, and
  // `pose_gradient` is the keypoint's part of the gradient by the query's unknowns.
  Row covariance[10];
  Row gradient[4];
  Row query_hessian[10];
  Row by_focal[3];
  Row pose_gradient[7];

  int first_observation, end_observation;
  int first_unanchored, end_unanchored;
  bool has_depths;
};

struct alignas(64) JointObservations {
  Row is_there;  // 1 or 0, as of `has_depth`
  Row image_from_ray[9];
  Row center[3], ray[3];
  Row extra_variance_px2;
  Row has_depth, log_distance, depth_variance;
  Row epipolar_clutter;
  // These are the reference's error and its last step: (rotation vector, translation, log scale).
  Row reference_error[7], reference_step[7];
  // These are the probabilities that the observation is right, and that its depth is, and the
  // precision of its pixel over the mean one.
  Row weight, depth, precision;

  // While voting these are the pixel's residual as the point moves along the query's ray (at
  // infinity, direction, offset, slope), its smallest square, and the density of a right depth over
  // that of any.
  Row scan[6], smallest_px2, depth_ratio;
  // When linearized, these are the pixel's residual and the depth's, their derivatives by the point
  // and their weights over their variances.
  Row jacobian[6], error_px[2], pixel_weight;
  Row log_gradient[3], depth_error, depth_weight;
  // After the E step these are the pixel's error as all else predicts it, its covariance (xx, xy,
  // yy), and whether (1 or 0) it says something of the noise.
  Row predicted_px[2], predicted_covariance[3], tells_noise;
};

struct alignas(64) JointUnanchored {
  Row is_there;
  Row point[3];
  Row variance;
  Row px2;  // while voting: squared pixels per squared local unit; 0 behind the camera
  Row weight;
};

struct JointBlocks {
  JointKeypoints* keypoints;
  int count;
  JointObservations* observations;
  JointUnanchored* unanchored;
};

// The parameters that all keypoints have in common; see CamFromLocal, JointNoise, ReferenceError.
struct JointParameters {
  double rotation[9] = {}, translation[3] = {};  // row-major
  double focal_error = 0;
  bool is_focal_unknown = false;
  bool have_references_errors = false;
  double unanchored_error[6] = {}, unanchored_step[6] = {};  // rotation vector, translation
  double keypoint_px2, keypoint_tail, depth, common_depth, unanchored;
  double right, depth_right, unanchored_right;
  double log_distance_mean, log_distance_variance;
  double matched_area_px2;
  double least_weight;
};

struct JointVoting {
  double far, fit;  // squared errors, in variances: of no right match, and of one in a hundred
};

struct JointNormals {
  double hessian[28];  // of the query's seven unknowns, the upper triangle row by row
  double gradient[7];
  // Derivatives by the focal length's logarithm, where that is unknown: mixed ones with the query's
  // unknowns, first and second.
  double mixed[7], slope, curvature;
};

struct JointExpectation {
  double share;        // of the way to their new values that weights go
  double far;          // squared, in variances
  double query_wrong;  // probability
  bool is_pose_certain;
  double query_covariance[49] = {};
};

// Sums of squared errors times their weights, and how many errors the unknowns have not explained.
struct JointSum {
  double squares, count;
};
struct JointSums {
  JointSum pixels, depths, commons, unanchored;
  double right, unanchored_right;   // weights
  double depth_right, depth_count;  // weights of right depths, of all
  double log_likelihood;
};

}  // namespace raylift::kernels
