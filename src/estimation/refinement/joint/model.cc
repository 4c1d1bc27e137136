#include "estimation/refinement/joint/model.h"

#include <cmath>

namespace raylift {

Eigen::Matrix<double, 3, 6> DisplacementJacobian(const Eigen::Vector3d& point) {
  Eigen::Matrix<double, 3, 6> jacobian;
  jacobian << -Skew(point), Eigen::Matrix3d::Identity();
  return jacobian;
}

using Eigen::Matrix4d;
using Eigen::Vector3d;
using Eigen::Vector4d;

Matrix4d DisplacementCovariance(const Matrix7d& frame_covariance, const Vector3d& point) {
  // D Q, then its product with D'.
  Matrix47d half;
  for (int column = 0; column < 7; ++column) {
    const Vector3d rotation = frame_covariance.block<3, 1>(0, column);
    half.block<3, 1>(0, column) = rotation.cross(point) + frame_covariance.block<3, 1>(3, column);
    half(3, column) = frame_covariance(6, column);
  }
  Matrix4d covariance;
  for (int row = 0; row < 4; ++row) {
    const Vector3d rotation = half.block<1, 3>(row, 0);
    covariance.block<1, 3>(row, 0) = rotation.cross(point).transpose() + half.block<1, 3>(row, 3);
    covariance(row, 3) = half(row, 6);
  }
  return covariance;
}

void Quadratic::AddPixel(const Eigen::Matrix<double, 2, 3>& jacobian, const Eigen::Vector2d& error,
                         double weight) {
  const Eigen::Matrix<double, 3, 2> weighted = weight * jacobian.transpose();
  hessian.topLeftCorner<3, 3>() += weighted.lazyProduct(jacobian);
  gradient.head<3>() += weighted.lazyProduct(error);
}

void Quadratic::AddLogDistance(const Vector3d& log_gradient, double error, double weight) {
  Vector4d direction;
  direction << log_gradient, -1;
  const Vector4d weighted = weight * direction;
  hessian += weighted.lazyProduct(direction.transpose());
  gradient += error * weighted;
}

void ObservationTerm::AddTo(Quadratic& cost) const {
  cost.AddPixel(seen.jacobian, seen.error_px, weight);
  if (depth_weight > 0) cost.AddLogDistance(log_gradient, depth_error, depth_weight);
}

Quadratic ObservationTerm::Cost() const {
  Quadratic cost;
  AddTo(cost);
  return cost;
}

Quadratic QueryTerm::Cost() const {
  Quadratic cost;
  cost.AddPixel(jacobian, seen.error_px, weight);
  cost.AddLogDistance(log_gradient, distance_error, prior_information);
  return cost;
}

QueryTerm JointModel::QueryTermOf(size_t keypoint) const {
  const KeypointObservations& parts = evidence.keypoints[keypoint];
  const KeypointState& state = keypoints[keypoint];
  QueryTerm term;
  term.seen = ResidualOf(parts.image_from_cam, parts.PointInCamera(pose, state.point));
  if (!term.seen.in_front) return term;
  term.seen.error_px += focal_error * parts.px_by_log_focal;
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
  if (keypoint.end_unanchored == keypoint.first_unanchored) return q;
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

Quadratic JointModel::CostWithoutObservations(const KeypointObservations& keypoint,
                                              const KeypointState& state,
                                              const Quadratic& query_cost,
                                              const Quadratic& unanchored) const {
  Quadratic cost = query_cost;
  cost.hessian.row(3).setZero();
  cost.hessian.col(3).setZero();
  cost.hessian(3, 3) = 1 / noise.common_depth;
  cost.gradient[3] = state.common / noise.common_depth;
  if (keypoint.end_unanchored > keypoint.first_unanchored) cost.Add(unanchored);
  return cost;
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
