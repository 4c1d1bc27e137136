// Minimizes a robust cost of matches over the pose, by Levenberg-Marquardt on fixed-size normal
// equations that the kernels sum: in single precision for local optimization, in double for the
// final refinement.

#pragma once

#include <memory>
#include <optional>
#include <span>

#include "estimation/kernels/kernels.h"
#include "estimation/problem/normalized_problem.h"
#include <Eigen/Core>

namespace raylift {

// The matches that a refinement works on; blocks that live elsewhere.
template <typename T>
struct ActiveMatches {
  std::span<const kernels::Block2D3D<T>> blocks_2d3d;
  std::span<const int> block_camera_2d3d;
  std::span<const kernels::Block2D2D<T>> blocks_2d2d;
  std::span<const int> block_camera_reference_2d2d;
};

// The weights of the cost. A match costs its set's weight times the loss of its squared residual;
// the pose's priors, whose residuals are over standard deviations instead of thresholds, have a
// weight, too.
struct MatchSetWeights {
  double weight_2d3d = 1;
  double weight_2d2d = 1;
  double prior_weight = kSquaredSigma;
  kernels::KernelLoss loss_2d3d = {};
  kernels::KernelLoss loss_2d2d = {};
};

template <typename T>
NormalEquations Linearize(const NormalizedProblem& problem, const ActiveMatches<T>& matches,
                          const CamFromLocal& pose, const MatchSetWeights& weights);

CamFromLocal Moved(const CamFromLocal& pose, const Vector6d& step);

// Takes `max_steps` steps at most, of which none raises the cost; ends sooner where a step gains
// less than `relative_tolerance` of the cost.
template <typename T>
CamFromLocal Minimize(const NormalizedProblem& problem, const ActiveMatches<T>& matches,
                      const CamFromLocal& start, const MatchSetWeights& weights, int max_steps,
                      double relative_tolerance);

// LDLT factors of a symmetric matrix of any size. (Eigen's take long to compile: here, once.)
class SymmetricFactors {
 public:
  explicit SymmetricFactors(const Eigen::MatrixXd& matrix);
  ~SymmetricFactors();

  bool IsPositive() const;
  double ReciprocalCondition() const;
  double LogDeterminant() const;
  Eigen::VectorXd Solve(const Eigen::VectorXd& right_side) const;
  Eigen::MatrixXd Solve(const Eigen::MatrixXd& right_sides) const;

 private:
  std::unique_ptr<const Eigen::LDLT<Eigen::MatrixXd>> factors_;
};

// A step of the query's focal length at a refined pose, all else following it.
struct FocalStep {
  double log_factor;            // Newton's step of the focal length's logarithm
  double variance;              // of that logarithm
  Vector6d pose_by_log_factor;  // the pose's step (w, v) in the camera's tangent frame, local units
};

// Normal equations of the focal length's logarithm and of all other unknowns, the pose's first:
// half of the cost's gradient and second derivatives.
struct FocalEquations {
  Eigen::MatrixXd hessian;
  Eigen::VectorXd gradient;
  // The mixed derivatives with the logarithm of the focal length.
  Eigen::VectorXd mixed;
  double slope = 0;
  double curvature = 0;

  // Eliminates all other unknowns; nullopt where the focal length is not determined.
  // `cam_from_pose` takes the first six unknowns to the camera's tangent frame.
  std::optional<FocalStep> Solve(const Matrix6d& cam_from_pose = Matrix6d::Identity()) const;
};

}  // namespace raylift
