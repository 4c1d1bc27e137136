#include "estimation/pose_minimizer.h"

#include <vector>

#include "estimation/joint_score.h"
#include "estimation/kernels/kernel_table.h"
#include <Eigen/Cholesky>

#include "raylift/geometry/rigid3.h"

namespace raylift {
namespace {

void Add(const kernels::KernelNormals& normals, double weight, NormalEquations& equations) {
  int k = 0;
  for (int r = 0; r < 6; ++r) {
    equations.gradient[r] += weight * normals.gradient[r];
    for (int c = r; c < 6; ++c, ++k) {
      equations.hessian(r, c) += weight * normals.hessian[k];
      equations.hessian(c, r) = equations.hessian(r, c);
    }
  }
  equations.cost += weight * normals.cost;
}

kernels::KernelNormals PointNormals(const ActiveMatches<float>& m,
                                    const kernels::KernelPose<float>& pose,
                                    const kernels::KernelLoss& loss) {
  return kernels::ActiveKernels().point_normals_float(
      m.point_blocks.data(), static_cast<int>(m.point_blocks.size()), pose, loss);
}
kernels::KernelNormals PointNormals(const ActiveMatches<double>& m,
                                    const kernels::KernelPose<double>& pose,
                                    const kernels::KernelLoss& loss) {
  return kernels::ActiveKernels().point_normals(
      m.point_blocks.data(), static_cast<int>(m.point_blocks.size()), pose, loss);
}
kernels::KernelNormals PairNormals(const ActiveMatches<float>& m,
                                   const kernels::KernelPose<float>& pose,
                                   const std::vector<float>& centres,
                                   const kernels::KernelLoss& loss) {
  return kernels::ActiveKernels().pair_normals_float(
      m.pair_blocks.data(), m.pair_block_reference.data(), static_cast<int>(m.pair_blocks.size()),
      pose, centres.data(), loss);
}
kernels::KernelNormals PairNormals(const ActiveMatches<double>& m,
                                   const kernels::KernelPose<double>& pose,
                                   const std::vector<double>& centres,
                                   const kernels::KernelLoss& loss) {
  return kernels::ActiveKernels().pair_normals(m.pair_blocks.data(), m.pair_block_reference.data(),
                                               static_cast<int>(m.pair_blocks.size()), pose,
                                               centres.data(), loss);
}

}  // namespace

template <typename T>
NormalEquations Linearize(const PreparedProblem& problem, const ActiveMatches<T>& matches,
                          const SolverPose& pose, const KindWeights& weights) {
  NormalEquations equations;
  const auto kernel_pose = ToKernelPose<T>(pose);
  if (!matches.point_blocks.empty()) {
    Add(PointNormals(matches, kernel_pose, weights.point_loss), weights.point_weight, equations);
  }
  if (!matches.pair_blocks.empty()) {
    Add(PairNormals(matches, kernel_pose, CentresInCam<T>(problem, pose), weights.pair_loss),
        weights.pair_weight, equations);
  }
  problem.priors.AddTo(pose, weights.prior_weight, equations);
  return equations;
}
template NormalEquations Linearize<float>(const PreparedProblem&, const ActiveMatches<float>&,
                                          const SolverPose&, const KindWeights&);
template NormalEquations Linearize<double>(const PreparedProblem&, const ActiveMatches<double>&,
                                           const SolverPose&, const KindWeights&);

SolverPose Moved(const SolverPose& pose, const Vector6d& step) {
  const Eigen::Matrix3d turn = RotationFromVector(step.head<3>()).toRotationMatrix();
  return {turn * pose.rotation, turn * pose.translation + step.tail<3>()};
}

// Levenberg-Marquardt with Marquardt's scaling, which makes the damping blind to units.
template <typename T>
SolverPose Minimize(const PreparedProblem& problem, const ActiveMatches<T>& matches,
                    const SolverPose& start, const KindWeights& weights, int max_steps,
                    double relative_tolerance) {
  SolverPose pose = start;
  NormalEquations equations = Linearize(problem, matches, pose, weights);
  double damping = 1e-4;
  for (int i = 0; i < max_steps; ++i) {
    Matrix6d damped = equations.hessian;
    const double floor = 1e-12 * damped.diagonal().maxCoeff();
    damped.diagonal() += damping * damped.diagonal() + Vector6d::Constant(floor);
    const Vector6d step = damped.ldlt().solve(-equations.gradient);
    if (!step.allFinite() || step.head<3>().norm() > 1) {
      break;
    }
    const SolverPose candidate = Moved(pose, step);
    const NormalEquations next = Linearize(problem, matches, candidate, weights);
    if (next.cost < equations.cost) {
      const double gain = equations.cost - next.cost;
      pose = candidate;
      equations = next;
      damping *= 0.1;
      if (gain < relative_tolerance * next.cost) {
        break;
      }
    } else {
      damping *= 10;
      if (damping > 1e4 || step.norm() < 1e-10) {
        break;
      }
    }
  }
  // Many small turns leave the matrix a rounding error away from a rotation.
  pose.rotation = Eigen::Quaterniond(pose.rotation).normalized().toRotationMatrix();
  return pose;
}
template SolverPose Minimize<float>(const PreparedProblem&, const ActiveMatches<float>&,
                                    const SolverPose&, const KindWeights&, int, double);
template SolverPose Minimize<double>(const PreparedProblem&, const ActiveMatches<double>&,
                                     const SolverPose&, const KindWeights&, int, double);

}  // namespace raylift
