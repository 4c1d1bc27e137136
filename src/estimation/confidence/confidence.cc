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

// A pose that may be right in place of the assessed one.
struct Alternative {
  CamFromLocal pose;
  InlierEvidence evidence;
  double probability_of_assessed = 1;  // where one of the two is right

  // Returns its odds against the assessed pose.
  double Odds() const {
    constexpr double kLeast = 1e-6;
    return (1 - probability_of_assessed) / std::max(probability_of_assessed, kLeast);
  }
};

// Returns the alternatives, the likeliest first; of those that are one answer, or at one place, the
// likeliest alone.
std::vector<Alternative> EachOnce(const InlierAssessor& assessor,
                                  std::vector<Alternative> alternatives) {
  std::stable_sort(alternatives.begin(), alternatives.end(),
                   [](const Alternative& a, const Alternative& b) { return a.Odds() > b.Odds(); });
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

// Asks, one after the other, what a pose may be wrong by.
class Assessment {
 public:
  Assessment(const PoseProblem& problem, const NormalizedProblem& normalized,
             const AssessedPose& assessed, const EstimatorOptions& options)
      : problem_(problem),
        normalized_(normalized),
        assessed_(assessed),
        options_(options),
        drawn_by_prior_(assessed.solver == Solver::kKnownCenter ||
                        assessed.solver == Solver::kUpright),
        assessor_(problem, normalized, assessed.scored, assessed.num_poses_tried,
                  drawn_by_prior_ ? 2 : 3),
        evidence_(assessor_.Assess(assessed.pose)),
        log_prior_(normalized.priors.LogEvidence(assessed.pose)),
        distance_(SceneDistance(normalized, assessed.pose, assessed.scored)) {}

  const InlierEvidence& evidence() const { return evidence_; }

  // Returns the probability that neither chance nor one thing that is wrong explains the inliers.
  double OfInliers() const {
    double confidence = ProbabilityOfNoChance(evidence_.log_false_alarms);
    // Agreement with the priors speaks for a pose that neither was drawn by them nor is of matches
    // that were looked for there; a pose that contradicts them is doubtful, but remains a pose.
    if (log_prior_ < 0 || !(drawn_by_prior_ || problem_.search_area_px2)) {
      confidence = std::max(ProbabilityOfNoChance(evidence_.log_false_alarms - log_prior_),
                            std::min(confidence, kLeastConfidence));
    }
    // Inliers on a smaller part of what is matched are one witness; where points disagree, pose or
    // geometry are wrong, and nothing tells which.
    const bool is_one_place = assessor_.ShareNearInliers(evidence_) < kOnePlace;
    const bool is_contradicted =
        assessor_.PointsDisagree(evidence_) &&
        !DepthsAgreeUpToFactor(normalized_, assessed_.pose, distance_, evidence_);
    return is_one_place || is_contradicted ? std::min(confidence, 0.5) : confidence;
  }

  // Returns the poses that may be right in place of this one, the likeliest first.
  std::vector<Alternative> FindAlternatives() const {
    std::vector<CamFromLocal> poses = assessed_.alternatives;
    if (options_.refinement == Refinement::kRobust && evidence_.LeavesRoomForAnAlternative()) {
      const auto found =
          FindAlternative(problem_, normalized_, evidence_.inlier, assessed_.scored, options_);
      if (found) poses.push_back(normalized_.ToLocal(*found));
    }
    std::vector<Alternative> alternatives;
    for (const CamFromLocal& pose : poses) {
      const InlierEvidence other = assessor_.Assess(pose);
      const std::optional<ExclusiveInliers> exclusive = assessor_.Compare(evidence_, other);
      if (!exclusive) continue;
      const double log_odds = log_prior_ - normalized_.priors.LogEvidence(pose);
      const double probability =
          ProbabilityOverAlternative(*exclusive, std::max(evidence_.clustering, other.clustering),
                                     assessor_.IsBeyondChance(other, *exclusive), log_odds);
      alternatives.push_back({pose, other, probability});
    }
    return EachOnce(assessor_, std::move(alternatives));
  }

  // Returns the probability that the position is right where the direction is.
  double OfPosition(const std::optional<MatchNoise>& noise) const {
    const double of_position = ProbabilityOfPosition(assessed_.position_sigma, distance_);
    if (!Has2D2D(assessed_.scored)) return of_position;
    DepthScale scale;
    if (noise) {
      scale.depth_sigma = std::hypot(std::hypot(noise->depth, noise->common_depth),
                                     MedianLearnedSigma(problem_, normalized_, evidence_.inlier));
    }
    const std::optional<SceneNoise> known = KnownNoiseOf(normalized_, options_);
    if (known && known->reference_factor.errors > 0) {
      scale.known_sigma = known->reference_factor.sigma;
    }
    return std::min(of_position,
                    ProbabilityOfDistance(normalized_, assessed_.pose, assessed_.scored, distance_,
                                          scale, evidence_));
  }

 private:
  const PoseProblem& problem_;
  const NormalizedProblem& normalized_;
  const AssessedPose& assessed_;
  const EstimatorOptions& options_;
  const bool drawn_by_prior_;
  const InlierAssessor assessor_;
  const InlierEvidence evidence_;
  const double log_prior_;
  const double distance_;  // to the scene
};

}  // namespace

void AssessConfidence(const PoseProblem& problem, const NormalizedProblem& normalized,
                      const AssessedPose& assessed, const EstimatorOptions& options,
                      PoseEstimate& estimate) {
  const Assessment assessment(problem, normalized, assessed, options);
  estimate.num_keypoints = assessment.evidence().keypoints;
  estimate.inlier_keypoints = assessment.evidence().inlier_keypoints;
  const double of_inliers = assessment.OfInliers();
  const double of_position = assessment.OfPosition(estimate.noise);
  const std::vector<Alternative> alternatives = assessment.FindAlternatives();
  const double over_likeliest =
      alternatives.empty() ? 1 : alternatives.front().probability_of_assessed;
  // The probability of the pose and its alternatives, over the pose's.
  double all = 1;
  for (const Alternative& alternative : alternatives) all += alternative.Odds();
  // Several weak alternatives leave a pose.
  const double over_alternatives = std::max(1 / all, std::min(over_likeliest, kLeastConfidence));
  Conclude(of_inliers, of_position, estimate);
  // Pose k is right with the probability odds_k / all, times the confidence that all else leaves.
  estimate.alternatives.clear();
  if (over_alternatives < kLocalizedConfidence) {
    for (const Alternative& alternative : alternatives) {
      estimate.alternatives.push_back(
          {normalized.ToWorld(alternative.pose), estimate.confidence * alternative.Odds() / all});
    }
  }
  Conclude(std::min(of_inliers, over_alternatives), of_position, estimate);
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
