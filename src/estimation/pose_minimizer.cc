#include "estimation/pose_minimizer.h"

#include <vector>

#include "estimation/joint_score.h"
#include "estimation/kernels/kernel_table.h"
#include <Eigen/Cholesky>

#include "raylift/geometry/rigid3.h"

namespace raylift {
namespace {

// Adds what one camera says, of whose own step the normals are. A step (w, v) of the query moves a
// camera at `center` by (w, v + w x center).
void Add(const kernels::KernelNormals& normals, double weight, const Eigen::Vector3d& center,
         NormalEquations& equations) {
  NormalEquations of_camera;
  int k = 0;
  for (int r = 0; r < 6; ++r) {
    of_camera.gradient[r] = weight * normals.gradient[r];
    for (int c = r; c < 6; ++c, ++k) {
      of_camera.hessian(r, c) = of_camera.hessian(c, r) = weight * normals.hessian[k];
    }
  }
  if (!center.isZero(0)) {
    Matrix6d camera_from_query = Matrix6d::Identity();
    camera_from_query.bottomLeftCorner<3, 3>() = -Skew(center);
    of_camera.hessian = camera_from_query.transpose() * of_camera.hessian * camera_from_query;
    of_camera.gradient = camera_from_query.transpose() * of_camera.gradient;
  }
  equations.hessian += of_camera.hessian;
  equations.gradient += of_camera.gradient;
  equations.cost += weight * normals.cost;
}

kernels::KernelNormals PointNormals(std::span<const kernels::PointBlock<float>> blocks,
                                    const kernels::KernelPose<float>& pose,
                                    const kernels::KernelLoss& loss) {
  return kernels::ActiveKernels().point_normals_float(blocks.data(),
                                                      static_cast<int>(blocks.size()), pose, loss);
}
kernels::KernelNormals PointNormals(std::span<const kernels::PointBlock<double>> blocks,
                                    const kernels::KernelPose<double>& pose,
                                    const kernels::KernelLoss& loss) {
  return kernels::ActiveKernels().point_normals(blocks.data(), static_cast<int>(blocks.size()),
                                                pose, loss);
}
kernels::KernelNormals PairNormals(std::span<const kernels::PairBlock<float>> blocks,
                                   const int* block_view, const kernels::KernelPose<float>& pose,
                                   const std::vector<float>& centers,
                                   const kernels::KernelLoss& loss) {
  return kernels::ActiveKernels().pair_normals_float(
      blocks.data(), block_view, static_cast<int>(blocks.size()), pose, centers.data(), loss);
}
kernels::KernelNormals PairNormals(std::span<const kernels::PairBlock<double>> blocks,
                                   const int* block_view, const kernels::KernelPose<double>& pose,
                                   const std::vector<double>& centers,
                                   const kernels::KernelLoss& loss) {
  return kernels::ActiveKernels().pair_normals(
      blocks.data(), block_view, static_cast<int>(blocks.size()), pose, centers.data(), loss);
}

// Adds the normals of each run of blocks that one camera sees.
template <typename Block, typename CameraOf, typename NormalsOf>
void AddByCamera(const PreparedProblem& problem, std::span<const Block> blocks, double weight,
                 const CameraOf& camera_of, const NormalsOf& normals_of,
                 NormalEquations& equations) {
  ForEachCamera(
      0, static_cast<int>(blocks.size()), camera_of, [&](int camera, int first, int count) {
        const auto part = blocks.subspan(static_cast<size_t>(first), static_cast<size_t>(count));
        Add(normals_of(part, camera, first), weight,
            problem.camera_centers[static_cast<size_t>(camera)], equations);
      });
}

}  // namespace

template <typename T>
NormalEquations Linearize(const PreparedProblem& problem, const ActiveMatches<T>& matches,
                          const SolverPose& pose, const KindWeights& weights) {
  NormalEquations equations;
  AddByCamera(
      problem, matches.point_blocks, weights.point_weight,
      [&](int block) { return matches.point_block_camera[static_cast<size_t>(block)]; },
      [&](const auto& blocks, int camera, int /*first*/) {
        return PointNormals(blocks, ToKernelPose<T>(problem.PoseOfCamera(pose, camera)),
                            weights.point_loss);
      },
      equations);
  if (!matches.pair_blocks.empty()) {
    const auto kernel_pose = ToKernelPose<T>(pose);
    const std::vector<T> centers = CentersInCam<T>(problem, pose);
    const int* views = matches.pair_block_view.data();
    AddByCamera(
        problem, matches.pair_blocks, weights.pair_weight,
        [&](int block) { return problem.CameraOf(views[block]); },
        [&](const auto& blocks, int /*camera*/, int first) {
          return PairNormals(blocks, views + first, kernel_pose, centers, weights.pair_loss);
        },
        equations);
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
