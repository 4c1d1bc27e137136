#include "estimation/ransac/scores.h"

#include <algorithm>
#include <cmath>

#include "estimation/kernels/kernel_table.h"

namespace raylift {
namespace {

// So many blocks lie between two checks against the best score: enough to keep the reductions
// cheap.
constexpr int kBlocksPerCheck = 8;

// The score of the part of a set that has been seen. A match gains what it costs less than one.
struct PartialScore {
  int blocks = 0;
  double gain = 0;
  int inliers = 0;

  void Add(const kernels::KernelScore& part, int num_blocks) {
    blocks += num_blocks;
    gain += num_blocks * kernels::kLanes<float> - part.cost;
    inliers += part.inliers;
  }

  // Returns the score of the whole once all has been seen, and before that the best one that is
  // still likely: the blocks are in random order, so the part tells what the whole will be within
  // the spread of a count (four standard deviations), which is larger where matches come in
  // clusters.
  SetScore OfWhole(int num_matches, int num_blocks, double clustering) const {
    if (blocks == num_blocks) return {num_matches - gain, inliers};
    const double share = static_cast<double>(blocks) / num_blocks;
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

PoseScore::PoseScore(MatchSets sets, ScoreCombination combination, int num_2d3d, int num_2d2d,
                     Refinement refinement)
    : sets_(sets),
      combination_(combination),
      refinement_(refinement),
      num_2d3d_(num_2d3d),
      num_2d2d_(num_2d2d) {
  // A combination with an empty set says nothing (its product is always zero): use the other.
  if (sets_ == MatchSets::kBoth && num_2d3d == 0) sets_ = MatchSets::k2D2D;
  if (sets_ == MatchSets::kBoth && num_2d2d == 0) sets_ = MatchSets::k2D3D;
}

double PoseScore::Value(const SetScores& score) const {
  switch (sets_) {
    case MatchSets::k2D3D:
      return score.of_2d3d.cost + score.prior;
    case MatchSets::k2D2D:
      return score.of_2d2d.cost + score.prior;
    case MatchSets::kBoth:
      break;
  }
  switch (combination_) {
    case ScoreCombination::kSumInliers:
      return score.prior - (score.of_2d3d.inliers + score.of_2d2d.inliers);
    case ScoreCombination::kSumInlierRatios:
      return -((score.of_2d3d.inliers - score.prior) / num_2d3d_ +
               (score.of_2d2d.inliers - score.prior) / num_2d2d_);
    case ScoreCombination::kMultInliers:
      return -std::max(score.of_2d3d.inliers - score.prior, 0.0) *
             std::max(score.of_2d2d.inliers - score.prior, 0.0);
    case ScoreCombination::kSumMsac:
      return score.of_2d3d.cost + score.of_2d2d.cost + score.prior;
    case ScoreCombination::kMultMsac:
      if (refinement_ == Refinement::kPaper) {
        return (score.of_2d3d.cost + score.prior) * (score.of_2d2d.cost + score.prior);
      }
      // One match's worth is added to each factor: a set that a minimal sample fits exactly has a
      // cost of zero, which would make the product blind to the other set.
      return (score.of_2d3d.cost + score.prior + 1) * (score.of_2d2d.cost + score.prior + 1);
  }
  return 0;
}

Scorer::Scorer(const NormalizedProblem& problem, const PoseScore& pose_score)
    : problem_(problem), pose_score_(pose_score) {}

kernels::KernelScore Scorer::Score2D3D(const CamFromLocal& pose, int begin, int count) const {
  kernels::KernelScore score = {0, 0};
  ForEachCamera(
      begin, count, [&](int block) { return problem_.block_camera_2d3d[block]; },
      [&](int camera, int first, int num_blocks) {
        const kernels::KernelScore part = kernels::ActiveKernels().score_2d3d(
            &problem_.blocks_2d3d[first], num_blocks,
            ToKernelPose<float>(problem_.PoseOfCamera(pose, camera)));
        score.cost += part.cost;
        score.inliers += part.inliers;
      });
  return score;
}

std::optional<SetScores> Scorer::ScoreIfBetter(const CamFromLocal& pose, double best_value) const {
  const auto& kernel = kernels::ActiveKernels();
  const auto kernel_pose = ToKernelPose<float>(pose);
  // Matches that have not been scored yet are taken for the best that they may be.
  SetScores score;
  score.of_2d3d = {0, problem_.num_matches_2d3d};
  score.of_2d2d = {0, problem_.num_matches_2d2d};
  score.prior = problem_.priors.Cost(pose);

  // Looks at some more blocks of a set; false as soon as the whole cannot beat the best value.
  const auto look = [&](PartialScore& seen, SetScore& set, int num_matches, size_t num_blocks,
                        double clustering, const auto& score_blocks) {
    const int all = static_cast<int>(num_blocks);
    const int n = std::min(kBlocksPerCheck, all - seen.blocks);
    if (n > 0) seen.Add(score_blocks(seen.blocks, n), n);
    set = seen.OfWhole(num_matches, all, clustering);
    return pose_score_.Value(score) < best_value;
  };
  const auto score_2d3d = [&](int begin, int count) { return Score2D3D(pose, begin, count); };
  const auto centers = CentersInCam<float>(problem_, pose);
  const auto score_2d2d = [&](int begin, int count) {
    return kernel.score_2d2d(&problem_.blocks_2d2d[begin],
                             &problem_.block_camera_reference_2d2d[begin], count, kernel_pose,
                             centers.data());
  };
  const bool has_2d3d = Has2D3D(pose_score_.sets());
  const bool has_2d2d = Has2D2D(pose_score_.sets());
  const size_t blocks_2d3d = has_2d3d ? problem_.blocks_2d3d.size() : 0;
  const size_t blocks_2d2d = has_2d2d ? problem_.blocks_2d2d.size() : 0;
  // The sets are scored by turns: one that has not been looked at is taken to fit entirely, so that
  // the other alone rarely decides.
  PartialScore seen_2d3d, seen_2d2d;
  for (size_t i = 0; i <= std::max(blocks_2d3d, blocks_2d2d); i += kBlocksPerCheck) {
    if (has_2d3d &&
        !look(seen_2d3d, score.of_2d3d, problem_.num_matches_2d3d, blocks_2d3d, 1, score_2d3d)) {
      return std::nullopt;
    }
    if (has_2d2d && !look(seen_2d2d, score.of_2d2d, problem_.num_matches_2d2d, blocks_2d2d,
                          clustering_2d2d_, score_2d2d)) {
      return std::nullopt;
    }
  }
  return score;
}

SetScores Scorer::ScoreAll(const CamFromLocal& pose) const {
  const auto& kernel = kernels::ActiveKernels();
  const auto kernel_pose = ToKernelPose<float>(pose);
  const auto centers = CentersInCam<float>(problem_, pose);
  const int num_blocks_2d3d = static_cast<int>(problem_.blocks_2d3d.size());
  const int num_blocks_2d2d = static_cast<int>(problem_.blocks_2d2d.size());
  const kernels::KernelScore points = Score2D3D(pose, 0, num_blocks_2d3d);
  const auto pairs =
      kernel.score_2d2d(problem_.blocks_2d2d.data(), problem_.block_camera_reference_2d2d.data(),
                        num_blocks_2d2d, kernel_pose, centers.data());
  constexpr int kLanes = kernels::kLanes<float>;
  return {{points.cost + problem_.num_matches_2d3d - num_blocks_2d3d * kLanes, points.inliers},
          {pairs.cost + problem_.num_matches_2d2d - num_blocks_2d2d * kLanes, pairs.inliers},
          problem_.priors.Cost(pose)};
}

InlierCounts Scorer::CountInliers(const CamFromLocal& pose) const {
  const auto& kernel = kernels::ActiveKernels();
  const auto kernel_pose = ToKernelPose<float>(pose);
  const auto centers = CentersInCam<float>(problem_, pose);
  InlierCounts counts;
  counts.pose = pose;
  counts.of_2d3d = Score2D3D(pose, 0, static_cast<int>(problem_.blocks_2d3d.size())).inliers;
  counts.of_2d2d.assign(problem_.num_camera_references(), 0);
  double sum = 0;
  double squares = 0;
  for (size_t i = 0; i < problem_.blocks_2d2d.size(); ++i) {
    const int inliers =
        kernel
            .score_2d2d(&problem_.blocks_2d2d[i], &problem_.block_camera_reference_2d2d[i], 1,
                        kernel_pose, centers.data())
            .inliers;
    counts.of_2d2d[problem_.block_camera_reference_2d2d[i]] += inliers;
    sum += inliers;
    squares += inliers * inliers;
  }
  // Poisson's variance of counts is their mean.
  const double blocks = static_cast<double>(problem_.blocks_2d2d.size());
  if (sum > 0) counts.clustering_2d2d = std::max(1.0, (squares - sum * sum / blocks) / sum);
  return counts;
}

}  // namespace raylift
