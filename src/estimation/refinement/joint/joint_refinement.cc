#include <algorithm>
#include <cmath>
#include <optional>

#include "estimation/refinement/joint/model.h"
#include "estimation/refinement/joint/schur.h"
#include "estimation/refinement/refinement.h"
#include <Eigen/Cholesky>
#include <Eigen/Geometry>

#include "raylift/geometry/rigid3.h"

namespace raylift {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int kMaxRounds = 10;
// After this round, where the pose has moved by more than the keypoints' noise, the keypoints'
// consensus is looked for again: at RANSAC's pose some found none, or a wrong one.
constexpr int kRoundOfReinitialization = 1;
// From this round on weights go a shrinking share of the way to their new values.
constexpr int kFirstDampedRound = 3;
// Squared lengths of steps, in standard deviations of the pose: a longer one than the first is
// followed by another at once, a shorter one than the second may end the refinement.
constexpr double kFarStep = 4;
constexpr double kSettledStep = 0.01;
// The refinement has settled when the information's logarithm, of six and more unknowns, changes by
// less.
constexpr double kSettledInformation = 0.3;
constexpr int kReferenceRounds = 3;
// So many keypoints bring the pose and the noise to rest, as near as a part can; all of them then
// take the last rounds. The part's rounds cost less than they save where it is a quarter or less.
constexpr size_t kEnoughKeypoints = 300;
constexpr size_t kLeastStride = 4;
constexpr int kRoundsAfterPart = 3;

// Returns whether a step of the query is so small that the linearization holds.
bool IsModest(const Eigen::Ref<const VectorXd>& step) {
  constexpr double kLargestRotation = 0.5;
  constexpr double kLargestFactor = 1;  // of the mean distance, as a logarithm
  return step.allFinite() && step.head<3>().norm() < kLargestRotation &&
         std::abs(step[6]) < kLargestFactor;
}

// Returns every n-th keypoint with its evidence.
KeypointEvidence Thinned(const KeypointEvidence& evidence, size_t n) {
  KeypointEvidence part;
  part.centers = evidence.centers;
  part.matched_area_px2 = evidence.matched_area_px2;
  part.num_image_cells = evidence.num_image_cells;
  part.focal_px = evidence.focal_px;
  const auto append = [](const auto& pieces, auto& list, int& first, int& end) {
    first = static_cast<int>(list.size());
    list.insert(list.end(), pieces.begin(), pieces.end());
    end = static_cast<int>(list.size());
  };
  for (size_t k = 0; k < evidence.keypoints.size(); k += n) {
    KeypointObservations& keypoint = part.keypoints.emplace_back(evidence.keypoints[k]);
    append(evidence.ObservationsOf(evidence.keypoints[k]), part.observations,
           keypoint.first_observation, keypoint.end_observation);
    append(evidence.UnanchoredOf(evidence.keypoints[k]), part.unanchored, keypoint.first_unanchored,
           keypoint.end_unanchored);
  }
  return part;
}

// Returns the evidence with the query's rays through a lens whose focal length is longer by this
// share, to first order (as kernels::QueryLanes has them); nullopt where nothing changes.
std::optional<KeypointEvidence> WithFocalError(const KeypointEvidence& evidence,
                                               double focal_error) {
  if (focal_error == 0) return std::nullopt;
  std::optional<KeypointEvidence> changed = evidence;
  for (KeypointObservations& keypoint : changed->keypoints) {
    keypoint.image_from_cam.topRows<2>() +=
        focal_error * keypoint.px_by_log_focal * keypoint.image_from_cam.row(2);
  }
  return changed;
}

class JointRefinement {
 public:
  JointRefinement(const KeypointEvidence& evidence, const CamFromLocal& start,
                  double keypoint_variance_px2, const NoisePrior& prior,
                  const NormalizedPriors& pose_priors, double focal_sigma)
      : evidence_(evidence),
        prior_(prior),
        pose_priors_(pose_priors),
        focal_sigma_(focal_sigma),
        model_(evidence, start),
        system_(evidence, prior_) {
    InitializePoints(keypoint_variance_px2);
    if (prior_.KnowsReferences()) AdmitReferenceErrors(JointSystem::UnknownErrors::kNone);
  }
  // Goes on from where a part of the evidence has brought the pose and the noise.
  JointRefinement(const KeypointEvidence& evidence, const JointRefinement& of_part)
      : evidence_(evidence),
        prior_(of_part.prior_),
        pose_priors_(of_part.pose_priors_),
        focal_sigma_(of_part.focal_sigma_),
        model_(evidence, of_part.model_.pose),
        system_(evidence, prior_) {
    initialized_at_ = model_.pose;
    initialized_with_ = model_.focal_error = of_part.model_.focal_error;
    model_.noise = of_part.model_.noise;
    model_.references = of_part.model_.references;
    InitializeByVoting(model_);
    if (prior_.KnowsReferences()) AdmitReferenceErrors(JointSystem::UnknownErrors::kNone);
  }

  // Takes rounds of a step and an E step until pose and information have settled.
  void Settle(int max_rounds) {
    double information = 0;
    for (int round = 0; round < max_rounds; ++round) {
      const std::optional<double> decrement = Step();
      if (decrement && *decrement > kFarStep) Step();
      const double share = round < kFirstDampedRound ? 1 : 1.0 / (round - kFirstDampedRound + 2);
      EStep(prior_, share, QueryCovariance(), model_);
      if (round == kRoundOfReinitialization && HasMovedFar()) {
        InitializePoints(model_.noise.keypoint_px2);
        if (prior_.KnowsReferences()) AdmitReferenceErrors(JointSystem::UnknownErrors::kNone);
        continue;
      }
      const bool same = std::abs(log_information_ - information) < kSettledInformation;
      if (decrement && *decrement < kSettledStep && same) break;
      information = log_information_;
    }
  }

  RefinedPose Finish(FocalDerivatives focal, ReferenceErrors reference_errors) {
    Step();
    Linearize();
    const bool admits = reference_errors == ReferenceErrors::kAlways ||
                        (!prior_.KnowsAllOfReferences() && system_.ReferencesDisagree(model_));
    if (admits) {
      AdmitReferenceErrors(JointSystem::UnknownErrors::kAsOfMatches);
      for (int round = 0; round < kReferenceRounds; ++round) {
        Step();
        EStep(prior_, 1, QueryCovariance(), model_);
      }
      Step();
    }
    return {.pose = model_.pose,
            .covariance = Covariance(),
            .noise = model_.noise,
            .references_disagree = admits,
            .log_likelihood = model_.log_likelihood - FocalCost(),
            .focal_error = model_.focal_error,
            .focal = focal == FocalDerivatives::kAtPose ? StepOfFocal() : std::nullopt};
  }

 private:
  void AdmitReferenceErrors(JointSystem::UnknownErrors unknown) {
    system_.AdmitReferenceErrors(unknown, model_);
  }
  // Finds each keypoint's point by voting, at the pose as it is.
  void InitializePoints(double keypoint_variance_px2);
  // Returns whether the query's pixels of the points have moved by more than the noise, root mean
  // square, since the points were initialized.
  bool HasMovedFar() const;

  // Takes one Gauss-Newton step of all unknowns, and returns its squared length in standard
  // deviations (Newton's decrement); nullopt where there is none to take.
  std::optional<double> Step();
  void MoveQuery(const Eigen::Ref<const VectorXd>& step);
  // Fills the normal equations. With a known focal length only their gradient is filled (and the
  // system's Hessian).
  void Linearize();

  // Returns what the focal length's error costs by its prior.
  double FocalCost() const {
    const double sigmas = focal_sigma_ > 0 ? model_.focal_error / focal_sigma_ : 0;
    return 0.5 * sigmas * sigmas;
  }
  std::optional<FocalStep> StepOfFocal();
  // Returns the covariance of the query's unknowns, those of the references given; zero where there
  // is none.
  Matrix7d QueryCovariance() const;
  std::optional<Matrix6d> Covariance() const;
  // Returns the part of the pose's covariance that is due to an uncertain focal length. `factor` is
  // the variance over the inverse Hessian's.
  Matrix6d CovarianceByFocal(const SymmetricFactors& factors, double factor) const;
  // Returns the first six columns of the inverse Hessian.
  MatrixXd PoseColumns(const SymmetricFactors& factors) const {
    return factors.Solve(
        MatrixXd(MatrixXd::Identity(system_.num_columns(), system_.num_columns()).leftCols(6)));
  }
  // Returns the variance over the inverse Hessian's: the pixels' part of the Hessian is their
  // information over StudentInformation().
  double VarianceFactor(const MatrixXd& pose_columns) const;
  // Returns the factor, at least 1, by which the pose's covariance (the first columns of the
  // inverse Hessian) understates how far the cells of the image pull the pose apart: errors that
  // the model does not know, of the lens for instance, are common to neighbors.
  double Inflation(const MatrixXd& pose_columns) const;

  const KeypointEvidence& evidence_;
  const NoisePrior& prior_;
  const NormalizedPriors& pose_priors_;
  const double focal_sigma_;
  JointModel model_;
  JointSystem system_;
  FocalEquations equations_;  // of the last step
  CamFromLocal initialized_at_;
  double initialized_with_ = 0;  // error of the focal length
  double log_information_ = 0;   // of the last step's Hessian, its determinant's logarithm
};

void JointRefinement::InitializePoints(double keypoint_variance_px2) {
  initialized_at_ = model_.pose;
  initialized_with_ = model_.focal_error;
  const auto refocused = WithFocalError(evidence_, model_.focal_error);
  model_.noise =
      InitializeNoise(refocused ? *refocused : evidence_, model_.pose, keypoint_variance_px2);
  if (prior_.depth.count > 0) model_.noise.depth = prior_.depth.variance;
  if (prior_.common_depth.count > 0) model_.noise.common_depth = prior_.common_depth.variance;
  if (prior_.keypoint_tail) model_.noise.keypoint_tail = prior_.keypoint_tail->mean;
  InitializeByVoting(model_);
}

bool JointRefinement::HasMovedFar() const {
  double squares = 0;
  double count = 0;
  for (size_t k = 0; k < evidence_.keypoints.size(); ++k) {
    const KeypointObservations& keypoint = evidence_.keypoints[k];
    const Eigen::Vector3d point = model_.blocks.PointOf(k);
    const auto seen_from = [&](const CamFromLocal& pose) {
      return ResidualOf(keypoint.image_from_cam, keypoint.PointInCamera(pose, point));
    };
    PixelResidual now = seen_from(model_.pose);
    const PixelResidual then = seen_from(initialized_at_);
    if (!now.in_front || !then.in_front) continue;
    now.error_px += (model_.focal_error - initialized_with_) * keypoint.px_by_log_focal;
    // A point that went out of sight counts no more than one that has moved by ten deviations.
    squares +=
        std::min((now.error_px - then.error_px).squaredNorm(), 100 * model_.noise.keypoint_px2);
    count += 1;
  }
  return squares > count * model_.noise.keypoint_px2;
}

std::optional<double> JointRefinement::Step() {
  Linearize();
  constexpr int kQueryColumns = JointSystem::kQueryColumns;
  MatrixXd damped = system_.hessian();
  damped.diagonal().head<kQueryColumns>().array() +=
      1e-12 * damped.diagonal().head<kQueryColumns>().maxCoeff();
  const SymmetricFactors factors(damped);
  VectorXd step = factors.Solve(VectorXd(-equations_.gradient));
  double focal_step = 0;
  if (focal_sigma_ > 0) {
    const VectorXd followed = factors.Solve(equations_.mixed);
    focal_step = -(equations_.slope - followed.dot(equations_.gradient)) /
                 (equations_.curvature - followed.dot(equations_.mixed));
    step -= focal_step * followed;
  }
  if (!IsModest(step) || !std::isfinite(focal_step)) return std::nullopt;
  log_information_ = factors.LogDeterminant();

  MoveQuery(step);
  model_.focal_error += focal_step;
  if (system_.HasReferences()) {
    system_.MoveReferences(step, model_);
    system_.UpdateReferenceVariances(
        factors.Solve(MatrixXd(MatrixXd::Identity(system_.num_columns(), system_.num_columns()))),
        model_);
  }
  system_.MovePoints(step, focal_step, model_);
  return -equations_.gradient.dot(step) - equations_.slope * focal_step;
}

void JointRefinement::Linearize() {
  if (focal_sigma_ == 0) {
    equations_.gradient = system_.Linearize(pose_priors_, model_);
    return;
  }
  equations_ = system_.LinearizeWithFocal(pose_priors_, model_);
  const double information = 1 / (focal_sigma_ * focal_sigma_);
  equations_.slope += information * model_.focal_error;
  // The prior's information is over StudentInformation(), as the pixels' part of the Hessian is.
  equations_.curvature += information / StudentInformation(model_.noise.keypoint_tail);
}

void JointRefinement::MoveQuery(const Eigen::Ref<const VectorXd>& step) {
  model_.pose.translation += model_.pose.rotation * step.segment<3>(3);
  const Matrix3d rotation = RotationFromVector(step.head<3>()).toRotationMatrix();
  model_.pose.rotation =
      Eigen::Quaterniond(model_.pose.rotation * rotation).normalized().toRotationMatrix();
  model_.noise.log_distance_mean += step[6];
}

Matrix7d JointRefinement::QueryCovariance() const {
  if (system_.hessian().rows() == 0) return Matrix7d::Zero();
  const Eigen::LDLT<Matrix7d> factors(
      system_.hessian().topLeftCorner<JointSystem::kQueryColumns, JointSystem::kQueryColumns>());
  if (!factors.isPositive() || !(factors.vectorD().minCoeff() > 0)) return Matrix7d::Zero();
  const Matrix7d covariance = factors.solve(Matrix7d::Identity());
  return covariance.allFinite() ? covariance : Matrix7d(Matrix7d::Zero());
}

std::optional<Matrix6d> JointRefinement::Covariance() const {
  if (system_.hessian().rows() == 0) return std::nullopt;
  const SymmetricFactors factors(system_.hessian());
  if (!factors.IsPositive() || !(factors.ReciprocalCondition() > 1e-16)) return std::nullopt;
  const MatrixXd inverse = PoseColumns(factors);
  const Matrix6d to_cam = CamStepFromOwn(model_.pose);
  const double factor = VarianceFactor(inverse);
  Matrix6d of_own = factor * inverse.topRows<6>();
  if (focal_sigma_ > 0) of_own += CovarianceByFocal(factors, factor);
  const Matrix6d covariance = to_cam * of_own * to_cam.transpose();
  if (!covariance.allFinite()) return std::nullopt;
  return Matrix6d(0.5 * (covariance + covariance.transpose()));
}

Matrix6d JointRefinement::CovarianceByFocal(const SymmetricFactors& factors, double factor) const {
  const VectorXd followed = factors.Solve(equations_.mixed);
  const double prior = 1 / (focal_sigma_ * focal_sigma_);
  const double by_matches = equations_.curvature -
                            prior / StudentInformation(model_.noise.keypoint_tail) -
                            equations_.mixed.dot(followed);
  const double variance = 1 / (std::max(by_matches, 0.0) / factor + prior);
  return variance * followed.head<6>() * followed.head<6>().transpose();
}

double JointRefinement::VarianceFactor(const MatrixXd& pose_columns) const {
  return Inflation(pose_columns) / StudentInformation(model_.noise.keypoint_tail);
}

std::optional<FocalStep> JointRefinement::StepOfFocal() {
  const FocalEquations equations = system_.LinearizeWithFocal(pose_priors_, model_);
  std::optional<FocalStep> step = equations.Solve(CamStepFromOwn(model_.pose));
  if (step) {
    step->variance *= VarianceFactor(PoseColumns(SymmetricFactors(system_.hessian())));
  }
  return step;
}

double JointRefinement::Inflation(const MatrixXd& pose_columns) const {
  // Each cell's step, if the others were settled: a sandwich estimator with clusters.
  const MatrixXd gradients = system_.CellGradients(model_);
  const MatrixXd steps = pose_columns.transpose() * gradients;
  const Matrix6d covariance = pose_columns.topRows<6>();
  const Eigen::LDLT<Matrix6d> factors(covariance);
  double squares = 0;
  int cells = 0;
  for (int cell = 0; cell < evidence_.num_image_cells; ++cell) {
    if (gradients.col(cell).isZero(0)) continue;
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
                          const NormalizedPriors& pose_priors, FocalDerivatives focal,
                          ReferenceErrors reference_errors, double focal_sigma) {
  const size_t stride = evidence.keypoints.size() / kEnoughKeypoints;
  if (stride < kLeastStride) {
    JointRefinement refinement(evidence, start, keypoint_variance_px2, prior, pose_priors,
                               focal_sigma);
    refinement.Settle(kMaxRounds);
    return refinement.Finish(focal, reference_errors);
  }
  const KeypointEvidence part = Thinned(evidence, stride);
  JointRefinement of_part(part, start, keypoint_variance_px2, prior, pose_priors, focal_sigma);
  of_part.Settle(kMaxRounds);
  JointRefinement refinement(evidence, of_part);
  refinement.Settle(kRoundsAfterPart);
  return refinement.Finish(focal, reference_errors);
}

}  // namespace raylift
