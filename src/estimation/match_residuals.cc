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

std::vector<double> ByMatch(const std::vector<double>& lanes, const std::vector<int>& match_of_lane,
                            size_t count) {
  std::vector<double> by_match(count);
  for (size_t i = 0; i < lanes.size(); ++i) {
    if (match_of_lane[i] >= 0) by_match[match_of_lane[i]] = lanes[i];
  }
  return by_match;
}

std::vector<double> PointResiduals(const PreparedProblem& problem, const SolverPose& pose) {
  const auto blocks = MakePointBlocks<double>(problem.points, AllIndices(problem.points.size()));
  std::vector<double> lanes(blocks.lane_point.size());
  ForEachCamera(
      0, static_cast<int>(blocks.blocks.size()),
      [&](int block) { return blocks.block_camera[block]; },
      [&](int camera, int first, int num_blocks) {
        kernels::ActiveKernels().point_residuals(
            &blocks.blocks[first], num_blocks,
            ToKernelPose<double>(problem.PoseOfCamera(pose, camera)),
            &lanes[static_cast<size_t>(first) * kernels::kLanes<double>]);
      });
  return ByMatch(lanes, blocks.lane_point, problem.points.size());
}

std::vector<double> PairResiduals(const PreparedProblem& problem, const SolverPose& pose) {
  const auto blocks = MakePairBlocks<double>(problem.pairs, AllIndices(problem.pairs.size()));
  const auto centers = CentersInCam<double>(problem, pose);
  std::vector<double> lanes(blocks.lane_pair.size());
  kernels::ActiveKernels().pair_residuals(blocks.blocks.data(), blocks.block_view.data(),
                                          static_cast<int>(blocks.blocks.size()),
                                          ToKernelPose<double>(pose), centers.data(), lanes.data());
  return ByMatch(lanes, blocks.lane_pair, problem.pairs.size());
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
