// The normal equations of the joint refinement, its points eliminated by the Schur complement.
//
// With a frame's seven unknowns f (of the query: rotation, translation and the mean of the
// distances' logarithm; of a reference that errs: rotation, translation and the logarithm of its
// depths' scale) and the four of a keypoint p (its point, and the error that its depths have in
// common), each keypoint adds
//
//   H_ff - H_fp H_pp^-1 H_pf   and   g_f - H_fp H_pp^-1 g_p.
//
// All frames displace a point alike, by D f with D = (-[point]x, 1, 0; 0, 0, 1), so that a
// keypoint's part is worked out in the four dimensions of D f first.

#pragma once

#include <vector>

#include "estimation/refinement/joint/model.h"
#include "estimation/refinement/pose_minimizer.h"
#include <Eigen/Core>

namespace raylift {

using Vector7d = Eigen::Matrix<double, 7, 1>;

// Returns the matrix that takes a rotation about the local origin and a translation before the pose
// to (w, v) after it, in the camera's tangent frame.
Matrix6d CamStepFromOwn(const CamFromLocal& pose);

class JointSystem {
 public:
  static constexpr int kQueryColumns = 7;

  JointSystem(const KeypointEvidence& evidence, const NoisePrior& prior)
      : evidence_(evidence), prior_(prior), column_(evidence.centers.size(), -1) {}

  bool HasReferences() const { return num_columns_ > kQueryColumns; }
  int num_columns() const { return num_columns_; }
  // The Hessian of all frames after Linearize(); empty before it.
  const Eigen::MatrixXd& hessian() const { return hessian_; }
  // Returns the gradient of each cell of the query's images, in a column, as of Linearize().
  Eigen::MatrixXd CellGradients(const JointModel& model) const;

  // Fills the normal equations, and returns their gradient.
  Eigen::VectorXd Linearize(const NormalizedPriors& pose_priors, JointModel& model);
  // Does so with the logarithm of the query's focal length as one more unknown.
  FocalEquations LinearizeWithFocal(const NormalizedPriors& pose_priors, JointModel& model);

  // Moves the references, and then the points, by a step of all frames (and of the focal length's
  // logarithm, after LinearizeWithFocal()); the query has moved already.
  void MoveReferences(const Eigen::VectorXd& step, JointModel& model) const;
  void MovePoints(const Eigen::VectorXd& step, double focal_step, JointModel& model) const;

  // Returns whether the residuals of whole references have a direction, by the score test:
  // chi-squared with seven degrees of freedom each, if they are independent.
  bool ReferencesDisagree(const JointModel& model) const;
  // Gives the references that enough evidence speaks for columns of their own, if they have none.
  // The variances of their errors start at the known ones; unknown ones at what single matches
  // show, or at 0.
  enum class UnknownErrors { kNone, kAsOfMatches };
  void AdmitReferenceErrors(UnknownErrors unknown, JointModel& model);
  // Estimates the variances of the references' errors anew; `covariance` is the inverse Hessian.
  void UpdateReferenceVariances(const Eigen::MatrixXd& covariance, JointModel& model) const;

 private:
  // The cost of a keypoint in a frame that has columns, linearized.
  struct FrameTerm {
    int column;  // of the frame's first unknown
    Quadratic cost;
  };

  enum class FocalLength { kKnown, kUnknown };

  FocalEquations LinearizeKeypoints(const NormalizedPriors& pose_priors, FocalLength focal_length,
                                    JointModel& model);
  // Collects the terms of a keypoint's references with columns, as of Linearize().
  void CollectTerms(const JointModel& model, size_t keypoint, std::vector<FrameTerm>& terms) const;
  // Adds them, the keypoint's point eliminated, to the equations and to the lower triangle of the
  // Hessian.
  void AddReferenceTerms(const JointModel& model, FocalLength focal_length, size_t keypoint,
                         const std::vector<FrameTerm>& terms, FocalEquations& equations);
  // Writes the references' steps to the slots, and that of the unanchored points to `parameters`.
  void TakeReferenceSteps(const Eigen::VectorXd& step, JointModel& model,
                          kernels::JointParameters& parameters) const;
  void AddPosePriors(const JointModel& model, const NormalizedPriors& pose_priors,
                     Eigen::VectorXd& gradient);
  void AddReferencePriors(const JointModel& model, Eigen::VectorXd& gradient);
  void AddReferenceColumns(const JointModel& model);
  // Returns the variance of a keypoint's direction, radians squared.
  double AngleVariance(const JointNoise& noise) const;

  const KeypointEvidence& evidence_;
  const NoisePrior& prior_;
  std::vector<int> column_;  // of each reference's first unknown; -1: it has none
  int num_columns_ = kQueryColumns;
  Eigen::MatrixXd hessian_;
};

}  // namespace raylift
