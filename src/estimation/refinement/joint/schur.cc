#include "estimation/refinement/joint/schur.h"

#include <algorithm>
#include <cmath>

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
using Matrix43d = Eigen::Matrix<double, 4, 3>;

// D f: how a frame's unknowns displace a point.
Vector4d Displacement(const Vector7d& unknowns, const Vector3d& point) {
  Vector4d displacement;
  displacement << unknowns.head<3>().cross(point) + unknowns.segment<3>(3), unknowns[6];
  return displacement;
}

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

// Moves a point, but not beyond what the linearization tells.
void MovePoint(const Vector4d& move, const Vector3d& query_center, KeypointState& state) {
  const double limit = 0.5 * (state.point - query_center).norm();
  const double length = move.head<3>().norm();
  if (!std::isfinite(length + move[3])) return;
  const double share = length > limit ? limit / length : 1;
  state.point += share * move.head<3>();
  state.common += share * move[3];
}

}  // namespace

Matrix6d CamStepFromOwn(const CamFromLocal& pose) {
  Matrix6d step = Matrix6d::Zero();
  step.topLeftCorner<3, 3>() = pose.rotation;
  step.bottomRightCorner<3, 3>() = pose.rotation;
  step.bottomLeftCorner<3, 3>() = Skew(pose.translation) * pose.rotation;
  return step;
}

bool JointSystem::LinearizeKeypoint(const JointModel& model, size_t index) {
  const KeypointObservations& keypoint = evidence_.keypoints[index];
  const KeypointState& state = model.keypoints[index];
  SchurBlock& block = schur_blocks_[index];
  if (model.TotalWeight(keypoint) < kLeastWeight) return false;
  const QueryTerm query = model.QueryTermOf(index);
  if (!query.seen.in_front) return false;

  block.query = query.Cost();
  const Quadratic unanchored = model.UnanchoredCost(keypoint, state.point);
  Quadratic cost = model.CostWithoutObservations(keypoint, state, block.query, unanchored);
  block.references.clear();
  for (int i = keypoint.first_observation; i < keypoint.end_observation; ++i) {
    if (model.weights.observation[i] < kLeastWeight) continue;
    const ObservationTerm term = model.ObservationTermOf(i, state);
    if (term.weight == 0) continue;
    term.AddTo(cost);
    const int column = column_[evidence_.observations[i].reference];
    if (column >= 0) AddToReference(column, term.Cost(), block);
  }
  if (column_[model.UnanchoredFrame()] >= 0 &&
      keypoint.end_unanchored > keypoint.first_unanchored) {
    AddToReference(column_[model.UnanchoredFrame()], unanchored, block);
  }

  block.covariance = cost.hessian.inverse();
  block.gradient = cost.gradient;
  return block.covariance.allFinite();
}

void JointSystem::AddToReference(int column, const Quadratic& cost, SchurBlock& block) {
  for (FrameTerm& frame : block.references) {
    if (frame.column != column) continue;
    frame.cost.Add(cost);
    frame.coupling += cost.hessian;
    return;
  }
  block.references.push_back({column, cost, cost.hessian});
}

void JointSystem::AddEliminated(const JointModel& model, size_t index) {
  const SchurBlock& block = schur_blocks_[index];
  auto gradient = cell_gradients_.col(evidence_.keypoints[index].image_cell);
  const Vector3d& point = model.keypoints[index].point;
  const Vector4d solved_gradient = block.covariance * block.gradient;
  const auto query_coupling = block.query.hessian.leftCols<3>();  // transposed
  const Matrix43d query_solved = query_coupling * block.covariance.topLeftCorner<3, 3>();
  AddDisplacedGradient(block.query.gradient - query_coupling * solved_gradient.head<3>(), point,
                       gradient.segment<7>(0));
  AddDisplacedHessian(block.query.hessian - query_solved * query_coupling.transpose(), point,
                      query_hessian_);
  for (const FrameTerm& frame : block.references) {
    AddDisplacedGradient(frame.cost.gradient - frame.coupling.transpose() * solved_gradient, point,
                         gradient.segment<7>(frame.column));
    const Matrix4d solved = frame.coupling.transpose() * block.covariance;
    AddDisplacedHessian(-solved.leftCols<3>() * query_coupling.transpose(), point,
                        hessian_.block<7, 7>(frame.column, 0));
    for (const FrameTerm& other : block.references) {
      if (other.column > frame.column) continue;
      Matrix4d shared = -solved * other.coupling;
      if (other.column == frame.column) shared += frame.cost.hessian;
      AddDisplacedHessian(shared, point, hessian_.block<7, 7>(frame.column, other.column));
    }
  }
}

VectorXd JointSystem::Linearize(const JointModel& model, const NormalizedPriors& pose_priors) {
  hessian_.setZero(num_columns_, num_columns_);
  query_hessian_.setZero();
  cell_gradients_.setZero(num_columns_, evidence_.num_image_cells);
  for (size_t k = 0; k < schur_blocks_.size(); ++k) {
    schur_blocks_[k].used = LinearizeKeypoint(model, k);
    if (schur_blocks_[k].used) AddEliminated(model, k);
  }
  hessian_.topLeftCorner<kQueryColumns, kQueryColumns>() = query_hessian_;
  VectorXd gradient = cell_gradients_.rowwise().sum();
  if (!pose_priors.empty()) AddPosePriors(model, pose_priors, gradient);
  if (HasReferences()) AddReferencePriors(model, gradient);
  hessian_ = MatrixXd(hessian_.selfadjointView<Eigen::Lower>());
  return gradient;
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
  for (size_t k = 0; k < schur_blocks_.size(); ++k) {
    const SchurBlock& block = schur_blocks_[k];
    if (!block.used) continue;
    KeypointState& state = model.keypoints[k];
    Vector4d pull = block.gradient;
    if (focal_step != 0) pull += focal_step * block.by_focal;
    pull.head<3>() += block.query.hessian.topRows<3>() * Displacement(step.head<7>(), state.point);
    for (const FrameTerm& frame : block.references) {
      pull += frame.coupling * Displacement(step.segment<7>(frame.column), state.point);
    }
    MovePoint(-block.covariance * pull, evidence_.keypoints[k].CenterOfCamera(model.pose), state);
  }
}

void JointSystem::AddPosePriors(const JointModel& model, const NormalizedPriors& pose_priors,
                                VectorXd& gradient) {
  NormalEquations of_cam;
  pose_priors.AddTo(model.pose, 1, of_cam);
  const Matrix6d to_cam = CamStepFromOwn(model.pose);
  gradient.head<6>() += to_cam.transpose() * of_cam.gradient;
  // The pixels' cell of the Hessian is their information by that factor.
  hessian_.topLeftCorner<6, 6>() +=
      to_cam.transpose() * of_cam.hessian * to_cam / StudentInformation(model.noise.keypoint_tail);
}

bool JointSystem::ReferencesDisagree(const JointModel& model) const {
  std::vector<Matrix7d> information(column_.size(), Matrix7d::Zero());
  std::vector<Vector7d> score(column_.size(), Vector7d::Zero());
  std::vector<int> residuals(column_.size(), 0);
  for (size_t index = 0; index < schur_blocks_.size(); ++index) {
    const KeypointObservations& keypoint = evidence_.keypoints[index];
    if (!schur_blocks_[index].used) continue;
    const Matrix4d covariance = schur_blocks_[index].covariance;
    const Vector3d& point = model.keypoints[index].point;
    const auto add = [&](size_t frame, const Quadratic& cost) {
      const Matrix4d reduced = cost.hessian - cost.hessian * covariance * cost.hessian;
      AddDisplacedHessian(reduced, point, information[frame]);
      AddDisplacedGradient(cost.gradient, point, score[frame]);
      residuals[frame] += 3;
    };
    for (int i = keypoint.first_observation; i < keypoint.end_observation; ++i) {
      if (model.weights.observation[i] < 0.5) continue;
      const ObservationTerm term = model.ObservationTermOf(i, model.keypoints[index]);
      if (term.weight > 0) {
        add(static_cast<size_t>(evidence_.observations[i].reference), term.Cost());
      }
    }
    if (keypoint.end_unanchored > keypoint.first_unanchored) {
      add(model.UnanchoredFrame(), model.UnanchoredCost(keypoint, point));
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
  for (size_t i = 0; i < evidence_.observations.size(); ++i) {
    support[evidence_.observations[i].reference] += model.weights.observation[i];
  }
  for (const double weight : model.weights.unanchored) support[model.UnanchoredFrame()] += weight;
  for (size_t r = 0; r < column_.size(); ++r) {
    if (support[r] < 1) continue;
    column_[r] = num_columns_;
    num_columns_ += 7;
  }
}

void JointSystem::AddReferencePriors(const JointModel& model, VectorXd& gradient) {
  const JointNoise& noise = model.noise;
  // An error that is not looked for is as good as none.
  const double none2 = 1e-6 * AngleVariance(noise);
  // A variance that is known is divided as those of the pose's priors are; one that is found is of
  // this Hessian.
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
    // The center c is displaced by turn x c + shift.
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
    // Where nothing is known, it is as if one more reference had shown `otherwise`.
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
  // Errors of a tenth of a keypoint's, or of a depth's.
  const double angle2 = 0.01 * AngleVariance(noise);
  rotation.Update(prior_.reference_rotation, angle2, noise.reference_rotation);
  center.Update(prior_.reference_center, angle2 * std::exp(2 * noise.log_distance_mean),
                noise.reference_center);
  factor.Update(prior_.reference_scale, noise.depth + noise.common_depth, noise.reference_scale);
}

double JointSystem::AngleVariance(const JointNoise& noise) const {
  return noise.keypoint_px2 / (evidence_.focal_px * evidence_.focal_px);
}

FocalEquations JointSystem::LinearizeWithFocal(const JointModel& model,
                                               const NormalizedPriors& pose_priors) {
  FocalEquations equations;
  equations.gradient = Linearize(model, pose_priors);
  equations.hessian = hessian_;
  equations.mixed = VectorXd::Zero(num_columns_);
  for (size_t k = 0; k < schur_blocks_.size(); ++k) {
    SchurBlock& block = schur_blocks_[k];
    if (!block.used) continue;
    const QueryTerm query = model.QueryTermOf(k);
    const Eigen::Vector2d& by_focal = evidence_.keypoints[k].px_by_log_focal;
    Vector4d& by_point = block.by_focal;
    by_point << query.weight * query.jacobian.transpose() * by_focal, 0;
    const Vector4d solved = block.covariance * by_point;
    equations.slope +=
        query.weight * by_focal.dot(query.seen.error_px) - solved.dot(block.gradient);
    equations.curvature += query.weight * by_focal.squaredNorm() - solved.dot(by_point);
    const auto add_mixed = [&](const Vector4d& mixed, int column) {
      AddDisplacedGradient(mixed, model.keypoints[k].point, equations.mixed.segment<7>(column));
    };
    add_mixed(by_point - block.query.hessian.leftCols<3>() * solved.head<3>(), 0);
    for (const FrameTerm& frame : block.references) {
      add_mixed(-frame.coupling.transpose() * solved, frame.column);
    }
  }
  return equations;
}

}  // namespace raylift
