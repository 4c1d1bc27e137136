#include "estimation/match_residuals.h"

#include <numeric>

#include "estimation/joint_score.h"
#include "estimation/kernels/kernel_table.h"

namespace raylift {
namespace {

std::vector<int> AllIndices(size_t count) {
  std::vector<int> indices(count);
  std::iota(indices.begin(), indices.end(), 0);
  return indices;
}

std::vector<double> PointResiduals(const PreparedProblem& problem, const SolverPose& pose) {
  const auto blocks = MakePointBlocks<double>(problem.points, AllIndices(problem.points.size()));
  std::vector<double> residuals(blocks.size() * kernels::kLanes<double>);
  kernels::ActiveKernels().point_residuals(blocks.data(), static_cast<int>(blocks.size()),
                                           ToKernelPose<double>(pose), residuals.data());
  residuals.resize(problem.points.size());
  return residuals;
}

std::vector<double> PairResiduals(const PreparedProblem& problem, const SolverPose& pose) {
  const auto blocks = MakePairBlocks<double>(problem.pairs, AllIndices(problem.pairs.size()));
  const auto centres = CentresInCam<double>(problem, pose);
  std::vector<double> lanes(blocks.lane_pair.size());
  kernels::ActiveKernels().pair_residuals(blocks.blocks.data(), blocks.block_reference.data(),
                                          static_cast<int>(blocks.blocks.size()),
                                          ToKernelPose<double>(pose), centres.data(), lanes.data());
  std::vector<double> residuals(problem.pairs.size());
  for (size_t i = 0; i < lanes.size(); ++i) {
    if (blocks.lane_pair[i] >= 0) {
      residuals[blocks.lane_pair[i]] = lanes[i];
    }
  }
  return residuals;
}

}  // namespace

Residuals ComputeResiduals(const PreparedProblem& problem, const SolverPose& pose,
                           ResidualKinds kinds) {
  Residuals residuals;
  if (kinds.points) residuals.points = PointResiduals(problem, pose);
  if (kinds.pairs) residuals.pairs = PairResiduals(problem, pose);
  return residuals;
}

}  // namespace raylift
