#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "estimation/refinement/joint/model.h"
#include "estimation/refinement/refinement.h"
#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>

#include "raylift/geometry/rigid3.h"

namespace raylift {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix4d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::Vector4d;
using Eigen::VectorXd;
using Vector7d = Eigen::Matrix<double, 7, 1>;

constexpr int kMaxRounds = 10;
// After this round, where the pose has moved by more than the keypoints' noise, the keypoints'
// consensus is looked for again: at RANSAC's pose some found none, or a wrong one.
constexpr int kRoundOfReinitialization = 1;
// From this round on weights go a shrinking share of their way.
constexpr int kFirstDampedRound = 3;
// The squared lengths of steps, in standard deviations of the pose.
constexpr double kFarStep = 4;
constexpr double kSettledStep = 0.01;
// By how much the information's logarithm, of six and more unknowns, may still change.
constexpr double kSettledInformation = 0.3;
constexpr int kReferenceRounds = 3;

// From a turn about the local origin and a shift before the pose to (w, v) after it, in the camera's
// tangent frame.
Matrix6d CamStepFromOwn(const CamFromLocal& pose) {
  Matrix6d step = Matrix6d::Zero();
  step.topLeftCorner<3, 3>() = pose.rotation;
  step.bottomRightCorner<3, 3>() = pose.rotation;
  step.bottomLeftCorner<3, 3>() = Skew(pose.translation) * pose.rotation;
  return step;
}

// Whether a step of the query is one that the linearization can be believed for.
bool IsModest(const Eigen::Ref<const VectorXd>& step) {
  constexpr double kLargestRotation = 0.5;
  constexpr double kLargestFactor = 1;  // of the mean distance, as a logarithm
  return step.allFinite() && step.head<3>().norm() < kLargestRotation &&
         std::abs(step[6]) < kLargestFactor;
}

// One frame of a keypoint.
struct FrameTerm {
  int column;  // of its first unknown
  Quadratic cost;
  // d^2 cost / d (point, common error) d (displacement, factor), where the query has the mean
  // distance instead of a factor.
  Matrix4d coupling;

  // Of the point by the frame's unknowns.
  static Vector4d Displacement(const Eigen::Ref<const VectorXd>& unknowns, const Vector3d& point) {
    Vector4d displacement;
    displacement << unknowns.head<3>().cross(point) + unknowns.segment<3>(3), unknowns[6];
    return displacement;
  }
};

// Adds D' m D, where D gives a displacement and factor by the seven unknowns of a frame:
// D = (-cross, 1, 0; 0, 0, 1).
template <typename Block>
void AddDisplaced(const Matrix4d& m, const Matrix3d& cross, Block block) {
  const Matrix3d middle = m.topLeftCorner<3, 3>();
  const Matrix3d turned = cross.lazyProduct(middle);
  block.template topLeftCorner<3, 3>() -= turned.lazyProduct(cross);
  block.template block<3, 3>(0, 3) += turned;
  block.template block<3, 3>(3, 0) -= middle.lazyProduct(cross);
  block.template block<3, 3>(3, 3) += middle;
  const Vector3d column = m.topRightCorner<3, 1>();
  block.template block<3, 1>(0, 6) += cross * column;
  block.template block<3, 1>(3, 6) += column;
  const Vector3d row = m.bottomLeftCorner<1, 3>();
  block.template block<1, 3>(6, 0) += (cross * row).transpose();
  block.template block<1, 3>(6, 3) += row.transpose();
  block(6, 6) += m(3, 3);
}

// Adds D' v.
template <typename Segment>
void AddDisplaced(const Vector4d& v, const Matrix3d& cross, Segment segment) {
  segment.template head<3>() += cross * v.head<3>();
  segment.template segment<3>(3) += v.head<3>();
  segment[6] += v[3];
}

class JointRefinement {
 public:
  JointRefinement(const KeypointEvidence& evidence, const CamFromLocal& start,
                  double keypoint_variance_px2, const NoisePrior& prior,
                  const NormalizedPriors& pose_priors)
      : evidence_(evidence),
        prior_(prior),
        pose_priors_(pose_priors),
        model_(evidence, start),
        column_(evidence.centers.size(), -1),
        schur_blocks_(evidence.keypoints.size()) {
    InitializePoints(keypoint_variance_px2);
  }

  RefinedPose Run(FocalDerivatives focal) {
    double information = 0;
    for (int round = 0; round < kMaxRounds; ++round) {
      const std::optional<double> decrement = Step();
      if (decrement && *decrement > kFarStep) Step();
      const double share = round < kFirstDampedRound ? 1 : 1.0 / (round - kFirstDampedRound + 2);
      EStep(prior_, share, QueryCovariance(), model_);
      if (round == kRoundOfReinitialization && HasMovedFar()) {
        InitializePoints(model_.noise.keypoint_px2);
        continue;
      }
      const bool same = std::abs(log_information_ - information) < kSettledInformation;
      if (decrement && *decrement < kSettledStep && same) break;
      information = log_information_;
    }
    Step();
    if (ReferencesDisagree()) {
      AdmitReferenceErrors();
      for (int round = 0; round < kReferenceRounds; ++round) {
        Step();
        EStep(prior_, 1, QueryCovariance(), model_);
      }
      Step();
    }
    return {.pose = model_.pose,
            .covariance = Covariance(),
            .noise = model_.noise,
            .references_disagree = WithReferences(),
            .focal = focal == FocalDerivatives::kAtPose ? StepOfFocal() : std::nullopt};
  }

 private:
  // What is needed to move a keypoint's point after a step of the frames.
  struct SchurBlock {
    bool used = false;
    Matrix4d covariance;  // of the point and its common error, the frames held
    Vector4d gradient;
    std::vector<FrameTerm> frames;
  };

  static constexpr int kQueryColumns = 7;

  bool WithReferences() const { return num_columns_ > kQueryColumns; }

  // Finds each keypoint's consensus at the pose as it is.
  void InitializePoints(double keypoint_variance_px2);
  // Whether the keypoints are elsewhere than where their consensus was looked for.
  bool HasMovedFar() const;

  // Fills the normal equations of all unknowns but the points; their gradient.
  VectorXd Linearize();
  // One Gauss-Newton step of all unknowns; its squared length in standard deviations (Newton's
  // decrement), none where there is none to take.
  std::optional<double> Step();
  // What the frames of a keypoint ask of its point and of themselves; false where there is none.
  bool LinearizeKeypoint(size_t index);
  // Adds the keypoint's cell to the normal equations, its point eliminated. The lower triangle of
  // the Hessian is filled.
  void AddEliminated(size_t index);
  void MoveQuery(const Eigen::Ref<const VectorXd>& step);
  void MovePoint(const Vector4d& move, const Vector3d& query_center, KeypointState& state) const;

  // Whether the residuals of whole references have a direction, by the score test: chi-squared
  // with seven degrees of freedom each, if they are independent.
  bool ReferencesDisagree() const;
  void AdmitReferenceErrors();
  void AddPosePriors(VectorXd& gradient);
  void AddReferencePriors(VectorXd& gradient);
  void UpdateReferenceVariances(const MatrixXd& covariance);

  std::optional<FocalStep> StepOfFocal();
  // Of the query's unknowns, those of the references given; zero where there is none.
  Matrix7d QueryCovariance() const;
  std::optional<Matrix6d> Covariance() const;
  // Of the inverse Hessian's; the pixels' cell of the Hessian is their information over
  // StudentInformation().
  double VarianceFactor(const MatrixXd& pose_columns) const;
  // By how much the pose's covariance (the first columns of the inverse Hessian) understates how
  // far the cells of the image pull the pose apart, at least 1: errors that the model does not
  // know, of the lens for instance, are common to neighbors.
  double Inflation(const MatrixXd& pose_columns) const;

  const KeypointEvidence& evidence_;
  const NoisePrior& prior_;
  const NormalizedPriors& pose_priors_;
  JointModel model_;
  CamFromLocal initialized_at_;
  std::vector<int> column_;  // of each reference's first unknown; -1: it has none
  int num_columns_ = kQueryColumns;
  std::vector<SchurBlock> schur_blocks_;
  // Of the last step, the points eliminated.
  MatrixXd hessian_;
  double log_information_ = 0;  // of its determinant
  MatrixXd cell_gradients_;     // one column for each cell of the query's images
};

void JointRefinement::InitializePoints(double keypoint_variance_px2) {
  initialized_at_ = model_.pose;
  model_.noise = InitializeNoise(evidence_, model_.pose, keypoint_variance_px2);
  if (prior_.depth.count > 0) model_.noise.depth = prior_.depth.variance;
  if (prior_.common_depth.count > 0) model_.noise.common_depth = prior_.common_depth.variance;
  if (prior_.keypoint_tail) model_.noise.keypoint_tail = prior_.keypoint_tail->mean;
  InitializeByVoting(evidence_, model_.pose, model_.noise, model_.keypoints, model_.weights);
}

bool JointRefinement::HasMovedFar() const {
  double squares = 0;
  double count = 0;
  for (size_t k = 0; k < model_.keypoints.size(); ++k) {
    const KeypointObservations& keypoint = evidence_.keypoints[k];
    const auto seen_from = [&](const CamFromLocal& pose) {
      return ResidualOf(keypoint.image_from_cam,
                        keypoint.PointInCamera(pose, model_.keypoints[k].point));
    };
    const PixelResidual now = seen_from(model_.pose);
    const PixelResidual then = seen_from(initialized_at_);
    if (!now.in_front || !then.in_front) continue;
    // What is out of sight says no more than what has moved by ten deviations.
    squares +=
        std::min((now.error_px - then.error_px).squaredNorm(), 100 * model_.noise.keypoint_px2);
    count += 1;
  }
  return squares > count * model_.noise.keypoint_px2;
}

bool JointRefinement::LinearizeKeypoint(size_t index) {
  const KeypointObservations& keypoint = evidence_.keypoints[index];
  const KeypointState& state = model_.keypoints[index];
  SchurBlock& block = schur_blocks_[index];
  if (model_.TotalWeight(keypoint) < kLeastWeight) return false;
  const QueryTerm query = model_.QueryTermOf(index);
  if (!query.seen.in_front) return false;

  // The point and its common error; the prior's mean is the query's unknown, not theirs.
  Quadratic point = model_.CommonPrior(state);
  const Quadratic unanchored = model_.UnanchoredCost(keypoint, state.point);
  point.Add(unanchored);
  const Quadratic query_cost = query.Cost();
  point.hessian.topLeftCorner<3, 3>() += query_cost.hessian.topLeftCorner<3, 3>();
  point.gradient.head<3>() += query_cost.gradient.head<3>();

  // Each frame's cost; observations of one reference are one frame.
  std::vector<FrameTerm>& frames = block.frames;
  frames.clear();
  Matrix4d coupling = query_cost.hessian;
  coupling.row(3).setZero();
  frames.push_back({0, query_cost, coupling});
  for (int i = keypoint.first_observation; i < keypoint.end_observation; ++i) {
    if (model_.weights.observation[i] < kLeastWeight) continue;
    const ObservationTerm term = model_.ObservationTermOf(i, state);
    if (term.weight == 0) continue;
    const Quadratic cost = term.Cost();
    point.Add(cost);
    const int column = column_[evidence_.observations[i].reference];
    if (column < 0) continue;
    const auto same = std::find_if(frames.begin(), frames.end(),
                                   [&](const FrameTerm& frame) { return frame.column == column; });
    if (same == frames.end()) {
      frames.push_back({column, cost, cost.hessian});
    } else {
      same->cost.Add(cost);
      same->coupling += cost.hessian;
    }
  }
  if (column_[model_.UnanchoredFrame()] >= 0 &&
      keypoint.end_unanchored > keypoint.first_unanchored) {
    frames.push_back({column_[model_.UnanchoredFrame()], unanchored, unanchored.hessian});
  }

  block.covariance = point.hessian.inverse();
  block.gradient = point.gradient;
  return block.covariance.allFinite();
}

void JointRefinement::AddEliminated(size_t index) {
  const SchurBlock& block = schur_blocks_[index];
  auto gradient = cell_gradients_.col(evidence_.keypoints[index].image_cell);
  const Matrix3d cross = Skew(model_.keypoints[index].point);
  const Vector4d solved_gradient = block.covariance * block.gradient;
  for (const FrameTerm& frame : block.frames) {
    const Vector4d slope = frame.cost.gradient - frame.coupling.transpose() * solved_gradient;
    AddDisplaced(slope, cross, gradient.segment<7>(frame.column));
    const Matrix4d solved = block.covariance * frame.coupling;
    for (const FrameTerm& other : block.frames) {
      if (other.column > frame.column) continue;
      Matrix4d shared = -solved.transpose() * other.coupling;
      if (other.column == frame.column) shared += frame.cost.hessian;
      AddDisplaced(shared, cross, hessian_.block<7, 7>(frame.column, other.column));
    }
  }
}

VectorXd JointRefinement::Linearize() {
  hessian_.setZero(num_columns_, num_columns_);
  cell_gradients_.setZero(num_columns_, evidence_.num_image_cells);
  for (size_t k = 0; k < schur_blocks_.size(); ++k) {
    schur_blocks_[k].used = LinearizeKeypoint(k);
    if (schur_blocks_[k].used) AddEliminated(k);
  }
  VectorXd gradient = cell_gradients_.rowwise().sum();
  if (!pose_priors_.empty()) AddPosePriors(gradient);
  if (WithReferences()) AddReferencePriors(gradient);
  hessian_ = MatrixXd(hessian_.selfadjointView<Eigen::Lower>());
  return gradient;
}

std::optional<double> JointRefinement::Step() {
  const VectorXd gradient = Linearize();
  MatrixXd damped = hessian_;
  damped.diagonal().head<kQueryColumns>().array() +=
      1e-12 * damped.diagonal().head<kQueryColumns>().maxCoeff();
  const Eigen::LDLT<MatrixXd> factors(damped);
  const VectorXd step = factors.solve(-gradient);
  if (!IsModest(step)) return std::nullopt;
  log_information_ = factors.vectorD().array().abs().log().sum();

  MoveQuery(step);
  if (WithReferences()) {
    for (size_t r = 0; r < column_.size(); ++r) {
      if (column_[r] < 0) continue;
      model_.references[r].rotation_vector += step.segment<3>(column_[r]);
      model_.references[r].translation += step.segment<3>(column_[r] + 3);
      model_.references[r].log_scale += step[column_[r] + 6];
    }
    UpdateReferenceVariances(factors.solve(MatrixXd::Identity(num_columns_, num_columns_)));
  }

  for (size_t k = 0; k < schur_blocks_.size(); ++k) {
    const SchurBlock& block = schur_blocks_[k];
    if (!block.used) continue;
    KeypointState& state = model_.keypoints[k];
    Vector4d pull = block.gradient;
    for (const FrameTerm& frame : block.frames) {
      pull += frame.coupling * FrameTerm::Displacement(step.segment<7>(frame.column), state.point);
    }
    MovePoint(-block.covariance * pull, evidence_.keypoints[k].CenterOfCamera(model_.pose), state);
  }
  return -gradient.dot(step);
}

void JointRefinement::AddPosePriors(VectorXd& gradient) {
  NormalEquations of_cam;
  pose_priors_.AddTo(model_.pose, 1, of_cam);
  const Matrix6d to_cam = CamStepFromOwn(model_.pose);
  gradient.head<6>() += to_cam.transpose() * of_cam.gradient;
  // The pixels' cell of the Hessian is their information by that factor.
  hessian_.topLeftCorner<6, 6>() +=
      to_cam.transpose() * of_cam.hessian * to_cam / StudentInformation(model_.noise.keypoint_tail);
}

void JointRefinement::MoveQuery(const Eigen::Ref<const VectorXd>& step) {
  model_.pose.translation += model_.pose.rotation * step.segment<3>(3);
  const Matrix3d rotation = RotationFromVector(step.head<3>()).toRotationMatrix();
  model_.pose.rotation =
      Eigen::Quaterniond(model_.pose.rotation * rotation).normalized().toRotationMatrix();
  model_.noise.log_distance_mean += step[6];
}

void JointRefinement::MovePoint(const Vector4d& move, const Vector3d& query_center,
                                KeypointState& state) const {
  // Not beyond what the linearization tells.
  const double limit = 0.5 * (state.point - query_center).norm();
  const double length = move.head<3>().norm();
  if (!std::isfinite(length + move[3])) return;
  const double share = length > limit ? limit / length : 1;
  state.point += share * move.head<3>();
  state.common += share * move[3];
}

bool JointRefinement::ReferencesDisagree() const {
  std::vector<Matrix7d> information(column_.size(), Matrix7d::Zero());
  std::vector<Vector7d> score(column_.size(), Vector7d::Zero());
  std::vector<int> residuals(column_.size(), 0);
  for (size_t index = 0; index < schur_blocks_.size(); ++index) {
    const KeypointObservations& keypoint = evidence_.keypoints[index];
    if (!schur_blocks_[index].used) continue;
    const Matrix4d covariance = schur_blocks_[index].covariance;
    Matrix47d by_camera_reference = Matrix47d::Zero();
    by_camera_reference.topLeftCorner<3, 6>() = DisplacementJacobian(model_.keypoints[index].point);
    by_camera_reference(3, 6) = 1;
    const auto add = [&](size_t frame, const Quadratic& cost) {
      const Matrix4d reduced = cost.hessian - cost.hessian * covariance * cost.hessian;
      information[frame].noalias() +=
          by_camera_reference.transpose() * reduced * by_camera_reference;
      score[frame].noalias() += by_camera_reference.transpose() * cost.gradient;
      residuals[frame] += 3;
    };
    for (int i = keypoint.first_observation; i < keypoint.end_observation; ++i) {
      if (model_.weights.observation[i] < 0.5) continue;
      const ObservationTerm term = model_.ObservationTermOf(i, model_.keypoints[index]);
      if (term.weight > 0) {
        add(static_cast<size_t>(evidence_.observations[i].reference), term.Cost());
      }
    }
    if (keypoint.end_unanchored > keypoint.first_unanchored) {
      add(model_.UnanchoredFrame(), model_.UnanchoredCost(keypoint, model_.keypoints[index].point));
    }
  }
  double statistic = 0;
  int degrees = 0;
  for (size_t r = 0; r < column_.size(); ++r) {
    const double trace = information[r].trace();
    if (!(trace > 0)) continue;
    information[r].diagonal().array() += 1e-9 * trace;
    statistic += score[r].dot(information[r].ldlt().solve(score[r]));
    degrees += std::min(residuals[r], r == model_.UnanchoredFrame() ? 6 : 7);
  }
  // Gradients have the pixels' expected information, not their mean precision (depths' are normal).
  statistic /= StudentInformation(model_.noise.keypoint_tail);
  // One case in a thousand, by the normal approximation.
  return degrees > 0 && statistic > degrees + 3.1 * std::sqrt(2.0 * degrees);
}

void JointRefinement::AdmitReferenceErrors() {
  std::vector<double> support(column_.size(), 0);
  for (size_t i = 0; i < evidence_.observations.size(); ++i) {
    support[evidence_.observations[i].reference] += model_.weights.observation[i];
  }
  for (const double weight : model_.weights.unanchored) support[model_.UnanchoredFrame()] += weight;
  for (size_t r = 0; r < column_.size(); ++r) {
    if (support[r] < 1) continue;
    column_[r] = num_columns_;
    num_columns_ += 7;
  }
  // To begin with, as large as what single matches show.
  const double angle2 = model_.noise.keypoint_px2 / (evidence_.focal_px * evidence_.focal_px);
  model_.noise.reference_rotation = 0.25 * angle2;
  model_.noise.reference_center = 0.25 * angle2 * std::exp(2 * model_.noise.log_distance_mean);
  model_.noise.reference_scale = model_.noise.depth + model_.noise.common_depth;
}

void JointRefinement::AddReferencePriors(VectorXd& gradient) {
  const JointNoise& noise = model_.noise;
  for (size_t r = 0; r < column_.size(); ++r) {
    if (column_[r] < 0) continue;
    // The center c is displaced by turn x c + shift.
    Matrix7d to_prior = Matrix7d::Identity();
    to_prior.block<3, 6>(3, 0) = DisplacementJacobian(evidence_.centers[r]);
    const ReferenceError& error = model_.references[r];
    Vector7d value, information;
    value << error.rotation_vector, error.Displaced(evidence_.centers[r]) - evidence_.centers[r],
        error.log_scale;
    information << Vector3d::Constant(1 / noise.reference_rotation),
        Vector3d::Constant(1 / noise.reference_center), 1 / noise.reference_scale;
    hessian_.block<7, 7>(column_[r], column_[r]) +=
        to_prior.transpose() * information.asDiagonal() * to_prior;
    gradient.segment<7>(column_[r]) += to_prior.transpose() * information.cwiseProduct(value);
  }
}

void JointRefinement::UpdateReferenceVariances(const MatrixXd& covariance) {
  struct Sum {
    double squares = 0, count = 0;
    double Variance(double prior) const {
      return std::max((squares + prior) / (std::max(count, 0.0) + 1), 1e-14);
    }
  };
  Sum rotation, center, factor;
  for (size_t r = 0; r < column_.size(); ++r) {
    if (column_[r] < 0) continue;
    const ReferenceError& error = model_.references[r];
    const Eigen::Matrix<double, 3, 6> at_center = DisplacementJacobian(evidence_.centers[r]);
    const Matrix6d pose = covariance.block<6, 6>(column_[r], column_[r]);
    rotation.squares += error.rotation_vector.squaredNorm();
    rotation.count += 3 - pose.topLeftCorner<3, 3>().trace() / model_.noise.reference_rotation;
    center.squares += (error.Displaced(evidence_.centers[r]) - evidence_.centers[r]).squaredNorm();
    center.count +=
        3 - (at_center * pose * at_center.transpose()).trace() / model_.noise.reference_center;
    factor.squares += error.log_scale * error.log_scale;
    factor.count += 1 - covariance(column_[r] + 6, column_[r] + 6) / model_.noise.reference_scale;
  }
  // As if one more reference had errors of a tenth of a keypoint's, or of a depth's.
  const double angle2 =
      0.01 * model_.noise.keypoint_px2 / (evidence_.focal_px * evidence_.focal_px);
  model_.noise.reference_rotation = rotation.Variance(angle2);
  model_.noise.reference_center =
      center.Variance(angle2 * std::exp(2 * model_.noise.log_distance_mean));
  model_.noise.reference_scale = factor.Variance(model_.noise.depth + model_.noise.common_depth);
}

Matrix7d JointRefinement::QueryCovariance() const {
  if (hessian_.rows() == 0) return Matrix7d::Zero();
  const Eigen::LDLT<Matrix7d> factors(hessian_.topLeftCorner<kQueryColumns, kQueryColumns>());
  if (!factors.isPositive() || !(factors.vectorD().minCoeff() > 0)) return Matrix7d::Zero();
  const Matrix7d covariance = factors.solve(Matrix7d::Identity());
  return covariance.allFinite() ? covariance : Matrix7d(Matrix7d::Zero());
}

std::optional<Matrix6d> JointRefinement::Covariance() const {
  if (hessian_.rows() == 0) return std::nullopt;
  const Eigen::LDLT<MatrixXd> factors(hessian_);
  if (!factors.isPositive() || !(factors.rcond() > 1e-16)) return std::nullopt;
  const MatrixXd inverse =
      factors.solve(MatrixXd::Identity(num_columns_, num_columns_).leftCols(6));
  const Matrix6d to_cam = CamStepFromOwn(model_.pose);
  const Matrix6d covariance =
      VarianceFactor(inverse) * to_cam * inverse.topRows<6>() * to_cam.transpose();
  if (!covariance.allFinite()) return std::nullopt;
  return Matrix6d(0.5 * (covariance + covariance.transpose()));
}

double JointRefinement::VarianceFactor(const MatrixXd& pose_columns) const {
  return Inflation(pose_columns) / StudentInformation(model_.noise.keypoint_tail);
}

std::optional<FocalStep> JointRefinement::StepOfFocal() {
  FocalEquations equations;
  equations.gradient = Linearize();
  equations.hessian = hessian_;
  equations.mixed = VectorXd::Zero(num_columns_);
  for (size_t k = 0; k < schur_blocks_.size(); ++k) {
    const SchurBlock& block = schur_blocks_[k];
    if (!block.used) continue;
    const QueryTerm query = model_.QueryTermOf(k);
    const Eigen::Vector2d& by_focal = evidence_.keypoints[k].px_by_log_focal;
    Vector4d by_point = Vector4d::Zero();
    by_point.head<3>() = query.weight * query.jacobian.transpose() * by_focal;
    const Vector4d solved = block.covariance * by_point;
    equations.slope +=
        query.weight * by_focal.dot(query.seen.error_px) - solved.dot(block.gradient);
    equations.curvature += query.weight * by_focal.squaredNorm() - solved.dot(by_point);
    const Matrix3d cross = Skew(model_.keypoints[k].point);
    for (const FrameTerm& frame : block.frames) {
      Vector4d shared = -frame.coupling.transpose() * solved;
      if (frame.column == 0) shared += by_point;
      AddDisplaced(shared, cross, equations.mixed.segment<7>(frame.column));
    }
  }
  std::optional<FocalStep> step = equations.Solve(CamStepFromOwn(model_.pose));
  if (step) {
    const Eigen::LDLT<MatrixXd> factors(hessian_);
    step->variance *=
        VarianceFactor(factors.solve(MatrixXd::Identity(num_columns_, num_columns_).leftCols(6)));
  }
  return step;
}

double JointRefinement::Inflation(const MatrixXd& pose_columns) const {
  // Each cell's step, if the others were settled: a sandwich estimator with clusters.
  const MatrixXd steps = pose_columns.transpose() * cell_gradients_;
  const Matrix6d covariance = pose_columns.topRows<6>();
  const Eigen::LDLT<Matrix6d> factors(covariance);
  double squares = 0;
  int cells = 0;
  for (int cell = 0; cell < evidence_.num_image_cells; ++cell) {
    if (cell_gradients_.col(cell).isZero(0)) continue;
    squares += steps.col(cell).dot(factors.solve(steps.col(cell)));
    ++cells;
  }
  // Few cells tell nothing of six unknowns.
  if (cells <= 6) return 1;
  // Gradients have the pixels' expected information, not their mean precision.
  const double inflation =
      squares / 6 * cells / (cells - 1) / StudentInformation(model_.noise.keypoint_tail);
  return std::isfinite(inflation) ? std::max(1.0, inflation) : 1;
}

}  // namespace

RefinedPose RefineJointly(const KeypointEvidence& evidence, const CamFromLocal& start,
                          double keypoint_variance_px2, const NoisePrior& prior,
                          const NormalizedPriors& pose_priors, FocalDerivatives focal) {
  return JointRefinement(evidence, start, keypoint_variance_px2, prior, pose_priors).Run(focal);
}

}  // namespace raylift
