#include "estimation/refinement/joint/model.h"

#include <cmath>

namespace raylift {

Eigen::Matrix<double, 3, 6> DisplacementJacobian(const Eigen::Vector3d& point) {
  Eigen::Matrix<double, 3, 6> jacobian;
  jacobian << -Skew(point), Eigen::Matrix3d::Identity();
  return jacobian;
}

using Eigen::Vector3d;
using Eigen::Vector4d;

Quadratic ObservationTerm::Cost() const {
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

QueryTerm JointModel::QueryTermOf(size_t keypoint) const {
  const KeypointObservations& parts = evidence.keypoints[keypoint];
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

ObservationTerm JointModel::ObservationTermOf(int i, const KeypointState& state) const {
  const Observation& observation = evidence.observations[i];
  const ReferenceError& error = references[observation.reference];
  ObservationTerm term;
  const Vector3d offset = error.Displaced(state.point) - observation.center;
  term.seen = ResidualOf(observation.image_from_ray, offset);
  if (!term.seen.in_front) return term;
  term.pixel_variance = noise.keypoint_px2 + observation.extra_variance_px2;
  const double weight = weights.observation[i];
  if (weight >= kLeastWeight) term.weight = weight * weights.precision[i] / term.pixel_variance;
  if (observation.has_depth) {
    const double squared = offset.squaredNorm();
    term.log_gradient = offset / squared;
    term.depth_variance = noise.depth + observation.depth_variance;
    term.depth_error =
        0.5 * std::log(squared) - observation.log_distance - state.common - error.log_scale;
    if (term.weight > 0 && weights.depth[i] >= kLeastWeight) {
      term.depth_weight = weight * weights.depth[i] / term.depth_variance;
    }
  }
  return term;
}

Quadratic JointModel::UnanchoredCost(const KeypointObservations& keypoint,
                                     const Vector3d& point) const {
  Quadratic q;
  const Vector3d displaced = references[UnanchoredFrame()].Displaced(point);
  for (int i = keypoint.first_unanchored; i < keypoint.end_unanchored; ++i) {
    if (weights.unanchored[i] < kLeastWeight) continue;
    const UnanchoredPoint& unanchored = evidence.unanchored[i];
    const double w = weights.unanchored[i] / (noise.unanchored + unanchored.variance);
    q.hessian.diagonal().head<3>().array() += w;
    q.gradient.head<3>() += w * (displaced - unanchored.point);
  }
  return q;
}

Quadratic JointModel::CommonPrior(const KeypointState& state) const {
  Quadratic q;
  q.hessian(3, 3) = 1 / noise.common_depth;
  q.gradient[3] = state.common / noise.common_depth;
  return q;
}

double JointModel::TotalWeight(const KeypointObservations& keypoint) const {
  double total = 0;
  for (int i = keypoint.first_observation; i < keypoint.end_observation; ++i) {
    total += weights.observation[i];
  }
  for (int i = keypoint.first_unanchored; i < keypoint.end_unanchored; ++i)
    total += weights.unanchored[i];
  return total;
}

}  // namespace raylift
