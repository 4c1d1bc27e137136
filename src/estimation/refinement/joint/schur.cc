#include "estimation/refinement/joint/schur.h"

#include <algorithm>
#include <cmath>

#include "estimation/kernels/kernel_table.h"
#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>

#include "raylift/geometry/rigid3.h"

namespace raylift {
namespace {

using Eigen::Matrix4d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::Vector4d;
using Eigen::VectorXd;

// Adds D' m D.
template <typename Block>
void AddDisplacedHessian(const Matrix4d& m, const Vector3d& point, Block&& block) {
  // The columns of m displaced, then the rows of that.
  Eigen::Matrix<double, 3, 4> turned;
  for (int column = 0; column < 4; ++column) {
    turned.col(column) = point.cross(m.block<3, 1>(0, column));
  }
  for (int row = 0; row < 3; ++row) {
    const Vector3d across = turned.block<1, 3>(row, 0);
    block.template block<1, 3>(row, 0) += point.cross(across).transpose();
    const Vector3d below = m.block<1, 3>(row, 0);
    block.template block<1, 3>(row + 3, 0) += point.cross(below).transpose();
  }
  const Vector3d last = m.block<1, 3>(3, 0);
  block.template block<1, 3>(6, 0) += point.cross(last).transpose();
  block.template block<3, 4>(0, 3) += turned;
  block.template block<4, 4>(3, 3) += m;
}

// Adds D' v.
template <typename Segment>
void AddDisplacedGradient(const Vector4d& v, const Vector3d& point, Segment&& segment) {
  segment.template head<3>() += point.cross(v.head<3>());
  segment.template tail<4>() += v;
}

// Return a keypoint's symmetric matrix, and its vector, of a block.
Matrix4d MatrixAt(const kernels::Row* rows, size_t lane) {
  Matrix4d matrix;
  for (int row = 0, i = 0; row < 4; ++row) {
    for (int column = row; column < 4; ++column, ++i) {
      matrix(row, column) = matrix(column, row) = rows[i][lane];
    }
  }
  return matrix;
}
template <int N>
Eigen::Matrix<double, N, 1> VectorAt(const kernels::Row* rows, size_t lane) {
  Eigen::Matrix<double, N, 1> vector;
  for (int i = 0; i < N; ++i) vector[i] = rows[i][lane];
  return vector;
}

// Returns the cost of an observation in its keypoint's unknowns, as of the last linearization.
Quadratic CostAt(const kernels::JointObservations& slot, size_t lane) {
  Quadratic cost;
  const double weight = slot.pixel_weight[lane];
  if (weight == 0) return cost;
  for (int row = 0; row < 2; ++row) {
    const Vector3d by_point = VectorAt<3>(slot.jacobian + 3 * row, lane);
    cost.hessian.topLeftCorner<3, 3>() += weight * by_point * by_point.transpose();
    cost.gradient.head<3>() += weight * slot.error_px[row][lane] * by_point;
  }
  Vector4d by_point;
  by_point << VectorAt<3>(slot.log_gradient, lane), -1;
  const Vector4d weighted = slot.depth_weight[lane] * by_point;
  cost.hessian += weighted * by_point.transpose();
  cost.gradient += slot.depth_error[lane] * weighted;
  return cost;
}

// Returns the cost of a keypoint's unanchored points.
Quadratic UnanchoredCost(const JointModel& model, size_t keypoint) {
  Quadratic cost;
  const auto [block, lane] = model.blocks.LaneOf(keypoint);
  const Vector3d displaced =
      model.references[model.UnanchoredFrame()].Displaced(model.blocks.PointOf(keypoint));
  int n = 0;
  for (const UnanchoredPoint& unanchored :
       model.evidence.UnanchoredOf(model.evidence.keypoints[keypoint])) {
    const double weight = model.blocks.UnanchoredAt(block, n++).weight[lane];
    if (weight < kLeastWeight) continue;
    const double information = weight / (model.noise.unanchored + unanchored.variance);
    cost.hessian.diagonal().head<3>().array() += information;
    cost.gradient.head<3>() += information * (displaced - unanchored.point);
  }
  return cost;
}

// Returns whether any evidence tells of a keypoint's point, as of the last linearization.
bool IsUsed(const kernels::JointKeypoints& block, size_t lane) {
  return block.covariance[0][lane] > 0;
}

}  // namespace

Matrix6d CamStepFromOwn(const CamFromLocal& pose) {
  Matrix6d step = Matrix6d::Zero();
  step.topLeftCorner<3, 3>() = pose.rotation;
  step.bottomRightCorner<3, 3>() = pose.rotation;
  step.bottomLeftCorner<3, 3>() = Skew(pose.translation) * pose.rotation;
  return step;
}

void JointSystem::CollectTerms(const JointModel& model, size_t keypoint,
                               std::vector<FrameTerm>& terms) const {
  terms.clear();
  const auto add = [&terms](int column, const Quadratic& cost) {
    const auto same = std::find_if(terms.begin(), terms.end(),
                                   [&](const FrameTerm& term) { return term.column == column; });
    if (same == terms.end()) {
      terms.push_back({column, cost});
    } else {
      same->cost.Add(cost);
    }
  };
  const auto [block, lane] = model.blocks.LaneOf(keypoint);
  if (!IsUsed(model.blocks.BlockAt(block), lane)) return;
  int n = 0;
  for (const Observation& observation : evidence_.ObservationsOf(evidence_.keypoints[keypoint])) {
    const kernels::JointObservations& slot = model.blocks.ObservationAt(block, n++);
    const int column = column_[static_cast<size_t>(observation.reference)];
    if (column >= 0 && slot.pixel_weight[lane] > 0) add(column, CostAt(slot, lane));
  }
  const int column = column_[model.UnanchoredFrame()];
  if (column >= 0 && !evidence_.UnanchoredOf(evidence_.keypoints[keypoint]).empty()) {
    add(column, UnanchoredCost(model, keypoint));
  }
}

void JointSystem::AddReferenceTerms(const JointModel& model, FocalLength focal_length,
                                    size_t keypoint, const std::vector<FrameTerm>& terms,
                                    FocalEquations& equations) {
  const auto [index, lane] = model.blocks.LaneOf(keypoint);
  const kernels::JointKeypoints& block = model.blocks.BlockAt(index);
  const Vector3d point = model.blocks.PointOf(keypoint);
  const Matrix4d covariance = MatrixAt(block.covariance, lane);
  const Matrix4d query = MatrixAt(block.query_hessian, lane);
  const Vector4d solved_gradient = covariance * VectorAt<4>(block.gradient, lane);
  const Vector4d solved_focal = covariance.leftCols<3>() * VectorAt<3>(block.by_focal, lane);
  for (const FrameTerm& frame : terms) {
    AddDisplacedGradient(frame.cost.gradient - frame.cost.hessian * solved_gradient, point,
                         equations.gradient.segment<7>(frame.column));
    if (focal_length == FocalLength::kUnknown) {
      AddDisplacedGradient(-frame.cost.hessian * solved_focal, point,
                           equations.mixed.segment<7>(frame.column));
    }
    const Matrix4d solved = frame.cost.hessian * covariance;
    AddDisplacedHessian(-solved.leftCols<3>() * query.topRows<3>(), point,
                        hessian_.block<7, 7>(frame.column, 0));
    for (const FrameTerm& other : terms) {
      if (other.column > frame.column) continue;
      Matrix4d shared = -solved * other.cost.hessian;
      if (other.column == frame.column) shared += frame.cost.hessian;
      AddDisplacedHessian(shared, point, hessian_.block<7, 7>(frame.column, other.column));
    }
  }
}

MatrixXd JointSystem::CellGradients(const JointModel& model) const {
  MatrixXd gradients = MatrixXd::Zero(num_columns_, evidence_.num_image_cells);
  std::vector<FrameTerm> terms;
  for (size_t k = 0; k < evidence_.keypoints.size(); ++k) {
    const auto [index, lane] = model.blocks.LaneOf(k);
    const kernels::JointKeypoints& block = model.blocks.BlockAt(index);
    auto gradient = gradients.col(evidence_.keypoints[k].image_cell);
    gradient.head<7>() += VectorAt<7>(block.pose_gradient, lane);
    if (!HasReferences()) continue;
    const Vector4d solved = MatrixAt(block.covariance, lane) * VectorAt<4>(block.gradient, lane);
    CollectTerms(model, k, terms);
    for (const FrameTerm& frame : terms) {
      AddDisplacedGradient(frame.cost.gradient - frame.cost.hessian * solved,
                           model.blocks.PointOf(k), gradient.segment<7>(frame.column));
    }
  }
  return gradients;
}

VectorXd JointSystem::Linearize(const NormalizedPriors& pose_priors, JointModel& model) {
  return LinearizeKeypoints(pose_priors, FocalLength::kKnown, model).gradient;
}

FocalEquations JointSystem::LinearizeWithFocal(const NormalizedPriors& pose_priors,
                                               JointModel& model) {
  return LinearizeKeypoints(pose_priors, FocalLength::kUnknown, model);
}

FocalEquations JointSystem::LinearizeKeypoints(const NormalizedPriors& pose_priors,
                                               FocalLength focal_length, JointModel& model) {
  kernels::JointParameters parameters = model.ForKernels();
  parameters.is_focal_unknown = focal_length == FocalLength::kUnknown;
  const kernels::JointNormals normals =
      kernels::ActiveKernels().linearize_jointly(model.blocks.ForKernels(), parameters);
  FocalEquations equations;
  equations.slope = normals.slope;
  equations.curvature = normals.curvature;
  equations.mixed = VectorXd::Zero(num_columns_);
  equations.gradient = VectorXd::Zero(num_columns_);
  equations.mixed.head<kQueryColumns>() = Eigen::Map<const Vector7d>(normals.mixed);
  hessian_.setZero(num_columns_, num_columns_);
  for (int row = 0, i = 0; row < kQueryColumns; ++row) {
    for (int column = row; column < kQueryColumns; ++column, ++i) {
      hessian_(column, row) = normals.hessian[i];
    }
  }
  if (HasReferences()) {
    std::vector<FrameTerm> terms;
    for (size_t k = 0; k < evidence_.keypoints.size(); ++k) {
      CollectTerms(model, k, terms);
      if (!terms.empty()) AddReferenceTerms(model, focal_length, k, terms, equations);
    }
  }
  equations.gradient.head<kQueryColumns>() = Eigen::Map<const Vector7d>(normals.gradient);
  if (!pose_priors.empty()) AddPosePriors(model, pose_priors, equations.gradient);
  if (HasReferences()) AddReferencePriors(model, equations.gradient);
  hessian_ = MatrixXd(hessian_.selfadjointView<Eigen::Lower>());
  equations.hessian = hessian_;
  return equations;
}

void JointSystem::MoveReferences(const VectorXd& step, JointModel& model) const {
  for (size_t r = 0; r < column_.size(); ++r) {
    if (column_[r] < 0) continue;
    model.references[r].rotation_vector += step.segment<3>(column_[r]);
    model.references[r].translation += step.segment<3>(column_[r] + 3);
    model.references[r].log_scale += step[column_[r] + 6];
  }
}

void JointSystem::MovePoints(const VectorXd& step, double focal_step, JointModel& model) const {
  kernels::JointParameters parameters = model.ForKernels();
  parameters.is_focal_unknown = focal_step != 0;
  if (HasReferences()) TakeReferenceSteps(step, model, parameters);
  kernels::ActiveKernels().move_jointly(model.blocks.ForKernels(), parameters, step.data(),
                                        focal_step);
}

void JointSystem::TakeReferenceSteps(const VectorXd& step, JointModel& model,
                                     kernels::JointParameters& parameters) const {
  const auto step_of = [&](size_t frame) {
    return column_[frame] < 0 ? Vector7d(Vector7d::Zero())
                              : Vector7d(step.segment<7>(column_[frame]));
  };
  std::vector<Vector7d> steps;
  for (size_t frame = 0; frame < column_.size(); ++frame) steps.push_back(step_of(frame));
  Eigen::Map<Eigen::Matrix<double, 6, 1>>(parameters.unanchored_step) = steps.back().head<6>();
  for (size_t k = 0; k < evidence_.keypoints.size(); ++k) {
    const auto [block, lane] = model.blocks.LaneOf(k);
    int n = 0;
    for (const Observation& observation : evidence_.ObservationsOf(evidence_.keypoints[k])) {
      const Vector7d& of_reference = steps[static_cast<size_t>(observation.reference)];
      auto& rows = model.blocks.ObservationAt(block, n++).reference_step;
      for (int i = 0; i < 7; ++i) rows[i][lane] = of_reference[i];
    }
  }
}

void JointSystem::AddPosePriors(const JointModel& model, const NormalizedPriors& pose_priors,
                                VectorXd& gradient) {
  NormalEquations of_cam;
  pose_priors.AddTo(model.pose, 1, of_cam);
  const Matrix6d to_cam = CamStepFromOwn(model.pose);
  gradient.head<6>() += to_cam.transpose() * of_cam.gradient;
  // The pixels' part of the Hessian is their information over StudentInformation(), and so is this.
  hessian_.topLeftCorner<6, 6>() +=
      to_cam.transpose() * of_cam.hessian * to_cam / StudentInformation(model.noise.keypoint_tail);
}

bool JointSystem::ReferencesDisagree(const JointModel& model) const {
  std::vector<Matrix7d> information(column_.size(), Matrix7d::Zero());
  std::vector<Vector7d> score(column_.size(), Vector7d::Zero());
  std::vector<int> residuals(column_.size(), 0);
  for (size_t k = 0; k < evidence_.keypoints.size(); ++k) {
    const auto [block, lane] = model.blocks.LaneOf(k);
    if (!IsUsed(model.blocks.BlockAt(block), lane)) continue;
    const Matrix4d covariance = MatrixAt(model.blocks.BlockAt(block).covariance, lane);
    const Vector3d point = model.blocks.PointOf(k);
    const auto add = [&](size_t frame, const Quadratic& cost) {
      const Matrix4d reduced = cost.hessian - cost.hessian * covariance * cost.hessian;
      AddDisplacedHessian(reduced, point, information[frame]);
      AddDisplacedGradient(cost.gradient, point, score[frame]);
      residuals[frame] += 3;
    };
    int n = 0;
    for (const Observation& observation : evidence_.ObservationsOf(evidence_.keypoints[k])) {
      const kernels::JointObservations& slot = model.blocks.ObservationAt(block, n++);
      if (slot.weight[lane] < 0.5 || !(slot.pixel_weight[lane] > 0)) continue;
      add(static_cast<size_t>(observation.reference), CostAt(slot, lane));
    }
    if (!evidence_.UnanchoredOf(evidence_.keypoints[k]).empty()) {
      add(model.UnanchoredFrame(), UnanchoredCost(model, k));
    }
  }
  double statistic = 0;
  int degrees = 0;
  for (size_t r = 0; r < column_.size(); ++r) {
    const double trace = information[r].trace();
    if (!(trace > 0)) continue;
    information[r].diagonal().array() += 1e-9 * trace;
    statistic += score[r].dot(information[r].ldlt().solve(score[r]));
    degrees += std::min(residuals[r], r == model.UnanchoredFrame() ? 6 : 7);
  }
  // Gradients have the pixels' expected information, not their mean precision (depths' are normal).
  statistic /= StudentInformation(model.noise.keypoint_tail);
  // One case in a thousand, by the normal approximation.
  return degrees > 0 && statistic > degrees + 3.1 * std::sqrt(2.0 * degrees);
}

void JointSystem::AdmitReferenceErrors(UnknownErrors unknown, JointModel& model) {
  if (!HasReferences()) AddReferenceColumns(model);
  model.have_references_errors = HasReferences();
  const double unknown_share = unknown == UnknownErrors::kNone ? 0 : 0.25;
  const double angle2 = AngleVariance(model.noise);
  const auto begin = [](const VariancePrior& known, double otherwise) {
    return known.count > 0 ? known.variance : otherwise;
  };
  JointNoise& noise = model.noise;
  noise.reference_rotation = begin(prior_.reference_rotation, unknown_share * angle2);
  noise.reference_center = begin(prior_.reference_center,
                                 unknown_share * angle2 * std::exp(2 * noise.log_distance_mean));
  noise.reference_scale =
      begin(prior_.reference_scale,
            unknown == UnknownErrors::kNone ? 0 : noise.depth + noise.common_depth);
}

void JointSystem::AddReferenceColumns(const JointModel& model) {
  std::vector<double> support(column_.size(), 0);
  for (size_t k = 0; k < evidence_.keypoints.size(); ++k) {
    const auto [block, lane] = model.blocks.LaneOf(k);
    const KeypointObservations& keypoint = evidence_.keypoints[k];
    for (int i = keypoint.first_observation; i < keypoint.end_observation; ++i) {
      support[static_cast<size_t>(evidence_.observations[i].reference)] +=
          model.blocks.ObservationAt(block, i - keypoint.first_observation).weight[lane];
    }
    for (int i = keypoint.first_unanchored; i < keypoint.end_unanchored; ++i) {
      support[model.UnanchoredFrame()] +=
          model.blocks.UnanchoredAt(block, i - keypoint.first_unanchored).weight[lane];
    }
  }
  for (size_t r = 0; r < column_.size(); ++r) {
    if (support[r] < 1) continue;
    column_[r] = num_columns_;
    num_columns_ += 7;
  }
}

void JointSystem::AddReferencePriors(const JointModel& model, VectorXd& gradient) {
  const JointNoise& noise = model.noise;
  // The variance of an error that is not estimated is as good as 0.
  const double none2 = 1e-6 * AngleVariance(noise);
  // The information of a known variance is over StudentInformation(), as that of the pose's priors
  // is; an estimated variance is of this Hessian.
  const auto information_of = [&](const VariancePrior& known, double variance, double none) {
    const double unit = known.count > 0 ? StudentInformation(noise.keypoint_tail) : 1;
    return 1 / (std::max(variance, none) * unit);
  };
  const double rotation =
      information_of(prior_.reference_rotation, noise.reference_rotation, none2);
  const double center = information_of(prior_.reference_center, noise.reference_center,
                                       none2 * std::exp(2 * noise.log_distance_mean));
  const double scale = information_of(prior_.reference_scale, noise.reference_scale, none2);
  for (size_t r = 0; r < column_.size(); ++r) {
    if (column_[r] < 0) continue;
    // The center c is displaced by w x c + t.
    Matrix7d to_prior = Matrix7d::Identity();
    to_prior.block<3, 6>(3, 0) = DisplacementJacobian(evidence_.centers[r]);
    const ReferenceError& error = model.references[r];
    Vector7d value, information;
    value << error.rotation_vector, error.Displaced(evidence_.centers[r]) - evidence_.centers[r],
        error.log_scale;
    information << Vector3d::Constant(rotation), Vector3d::Constant(center), scale;
    hessian_.block<7, 7>(column_[r], column_[r]) +=
        to_prior.transpose() * information.asDiagonal() * to_prior;
    gradient.segment<7>(column_[r]) += to_prior.transpose() * information.cwiseProduct(value);
  }
}

void JointSystem::UpdateReferenceVariances(const MatrixXd& covariance, JointModel& model) const {
  struct Sum {
    double squares = 0, count = 0;
    // Estimates the variance; without a prior it is as if one more reference had shown `otherwise`.
    void Update(const VariancePrior& known, double otherwise, double& variance) const {
      if (variance == 0) return;  // not looked for
      const VariancePrior before = known.count > 0 ? known : VariancePrior{otherwise, 1};
      variance = std::max(
          (squares + before.count * before.variance) / (std::max(count, 0.0) + before.count),
          1e-14);
    }
  };
  JointNoise& noise = model.noise;
  const auto explained = [](double variance_left, double variance) {
    return variance > 0 ? variance_left / variance : 0;
  };
  Sum rotation, center, factor;
  for (size_t r = 0; r < column_.size(); ++r) {
    if (column_[r] < 0) continue;
    const ReferenceError& error = model.references[r];
    const Eigen::Matrix<double, 3, 6> at_center = DisplacementJacobian(evidence_.centers[r]);
    const Matrix6d pose = covariance.block<6, 6>(column_[r], column_[r]);
    rotation.squares += error.rotation_vector.squaredNorm();
    rotation.count += 3 - explained(pose.topLeftCorner<3, 3>().trace(), noise.reference_rotation);
    center.squares += (error.Displaced(evidence_.centers[r]) - evidence_.centers[r]).squaredNorm();
    center.count +=
        3 - explained((at_center * pose * at_center.transpose()).trace(), noise.reference_center);
    factor.squares += error.log_scale * error.log_scale;
    factor.count +=
        1 - explained(covariance(column_[r] + 6, column_[r] + 6), noise.reference_scale);
  }
  // Without a prior: errors of a tenth of a keypoint's direction, and of a depth.
  const double angle2 = 0.01 * AngleVariance(noise);
  rotation.Update(prior_.reference_rotation, angle2, noise.reference_rotation);
  center.Update(prior_.reference_center, angle2 * std::exp(2 * noise.log_distance_mean),
                noise.reference_center);
  factor.Update(prior_.reference_scale, noise.depth + noise.common_depth, noise.reference_scale);
}

double JointSystem::AngleVariance(const JointNoise& noise) const {
  return noise.keypoint_px2 / (evidence_.focal_px * evidence_.focal_px);
}

}  // namespace raylift
