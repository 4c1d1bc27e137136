#include "estimation/joint_score.h"

#include <algorithm>

#include "estimation/kernels/kernel_table.h"

namespace raylift {
namespace {

// Between two checks against the best score: long enough to keep the reductions cheap.
constexpr int kBlocksPerCheck = 8;

}  // namespace

Objective::Objective(Sets sets, ScoreCombination combination, int num_points, int num_pairs)
    : sets_(sets), combination_(combination), num_points_(num_points), num_pairs_(num_pairs) {
  // A combination with an empty set says nothing (its product is always zero): use the other.
  if (sets_ == Sets::kBoth && num_points == 0) sets_ = Sets::kPairs;
  if (sets_ == Sets::kBoth && num_pairs == 0) sets_ = Sets::kPoints;
}

double Objective::Value(const JointScore& score) const {
  switch (sets_) {
    case Sets::kPoints:
      return score.points.cost;
    case Sets::kPairs:
      return score.pairs.cost;
    case Sets::kBoth:
      break;
  }
  switch (combination_) {
    case ScoreCombination::kSumInliers:
      return -static_cast<double>(score.points.inliers + score.pairs.inliers);
    case ScoreCombination::kSumInlierRatios:
      return -(score.points.inliers / num_points_ + score.pairs.inliers / num_pairs_);
    case ScoreCombination::kMultInliers:
      return -static_cast<double>(score.points.inliers) * score.pairs.inliers;
    case ScoreCombination::kSumMsac:
      return score.points.cost + score.pairs.cost;
    case ScoreCombination::kMultMsac:
      // One match's worth is added to each factor: a set that a minimal sample fits exactly has a
      // cost of zero, which would make the product blind to the other set.
      return (score.points.cost + 1) * (score.pairs.cost + 1);
  }
  return 0;
}

template <typename T>
kernels::KernelPose<T> ToKernelPose(const SolverPose& pose) {
  kernels::KernelPose<T> result;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) {
      result.rotation[3 * r + c] = static_cast<T>(pose.rotation(r, c));
    }
    result.translation[r] = static_cast<T>(pose.translation[r]);
  }
  return result;
}
template kernels::KernelPose<float> ToKernelPose<float>(const SolverPose&);
template kernels::KernelPose<double> ToKernelPose<double>(const SolverPose&);

template <typename T>
std::vector<T> CentresInCam(const PreparedProblem& problem, const SolverPose& pose) {
  std::vector<T> centres(3 * problem.centres.size());
  for (size_t i = 0; i < problem.centres.size(); ++i) {
    const Eigen::Vector3d centre = pose.rotation * problem.centres[i] + pose.translation;
    for (int k = 0; k < 3; ++k) {
      centres[3 * i + k] = static_cast<T>(centre[k]);
    }
  }
  return centres;
}
template std::vector<float> CentresInCam<float>(const PreparedProblem&, const SolverPose&);
template std::vector<double> CentresInCam<double>(const PreparedProblem&, const SolverPose&);

Scorer::Scorer(const PreparedProblem& problem, const Objective& objective)
    : problem_(problem), objective_(objective) {}

std::optional<JointScore> Scorer::ScoreIfBetter(const SolverPose& pose, double best_value) const {
  const auto& kernel = kernels::ActiveKernels();
  const auto kernel_pose = ToKernelPose<float>(pose);
  // Starts from the best that is possible and takes away what the blocks show.
  JointScore score;
  score.points.inliers = problem_.num_matches_2d3d;
  score.pairs.inliers = problem_.num_matches_2d2d;

  // Every lane that does not count costs one; unused lanes are given back, and matches that were
  // left out of the blocks are added, before the first block.
  const auto take = [](SetScore& set, const kernels::KernelScore& part, int lanes) {
    set.cost += part.cost;
    set.inliers -= lanes - part.inliers;
  };
  const auto begin_set = [](SetScore& set, int num_matches, size_t num_blocks) {
    const int lanes = static_cast<int>(num_blocks) * kernels::kLanes<float>;
    set.cost = num_matches - lanes;
    set.inliers = lanes;
  };
  const auto optimistic = [this](const JointScore& s) {
    JointScore bound = s;
    bound.points.cost = std::max(bound.points.cost, 0.0);
    bound.pairs.cost = std::max(bound.pairs.cost, 0.0);
    bound.points.inliers = std::min(bound.points.inliers, problem_.num_matches_2d3d);
    bound.pairs.inliers = std::min(bound.pairs.inliers, problem_.num_matches_2d2d);
    return objective_.Value(bound);
  };

  if (objective_.UsesPoints()) {
    const int count = static_cast<int>(problem_.point_blocks.size());
    begin_set(score.points, problem_.num_matches_2d3d, problem_.point_blocks.size());
    for (int i = 0; i < count; i += kBlocksPerCheck) {
      const int n = std::min(kBlocksPerCheck, count - i);
      take(score.points, kernel.score_points(&problem_.point_blocks[i], n, kernel_pose),
           n * kernels::kLanes<float>);
      if (optimistic(score) >= best_value) {
        return std::nullopt;
      }
    }
  }
  if (objective_.UsesPairs()) {
    const int count = static_cast<int>(problem_.pair_blocks.size());
    begin_set(score.pairs, problem_.num_matches_2d2d, problem_.pair_blocks.size());
    const auto centres = CentresInCam<float>(problem_, pose);
    for (int i = 0; i < count; i += kBlocksPerCheck) {
      const int n = std::min(kBlocksPerCheck, count - i);
      take(score.pairs,
           kernel.score_pairs(&problem_.pair_blocks[i], &problem_.pair_block_reference[i], n,
                              kernel_pose, centres.data()),
           n * kernels::kLanes<float>);
      if (optimistic(score) >= best_value) {
        return std::nullopt;
      }
    }
  }
  if (objective_.Value(score) >= best_value) {
    return std::nullopt;
  }
  return score;
}

JointScore Scorer::ScoreAll(const SolverPose& pose) const {
  const auto& kernel = kernels::ActiveKernels();
  const auto kernel_pose = ToKernelPose<float>(pose);
  const auto centres = CentresInCam<float>(problem_, pose);
  const int num_point_blocks = static_cast<int>(problem_.point_blocks.size());
  const int num_pair_blocks = static_cast<int>(problem_.pair_blocks.size());
  const auto points =
      kernel.score_points(problem_.point_blocks.data(), num_point_blocks, kernel_pose);
  const auto pairs =
      kernel.score_pairs(problem_.pair_blocks.data(), problem_.pair_block_reference.data(),
                         num_pair_blocks, kernel_pose, centres.data());
  constexpr int kLanes = kernels::kLanes<float>;
  return {{points.cost + problem_.num_matches_2d3d - num_point_blocks * kLanes, points.inliers},
          {pairs.cost + problem_.num_matches_2d2d - num_pair_blocks * kLanes, pairs.inliers}};
}

}  // namespace raylift
