// The model of the joint refinement: its unknowns, how they explain the evidence, and the noise
// that is estimated with them. README.md in src/estimation has the equations.

#pragma once

#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include "estimation/kernels/joint.h"
#include "estimation/kernels/kernels.h"
#include "estimation/problem/cam_from_local.h"
#include "estimation/problem/observations.h"
#include "estimation/refinement/joint/student_t.h"
#include <Eigen/Core>

namespace raylift {

// The noise of one query's matches: variances, and the shares of what is right.
struct JointNoise {
  // The squared scale and the tail of Student's t (student_t.h) of a keypoint's pixel, in either
  // image.
  double keypoint_px2 = 1;
  double keypoint_tail = 0.25;
  // The variances of the logarithm of a lifted point's distance: of each point by itself, and of
  // the error that the points of one keypoint have in common, as a mesh is wrong alike for all
  // references.
  double depth = 1e-4;
  double common_depth = 5e-5;
  double unanchored = 1e-6;  // of each coordinate of an unanchored point, local units squared
  // These are the shares of right matches, of right depths among those, and of right unanchored
  // points.
  double right = 0.7;
  double depth_right = 0.8;
  double unanchored_right = 0.7;
  // Numbers of errors from which the variances of pixels, depths and common depths were estimated.
  double keypoint_errors = 0;
  double depth_errors = 0;
  double common_depth_errors = 0;
  // The mean and variance over all keypoints of the logarithm of the distance from the query.
  double log_distance_mean = 0;
  double log_distance_variance = 1;
  // These are the variances of a reference's errors: of the logarithm of its depths' scale, and of
  // its pose (radians and local units, per axis). They are 0 where they are not estimated.
  double reference_scale = 0;
  double reference_rotation = 0;
  double reference_center = 0;
};

// A keypoint in one image as the joint refinement sees it, and the densities that it compares.

// The residual of a ray in an image, pixels, and its derivative by the ray.
struct PixelResidual {
  bool in_front = false;
  Eigen::Vector2d error_px = Eigen::Vector2d::Zero();
  Eigen::Matrix<double, 2, 3> jacobian = Eigen::Matrix<double, 2, 3>::Zero();
};

inline PixelResidual ResidualOf(const Eigen::Matrix3d& image_from_ray, const Eigen::Vector3d& ray) {
  const Eigen::Vector3d n = image_from_ray * ray;
  PixelResidual residual;
  if (!(n.z() > 0)) return residual;
  const double inverse = 1 / n.z();
  residual.in_front = true;
  residual.error_px = n.head<2>() * inverse;
  residual.jacobian =
      (image_from_ray.topRows<2>() - residual.error_px * image_from_ray.row(2)) * inverse;
  return residual;
}

// Return the densities of normal distributions by the squared distance from the mean.
inline double Normal1D(double squared, double variance) {
  return std::exp(-0.5 * squared / variance) / std::sqrt(2 * std::numbers::pi * variance);
}
inline double Normal2D(double squared, double variance) {
  return std::exp(-0.5 * squared / variance) / (2 * std::numbers::pi * variance);
}

// A first guess, at a given pose, of where on its ray each query keypoint lies, of which of its
// matches agree on that, and of the noise.

// Returns the likeliest noise of depths and unanchored points, compared with what the observations
// alone say at this pose, and the distances' distribution.
JointNoise InitializeNoise(const KeypointEvidence& evidence, const CamFromLocal& pose,
                           double keypoint_variance_px2);

// The unknowns of the joint refinement, and how they explain the evidence: each observation, each
// unanchored point and the query's frame as a quadratic in the unknowns of its keypoint and of its
// frame.

using Matrix7d = Eigen::Matrix<double, 7, 7>;

// Returns the derivative (-[point]x, 1) of a point's displacement by a frame's unknowns: a rotation
// about the local origin, and a translation. (They are common to all frames of a point, so that one
// matrix serves them all.)
Eigen::Matrix<double, 3, 6> DisplacementJacobian(const Eigen::Vector3d& point);

// Evidence with less weight is left out.
inline constexpr double kLeastWeight = 1e-3;

// A reference's error: points seem displaced to it by rotation_vector x point + translation, and
// its depths have a scale.
struct ReferenceError {
  Eigen::Vector3d rotation_vector = Eigen::Vector3d::Zero();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
  double log_scale = 0;

  Eigen::Vector3d Displaced(const Eigen::Vector3d& point) const {
    return point + rotation_vector.cross(point) + translation;
  }
};

// A quadratic in a point's displacement and the logarithm of its depths' common scale.
struct Quadratic {
  Eigen::Matrix4d hessian = Eigen::Matrix4d::Zero();
  Eigen::Vector4d gradient = Eigen::Vector4d::Zero();

  void Add(const Quadratic& other) {
    hessian += other.hessian;
    gradient += other.gradient;
  }
};

// The evidence in blocks of eight keypoints, those with as many pieces together, and the unknowns
// that belong to keypoints (kernels/joint.h).
class EvidenceBlocks {
 public:
  // A keypoint's lane in its block.
  struct Lane {
    size_t block;
    size_t lane;
  };

  explicit EvidenceBlocks(const KeypointEvidence& evidence);
  Lane LaneOf(size_t keypoint) const {
    return {places_[keypoint] / kernels::kLanes<double>,
            places_[keypoint] % kernels::kLanes<double>};
  }
  Eigen::Vector3d PointOf(size_t keypoint) const {
    const auto [block, lane] = LaneOf(keypoint);
    const auto& point = keypoints_[block].point;
    return {point[0][lane], point[1][lane], point[2][lane]};
  }
  const kernels::JointKeypoints& BlockAt(size_t block) const { return keypoints_[block]; }
  kernels::JointKeypoints& BlockAt(size_t block) { return keypoints_[block]; }
  // Return the slot of the n-th observation, or unanchored point, of a block's keypoints.
  const kernels::JointObservations& ObservationAt(size_t block, int n) const {
    return observations_[static_cast<size_t>(keypoints_[block].first_observation + n)];
  }
  kernels::JointObservations& ObservationAt(size_t block, int n) {
    return observations_[static_cast<size_t>(keypoints_[block].first_observation + n)];
  }
  const kernels::JointUnanchored& UnanchoredAt(size_t block, int n) const {
    return unanchored_[static_cast<size_t>(keypoints_[block].first_unanchored + n)];
  }
  const std::vector<kernels::JointObservations>& Observations() const { return observations_; }
  kernels::JointBlocks ForKernels() {
    return {keypoints_.data(), static_cast<int>(keypoints_.size()), observations_.data(),
            unanchored_.data()};
  }

 private:
  void Append(const KeypointEvidence& evidence, size_t keypoint);

  std::vector<size_t> places_;  // block x 8 + lane, of each keypoint
  std::vector<kernels::JointKeypoints> keypoints_;
  std::vector<kernels::JointObservations> observations_;
  std::vector<kernels::JointUnanchored> unanchored_;
};

struct JointModel {
  const KeypointEvidence& evidence;
  CamFromLocal pose;
  JointNoise noise;
  EvidenceBlocks blocks;
  // The share by which the query's focal length is longer than the given one.
  double focal_error = 0;
  std::vector<ReferenceError> references;  // the last one is the unanchored points'
  bool have_references_errors = false;
  // The factor, at least 1, by which wrong matches with each reference are denser near epipolar
  // lines than anywhere in the image: those with the next window of a row lie near them.
  std::vector<double> epipolar_clutter;
  // The log likelihood of all matches, each as the others predict it, is over that of uniform ones;
  // EStep() sets it.
  double log_likelihood = 0;

  JointModel(const KeypointEvidence& of, const CamFromLocal& start)
      : evidence(of), pose(start), blocks(of), references(of.centers.size()) {}

  size_t UnanchoredFrame() const { return evidence.num_references(); }
  // Returns the parameters of the kernels, and writes the references' errors to the slots.
  kernels::JointParameters ForKernels();
};

// Finds on each keypoint's ray, at the model's pose, the point that most of its evidence agrees on,
// and how likely each piece is right there.
void InitializeByVoting(JointModel& model);

// The E step: how likely each piece of evidence is right, and how noisy its kind is.

// A variance that is known before, as if `count` errors had shown it.
struct VariancePrior {
  double variance = 0;
  double count = 0;
};

// The prior of the noise, before the query's own evidence.
struct NoisePrior {
  VariancePrior keypoint_px2, depth, common_depth;
  std::optional<TailPrior> keypoint_tail;
  // These are the priors of references' errors (JointNoise::reference_scale and so on). References
  // have unknowns from the beginning where one of them is known.
  VariancePrior reference_scale, reference_rotation, reference_center;

  bool KnowsReferences() const {
    return reference_scale.count > 0 || reference_rotation.count > 0 || reference_center.count > 0;
  }
  bool KnowsAllOfReferences() const {
    return reference_scale.count > 0 && reference_rotation.count > 0 && reference_center.count > 0;
  }
};

// Returns the squared error along the axis that is best predicted, over its variance. The
// covariance has a positive determinant, however little is known along its other axis.
double SquaredAcross(const Eigen::Vector2d& error, const Eigen::Matrix2d& covariance);

// Sets the model's weights by what all other evidence predicts (they go `share` of the way from
// what they were, so that what contradicts each other comes to rest), and its noise by what the
// residuals show; the points must be the likeliest ones for the model as it is. `query_covariance`
// is that of the query's unknowns. A match is judged by the others' prediction, never by its own:
// where little is known of the pose, any wrong match on an epipolar line would pull the pose to
// itself and confirm itself.
void EStep(const NoisePrior& prior, double share, const Matrix7d& query_covariance,
           JointModel& model);

}  // namespace raylift
