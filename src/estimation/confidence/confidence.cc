#include "estimation/confidence/confidence.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "base/statistics.h"
#include "estimation/problem/observations.h"
#include "estimation/problem/repeats.h"
#include "estimation/ransac/ransac.h"
#include "estimation/refinement/refinement.h"

#include "raylift/scene/pose_problem.h"

namespace raylift {
namespace {

// Returns 1 / (1 + NFA).
double ProbabilityOfNoChance(double log_false_alarms) {
  return 1 / (1 + std::exp(std::min(log_false_alarms, 700.0)));
}

// Returns the median standard deviation that was learned of the depths of 2D-2D inliers, 0 where
// none was. `inlier` is of the points, if these are scored, and the 2D-2D matches.
double MedianLearnedSigma(const PoseProblem& original, const NormalizedProblem& problem,
                          const std::vector<bool>& inlier) {
  const size_t first_pair = inlier.size() - problem.matches_2d2d.size();
  std::vector<bool> is_inlier(original.matches_2d2d.size(), false);
  for (size_t i = 0; i < problem.matches_2d2d.size(); ++i) {
    is_inlier[static_cast<size_t>(problem.matches_2d2d[i].match)] = inlier[first_pair + i];
  }
  std::vector<double> sigmas;
  for (const NormalizedMatch2D3D& point : problem.matches_2d3d) {
    const double sigma = LearnedDepthSigma(original, point);
    if (!(sigma > 0)) continue;
    const std::optional<size_t> pair = PairOf(original, static_cast<size_t>(point.match));
    if (pair && is_inlier[*pair]) sigmas.push_back(sigma);
  }
  return UpperMedianOr(std::move(sigmas), 0);
}

// A pose that may be right in place of the assessed one, against which it has these odds.
struct Alternative {
  CamFromLocal pose;
  InlierEvidence evidence;
  double odds = 0;
};

// Returns the alternatives, the likeliest first; of those that are one answer, or at one place, the
// likeliest alone.
std::vector<Alternative> EachOnce(const InlierAssessor& assessor,
                                  std::vector<Alternative> alternatives) {
  std::stable_sort(alternatives.begin(), alternatives.end(),
                   [](const Alternative& a, const Alternative& b) { return a.odds > b.odds; });
  std::vector<Alternative> kept;
  for (Alternative& alternative : alternatives) {
    const bool is_other = std::all_of(kept.begin(), kept.end(), [&](const Alternative& other) {
      return AreApart(other.pose, alternative.pose) &&
             assessor.Compare(other.evidence, alternative.evidence);
    });
    if (is_other) kept.push_back(std::move(alternative));
  }
  return kept;
}

}  // namespace

void AssessConfidence(const PoseProblem& problem, const NormalizedProblem& normalized,
                      const AssessedPose& assessed, const EstimatorOptions& options,
                      PoseEstimate& estimate) {
  const bool drawn_by_prior =
      assessed.solver == Solver::kKnownCenter || assessed.solver == Solver::kUpright;
  const InlierAssessor assessor(problem, normalized, assessed.scored, assessed.num_poses_tried,
                                drawn_by_prior ? 2 : 3);
  const InlierEvidence evidence = assessor.Assess(assessed.pose);
  estimate.num_keypoints = evidence.keypoints;
  estimate.inlier_keypoints = evidence.inlier_keypoints;

  // Agreement with the priors speaks for a pose that was not drawn by them; a pose that contradicts
  // them is doubtful, but remains a pose.
  double confidence = ProbabilityOfNoChance(evidence.log_false_alarms);
  const double log_prior = normalized.priors.LogEvidence(assessed.pose);
  if (log_prior < 0 || !drawn_by_prior) {
    confidence = std::max(ProbabilityOfNoChance(evidence.log_false_alarms - log_prior),
                          std::min(confidence, kLeastConfidence));
  }

  std::vector<CamFromLocal> poses = assessed.alternatives;
  if (options.refinement == Refinement::kRobust && evidence.LeavesRoomForAnAlternative()) {
    const auto found =
        FindAlternative(problem, normalized, evidence.inlier, assessed.scored, options);
    if (found) poses.push_back(normalized.ToLocal(*found));
  }
  std::vector<Alternative> alternatives;
  double least = 1;
  for (const CamFromLocal& pose : poses) {
    const InlierEvidence other = assessor.Assess(pose);
    const std::optional<ExclusiveInliers> exclusive = assessor.Compare(evidence, other);
    if (!exclusive) continue;
    const double log_odds = log_prior - normalized.priors.LogEvidence(pose);
    const double probability =
        ProbabilityOverAlternative(*exclusive, std::max(evidence.clustering, other.clustering),
                                   assessor.IsBeyondChance(other, *exclusive), log_odds);
    constexpr double kLeast = 1e-6;
    least = std::min(least, probability);
    alternatives.push_back({pose, other, (1 - probability) / std::max(probability, kLeast)});
  }
  alternatives = EachOnce(assessor, std::move(alternatives));
  // The probability of the pose and its alternatives, over the pose's.
  double all = 1;
  for (const Alternative& alternative : alternatives) all += alternative.odds;
  // Several weak alternatives leave a pose.
  const double over_alternatives = std::max(1 / all, std::min(least, kLeastConfidence));
  // Inliers on a smaller part of what is matched are one witness.
  if (assessor.Spread(evidence) < kOnePlace) confidence = std::min(confidence, 0.5);

  const double distance = SceneDistance(normalized, assessed.pose, assessed.scored);
  // Pose or geometry are wrong, and nothing tells which.
  if (assessor.PointsDisagree(evidence) &&
      !DepthsAgreeUpToFactor(normalized, assessed.pose, distance, evidence)) {
    confidence = std::min(confidence, 0.5);
  }
  double of_position = ProbabilityOfPosition(assessed.position_sigma, distance);
  if (Has2D2D(assessed.scored)) {
    DepthScale scale;
    if (estimate.noise) {
      scale.depth_sigma =
          std::hypot(std::hypot(estimate.noise->depth, estimate.noise->common_depth),
                     MedianLearnedSigma(problem, normalized, evidence.inlier));
    }
    const std::optional<SceneNoise> known = KnownNoiseOf(normalized, options);
    if (known && known->reference_factor.errors > 0) {
      scale.known_sigma = known->reference_factor.sigma;
    }
    of_position =
        std::min(of_position, ProbabilityOfDistance(normalized, assessed.pose, assessed.scored,
                                                    distance, scale, evidence));
  }
  Conclude(confidence, of_position, estimate);
  // Pose k is right with the probability odds_k / all, times the confidence that all else leaves.
  estimate.alternatives.clear();
  if (over_alternatives < kLocalizedConfidence) {
    for (const Alternative& alternative : alternatives) {
      estimate.alternatives.push_back(
          {normalized.ToWorld(alternative.pose), estimate.confidence * alternative.odds / all});
    }
  }
  Conclude(std::min(confidence, over_alternatives), of_position, estimate);
}

void SortByProbability(std::vector<AlternativePose>& alternatives) {
  std::stable_sort(alternatives.begin(), alternatives.end(),
                   [](const AlternativePose& a, const AlternativePose& b) {
                     return a.probability > b.probability;
                   });
}

void Conclude(double confidence, double of_position, PoseEstimate& estimate) {
  estimate.confidence = std::min(confidence, std::max(kLeastConfidence, of_position));
  estimate.verdict = estimate.confidence >= kLocalizedConfidence ? PoseVerdict::kLocalized
                                                                 : PoseVerdict::kDoubtful;
}

}  // namespace raylift
