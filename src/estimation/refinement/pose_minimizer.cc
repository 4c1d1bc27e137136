#include "estimation/refinement/pose_minimizer.h"

#include <cmath>
#include <vector>

#include "estimation/kernels/kernel_table.h"
#include "estimation/ransac/scores.h"
#include <Eigen/Cholesky>

#include "raylift/geometry/rigid3.h"

namespace raylift {
namespace {

// Adds one camera's normal equations, which are of its own step. A step (w, v) of the query moves a
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

kernels::KernelNormals Normals2D3D(std::span<const kernels::Block2D3D<float>> blocks,
                                   const kernels::KernelPose<float>& pose,
                                   const kernels::KernelLoss& loss) {
  return kernels::ActiveKernels().normals_2d3d_float(blocks.data(), static_cast<int>(blocks.size()),
                                                     pose, loss);
}
kernels::KernelNormals Normals2D3D(std::span<const kernels::Block2D3D<double>> blocks,
                                   const kernels::KernelPose<double>& pose,
                                   const kernels::KernelLoss& loss) {
  return kernels::ActiveKernels().normals_2d3d(blocks.data(), static_cast<int>(blocks.size()), pose,
                                               loss);
}
kernels::KernelNormals Normals2D2D(std::span<const kernels::Block2D2D<float>> blocks,
                                   const int* block_camera_reference,
                                   const kernels::KernelPose<float>& pose,
                                   const std::vector<float>& centers,
                                   const kernels::KernelLoss& loss) {
  return kernels::ActiveKernels().normals_2d2d_float(blocks.data(), block_camera_reference,
                                                     static_cast<int>(blocks.size()), pose,
                                                     centers.data(), loss);
}
kernels::KernelNormals Normals2D2D(std::span<const kernels::Block2D2D<double>> blocks,
                                   const int* block_camera_reference,
                                   const kernels::KernelPose<double>& pose,
                                   const std::vector<double>& centers,
                                   const kernels::KernelLoss& loss) {
  return kernels::ActiveKernels().normals_2d2d(blocks.data(), block_camera_reference,
                                               static_cast<int>(blocks.size()), pose,
                                               centers.data(), loss);
}

// Adds the normals of each run of blocks that one camera sees.
template <typename Block, typename CameraOf, typename NormalsOf>
void AddByCamera(const NormalizedProblem& problem, std::span<const Block> blocks, double weight,
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
NormalEquations Linearize(const NormalizedProblem& problem, const ActiveMatches<T>& matches,
                          const CamFromLocal& pose, const MatchSetWeights& weights) {
  NormalEquations equations;
  AddByCamera(
      problem, matches.blocks_2d3d, weights.weight_2d3d,
      [&](int block) { return matches.block_camera_2d3d[static_cast<size_t>(block)]; },
      [&](const auto& blocks, int camera, int /*first*/) {
        return Normals2D3D(blocks, ToKernelPose<T>(problem.PoseOfCamera(pose, camera)),
                           weights.loss_2d3d);
      },
      equations);
  if (!matches.blocks_2d2d.empty()) {
    const auto kernel_pose = ToKernelPose<T>(pose);
    const std::vector<T> centers = CentersInCam<T>(problem, pose);
    const int* views = matches.block_camera_reference_2d2d.data();
    AddByCamera(
        problem, matches.blocks_2d2d, weights.weight_2d2d,
        [&](int block) { return problem.CameraOf(views[block]); },
        [&](const auto& blocks, int /*camera*/, int first) {
          return Normals2D2D(blocks, views + first, kernel_pose, centers, weights.loss_2d2d);
        },
        equations);
  }
  problem.priors.AddTo(pose, weights.prior_weight, equations);
  return equations;
}
template NormalEquations Linearize<float>(const NormalizedProblem&, const ActiveMatches<float>&,
                                          const CamFromLocal&, const MatchSetWeights&);
template NormalEquations Linearize<double>(const NormalizedProblem&, const ActiveMatches<double>&,
                                           const CamFromLocal&, const MatchSetWeights&);

CamFromLocal Moved(const CamFromLocal& pose, const Vector6d& step) {
  const Eigen::Matrix3d turn = RotationFromVector(step.head<3>()).toRotationMatrix();
  return {turn * pose.rotation, turn * pose.translation + step.tail<3>()};
}

// Takes steps of Levenberg-Marquardt with Marquardt's scaling, which makes the damping blind to
// units.
template <typename T>
CamFromLocal Minimize(const NormalizedProblem& problem, const ActiveMatches<T>& matches,
                      const CamFromLocal& start, const MatchSetWeights& weights, int max_steps,
                      double relative_tolerance) {
  CamFromLocal pose = start;
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
    const CamFromLocal candidate = Moved(pose, step);
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
template CamFromLocal Minimize<float>(const NormalizedProblem&, const ActiveMatches<float>&,
                                      const CamFromLocal&, const MatchSetWeights&, int, double);
template CamFromLocal Minimize<double>(const NormalizedProblem&, const ActiveMatches<double>&,
                                       const CamFromLocal&, const MatchSetWeights&, int, double);

SymmetricFactors::SymmetricFactors(const Eigen::MatrixXd& matrix)
    : factors_(std::make_unique<const Eigen::LDLT<Eigen::MatrixXd>>(matrix)) {}
SymmetricFactors::~SymmetricFactors() = default;

bool SymmetricFactors::IsPositive() const { return factors_->isPositive(); }
double SymmetricFactors::ReciprocalCondition() const { return factors_->rcond(); }
double SymmetricFactors::LogDeterminant() const {
  return factors_->vectorD().array().abs().log().sum();
}
Eigen::VectorXd SymmetricFactors::Solve(const Eigen::VectorXd& right_side) const {
  return factors_->solve(right_side);
}
Eigen::MatrixXd SymmetricFactors::Solve(const Eigen::MatrixXd& right_sides) const {
  return factors_->solve(right_sides);
}

std::optional<FocalStep> FocalEquations::Solve(const Matrix6d& cam_from_pose) const {
  // The curvature that is left must be more than rounding.
  constexpr double kLeastShare = 1e-9;
  const SymmetricFactors factors(hessian);
  if (!factors.IsPositive() || !(factors.ReciprocalCondition() > 1e-16)) return std::nullopt;
  const Eigen::VectorXd followed = factors.Solve(mixed);
  const double information = curvature - mixed.dot(followed);
  if (!(information > kLeastShare * curvature)) return std::nullopt;
  const FocalStep step = {.log_factor = -(slope - followed.dot(gradient)) / information,
                          .variance = 1 / information,
                          .pose_by_log_factor = -(cam_from_pose * followed.head<6>())};
  if (!std::isfinite(step.log_factor) || !step.pose_by_log_factor.allFinite()) return std::nullopt;
  return step;
}

}  // namespace raylift
