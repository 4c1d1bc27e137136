#include "estimation/joint_model.h"

#include <cmath>

namespace raylift {

Eigen::Matrix<double, 3, 6> DisplacementJacobian(const Eigen::Vector3d& point) {
  Eigen::Matrix<double, 3, 6> jacobian;
  jacobian << -Skew(point), Eigen::Matrix3d::Identity();
  return jacobian;
}

using Eigen::Vector3d;
using Eigen::Vector4d;

Quadratic SightingTerm::Cost() const {
  Quadratic q;
  q.hessian.topLeftCorner<3, 3>().noalias() = weight * seen.jacobian.transpose() * seen.jacobian;
  q.gradient.head<3>().noalias() = weight * seen.jacobian.transpose() * seen.error_px;
  if (depth_weight > 0) {
    Vector4d d;
    d << log_gradient, -1;
    q.hessian.noalias() += depth_weight * d * d.transpose();
    q.gradient += depth_weight * depth_error * d;
  }
  return q;
}

Quadratic QueryTerm::Cost() const {
  Quadratic q;
  Vector4d d;
  d << log_gradient, -1;
  q.hessian.noalias() = prior_information * d * d.transpose();
  q.gradient = prior_information * distance_error * d;
  q.hessian.topLeftCorner<3, 3>().noalias() += weight * jacobian.transpose() * jacobian;
  q.gradient.head<3>().noalias() += weight * jacobian.transpose() * seen.error_px;
  return q;
}

QueryTerm JointModel::LookFromQuery(size_t keypoint) const {
  const KeypointParts& parts = evidence.keypoints[keypoint];
  const KeypointState& state = keypoints[keypoint];
  QueryTerm term;
  term.seen = ResidualOf(parts.image_from_cam, parts.PointInCamera(pose, state.point));
  if (!term.seen.in_front) return term;
  term.weight = state.query_right * state.query_precision / noise.keypoint_px2;
  term.jacobian.noalias() = term.seen.jacobian * pose.rotation;
  const Vector3d offset = state.point - parts.CenterOfCamera(pose);
  const double squared = offset.squaredNorm();
  term.log_gradient = offset / squared;
  term.distance_error = 0.5 * std::log(squared) - noise.log_distance_mean;
  term.prior_information = 1 / noise.log_distance_variance;
  return term;
}

SightingTerm JointModel::LookFromReference(int i, const KeypointState& state) const {
  const Sighting& sighting = evidence.sightings[i];
  const ReferenceError& error = references[sighting.reference];
  SightingTerm term;
  const Vector3d offset = error.Displaced(state.point) - sighting.center;
  term.seen = ResidualOf(sighting.image_from_ray, offset);
  if (!term.seen.in_front) return term;
  term.pixel_variance = noise.keypoint_px2 + sighting.extra_variance_px2;
  const double weight = weights.sighting[i];
  if (weight >= kLeastWeight) term.weight = weight * weights.precision[i] / term.pixel_variance;
  if (sighting.has_depth) {
    const double squared = offset.squaredNorm();
    term.log_gradient = offset / squared;
    term.depth_variance = noise.depth + sighting.depth_variance;
    term.depth_error =
        0.5 * std::log(squared) - sighting.log_distance - state.common - error.log_factor;
    if (term.weight > 0 && weights.depth[i] >= kLeastWeight) {
      term.depth_weight = weight * weights.depth[i] / term.depth_variance;
    }
  }
  return term;
}

Quadratic JointModel::LooseCost(const KeypointParts& keypoint, const Vector3d& point) const {
  Quadratic q;
  const Vector3d displaced = references[LooseView()].Displaced(point);
  for (int i = keypoint.first_loose; i < keypoint.end_loose; ++i) {
    if (weights.loose[i] < kLeastWeight) continue;
    const LoosePoint& loose = evidence.loose[i];
    const double w = weights.loose[i] / (noise.loose + loose.variance);
    q.hessian.diagonal().head<3>().array() += w;
    q.gradient.head<3>() += w * (displaced - loose.point);
  }
  return q;
}

Quadratic JointModel::CommonPrior(const KeypointState& state) const {
  Quadratic q;
  q.hessian(3, 3) = 1 / noise.common_depth;
  q.gradient[3] = state.common / noise.common_depth;
  return q;
}

double JointModel::TotalWeight(const KeypointParts& keypoint) const {
  double total = 0;
  for (int i = keypoint.first_sighting; i < keypoint.end_sighting; ++i) {
    total += weights.sighting[i];
  }
  for (int i = keypoint.first_loose; i < keypoint.end_loose; ++i) total += weights.loose[i];
  return total;
}

}  // namespace raylift
