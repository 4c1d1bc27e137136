#include "estimation/joint_score.h"

#include <algorithm>
#include <cmath>

#include "estimation/kernels/kernel_table.h"

namespace raylift {
namespace {

// Between two checks against the best score: long enough to keep the reductions cheap.
constexpr int kBlocksPerCheck = 8;

// The score of the part of a set that has been seen. A match gains what it costs less than one.
struct PartialScore {
  double gain = 0;
  int inliers = 0;

  // The best score of the whole that is still likely: the blocks are in random order, so the part
  // tells what the whole will be within the spread of a count (four standard deviations), which is
  // larger where matches come in clusters.
  SetScore Optimiztic(int num_matches, double share, double clustering) const {
    const auto whole = [num_matches, share, clustering](double part) {
      return std::min<double>(num_matches, (part + 4 * std::sqrt(clustering * (part + 1))) / share);
    };
    return {num_matches - std::min(whole(gain), gain + (1 - share) * num_matches + kSlack),
            static_cast<int>(whole(inliers))};
  }

  // Blocks are not filled evenly.
  static constexpr double kSlack = 2 * kernels::kLanes<float>;
};

}  // namespace

Objective::Objective(Sets sets, ScoreCombination combination, int num_points, int num_pairs,
                     Refinement refinement)
    : sets_(sets),
      combination_(combination),
      refinement_(refinement),
      num_points_(num_points),
      num_pairs_(num_pairs) {
  // A combination with an empty set says nothing (its product is always zero): use the other.
  if (sets_ == Sets::kBoth && num_points == 0) sets_ = Sets::kPairs;
  if (sets_ == Sets::kBoth && num_pairs == 0) sets_ = Sets::kPoints;
}

double Objective::Value(const JointScore& score) const {
  switch (sets_) {
    case Sets::kPoints:
      return score.points.cost + score.prior;
    case Sets::kPairs:
      return score.pairs.cost + score.prior;
    case Sets::kBoth:
      break;
  }
  switch (combination_) {
    case ScoreCombination::kSumInliers:
      return score.prior - (score.points.inliers + score.pairs.inliers);
    case ScoreCombination::kSumInlierRatios:
      return -((score.points.inliers - score.prior) / num_points_ +
               (score.pairs.inliers - score.prior) / num_pairs_);
    case ScoreCombination::kMultInliers:
      return -std::max(score.points.inliers - score.prior, 0.0) *
             std::max(score.pairs.inliers - score.prior, 0.0);
    case ScoreCombination::kSumMsac:
      return score.points.cost + score.pairs.cost + score.prior;
    case ScoreCombination::kMultMsac:
      if (refinement_ == Refinement::kPaper) {
        return (score.points.cost + score.prior) * (score.pairs.cost + score.prior);
      }
      // One match's worth is added to each factor: a set that a minimal sample fits exactly has a
      // cost of zero, which would make the product blind to the other set.
      return (score.points.cost + score.prior + 1) * (score.pairs.cost + score.prior + 1);
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
std::vector<T> CentersInCam(const PreparedProblem& problem, const SolverPose& pose) {
  const size_t num_references = problem.centers.size();
  std::vector<T> centers(3 * problem.num_views());
  for (size_t i = 0; i < num_references; ++i) {
    const Eigen::Vector3d from_query = pose.rotation * problem.centers[i] + pose.translation;
    for (size_t camera = 0; camera < problem.camera_centers.size(); ++camera) {
      const Eigen::Vector3d center = from_query - problem.camera_centers[camera];
      T* of_view = &centers[3 * (camera * num_references + i)];
      for (int k = 0; k < 3; ++k) of_view[k] = static_cast<T>(center[k]);
    }
  }
  return centers;
}
template std::vector<float> CentersInCam<float>(const PreparedProblem&, const SolverPose&);
template std::vector<double> CentersInCam<double>(const PreparedProblem&, const SolverPose&);

Scorer::Scorer(const PreparedProblem& problem, const Objective& objective)
    : problem_(problem), objective_(objective) {}

kernels::KernelScore Scorer::ScorePoints(const SolverPose& pose, int begin, int count) const {
  kernels::KernelScore score = {0, 0};
  ForEachCamera(
      begin, count, [&](int block) { return problem_.point_block_camera[block]; },
      [&](int camera, int first, int num_blocks) {
        const kernels::KernelScore part = kernels::ActiveKernels().score_points(
            &problem_.point_blocks[first], num_blocks,
            ToKernelPose<float>(problem_.PoseOfCamera(pose, camera)));
        score.cost += part.cost;
        score.inliers += part.inliers;
      });
  return score;
}

std::optional<JointScore> Scorer::ScoreIfBetter(const SolverPose& pose, double best_value) const {
  const auto& kernel = kernels::ActiveKernels();
  const auto kernel_pose = ToKernelPose<float>(pose);
  // What has not been scored yet is taken for the best that it may be.
  JointScore score;
  score.points = {0, problem_.num_matches_2d3d};
  score.pairs = {0, problem_.num_matches_2d2d};
  score.prior = problem_.priors.Cost(pose);

  // Scores a set block by block; false as soon as the whole cannot beat the best value any more.
  const auto scan = [&](SetScore& set, int num_matches, int num_blocks, double clustering,
                        const auto& score_blocks) {
    PartialScore partial;
    for (int i = 0; i < num_blocks; i += kBlocksPerCheck) {
      const int n = std::min(kBlocksPerCheck, num_blocks - i);
      const kernels::KernelScore part = score_blocks(i, n);
      partial.gain += n * kernels::kLanes<float> - part.cost;
      partial.inliers += part.inliers;
      set = partial.Optimiztic(num_matches, static_cast<double>(i + n) / num_blocks, clustering);
      if (objective_.Value(score) >= best_value) {
        return false;
      }
    }
    set = {num_matches - partial.gain, partial.inliers};
    return objective_.Value(score) < best_value;
  };

  if (objective_.UsesPoints()) {
    const auto score_blocks = [&](int begin, int count) { return ScorePoints(pose, begin, count); };
    if (!scan(score.points, problem_.num_matches_2d3d,
              static_cast<int>(problem_.point_blocks.size()), 1, score_blocks)) {
      return std::nullopt;
    }
  }
  if (objective_.UsesPairs()) {
    const auto centers = CentersInCam<float>(problem_, pose);
    const auto score_blocks = [&](int begin, int count) {
      return kernel.score_pairs(&problem_.pair_blocks[begin], &problem_.pair_block_view[begin],
                                count, kernel_pose, centers.data());
    };
    if (!scan(score.pairs, problem_.num_matches_2d2d, static_cast<int>(problem_.pair_blocks.size()),
              pair_clustering_, score_blocks)) {
      return std::nullopt;
    }
  }
  return score;
}

JointScore Scorer::ScoreAll(const SolverPose& pose) const {
  const auto& kernel = kernels::ActiveKernels();
  const auto kernel_pose = ToKernelPose<float>(pose);
  const auto centers = CentersInCam<float>(problem_, pose);
  const int num_point_blocks = static_cast<int>(problem_.point_blocks.size());
  const int num_pair_blocks = static_cast<int>(problem_.pair_blocks.size());
  const kernels::KernelScore points = ScorePoints(pose, 0, num_point_blocks);
  const auto pairs =
      kernel.score_pairs(problem_.pair_blocks.data(), problem_.pair_block_view.data(),
                         num_pair_blocks, kernel_pose, centers.data());
  constexpr int kLanes = kernels::kLanes<float>;
  return {{points.cost + problem_.num_matches_2d3d - num_point_blocks * kLanes, points.inliers},
          {pairs.cost + problem_.num_matches_2d2d - num_pair_blocks * kLanes, pairs.inliers},
          problem_.priors.Cost(pose)};
}

InlierCounts Scorer::CountInliers(const SolverPose& pose) const {
  const auto& kernel = kernels::ActiveKernels();
  const auto kernel_pose = ToKernelPose<float>(pose);
  const auto centers = CentersInCam<float>(problem_, pose);
  InlierCounts counts;
  counts.pose = pose;
  counts.points = ScorePoints(pose, 0, static_cast<int>(problem_.point_blocks.size())).inliers;
  counts.pairs.assign(problem_.num_views(), 0);
  double sum = 0;
  double squares = 0;
  for (size_t i = 0; i < problem_.pair_blocks.size(); ++i) {
    const int inliers = kernel
                            .score_pairs(&problem_.pair_blocks[i], &problem_.pair_block_view[i], 1,
                                         kernel_pose, centers.data())
                            .inliers;
    counts.pairs[problem_.pair_block_view[i]] += inliers;
    sum += inliers;
    squares += inliers * inliers;
  }
  // Of counts with this mean, Poisson's variance is the mean.
  const double blocks = static_cast<double>(problem_.pair_blocks.size());
  if (sum > 0) counts.pair_clustering = std::max(1.0, (squares - sum * sum / blocks) / sum);
  return counts;
}

}  // namespace raylift
