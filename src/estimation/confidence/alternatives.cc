// The poses beside the best one: is one of them as good an answer?

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/rng.h"
#include "estimation/confidence/confidence.h"
#include "estimation/ransac/ransac.h"
#include "estimation/ransac/samplers.h"
#include "estimation/ransac/scores.h"

#include "raylift/scene/pose_problem.h"

namespace raylift {
namespace {

// The problem without the matches of explained keypoints, and without those that cannot count: its
// 2D-3D matches, if they are scored and enough for a sample, else its 2D-2D matches.
PoseProblem Rest(const PoseProblem& problem, const NormalizedProblem& prepared,
                 const std::vector<bool>& explained, MatchSets scored) {
  PoseProblem rest;
  rest.name = problem.name;
  rest.query_camera = problem.query_camera;
  rest.other_cameras = problem.other_cameras;
  rest.references = problem.references;
  rest.priors = problem.priors;
  if (Has2D3D(scored)) {
    for (const NormalizedMatch2D3D& point : prepared.matches_2d3d) {
      if (explained[point.keypoint]) continue;
      Match2D3D match = problem.matches_2d3d[static_cast<size_t>(point.match)];
      match.match_2d2d.reset();
      rest.matches_2d3d.push_back(match);
    }
    if (rest.matches_2d3d.size() >= 3) return rest;
    rest.matches_2d3d.clear();
  }
  if (Has2D2D(scored)) {
    for (const NormalizedMatch2D2D& pair : prepared.matches_2d2d) {
      if (explained[pair.keypoint]) continue;
      rest.matches_2d2d.push_back(problem.matches_2d2d[static_cast<size_t>(pair.match)]);
    }
  }
  return rest;
}

// The probability that the first of two sets of keypoints beyond chance is the right one.
double ProbabilityOfLarger(double first, double second) {
  return first * first / (first * first + second * second);
}

}  // namespace

ExclusiveInliers::ExclusiveInliers(const std::vector<bool>& first,
                                   const std::vector<bool>& second) {
  for (size_t k = 0; k < first.size(); ++k) {
    only_first += first[k] && !second[k] ? 1 : 0;
    only_second += second[k] && !first[k] ? 1 : 0;
  }
}

std::optional<double> ExclusiveInliers::ProbabilityOfFirst(double clustering) const {
  const double all = (only_first + only_second) / clustering;
  if (!(all > 0)) return std::nullopt;
  const double z = (only_first - only_second) / clustering / std::sqrt(all);
  return 0.5 * std::erfc(-z / std::numbers::sqrt2);
}

bool ExplainTheSame(const InlierEvidence& a, const InlierEvidence& b) {
  int shared = 0;
  for (size_t k = 0; k < a.inlier.size(); ++k) shared += a.inlier[k] && b.inlier[k] ? 1 : 0;
  return 2 * shared > std::min(a.inlier_keypoints, b.inlier_keypoints);
}

bool InlierEvidence::LeavesRoomForAnAlternative() const {
  return inlier_keypoints > 0 &&
         ProbabilityOfLarger(inlier_keypoints, keypoints - inlier_keypoints) < kLocalizedConfidence;
}

double ProbabilityOverAlternative(const InlierEvidence& best, const InlierEvidence& alternative,
                                  bool beyond_chance, double log_odds) {
  const ExclusiveInliers exclusive(best.inlier, alternative.inlier);
  auto probability =
      exclusive.ProbabilityOfFirst(std::max(best.clustering, alternative.clustering));
  if (!probability) return 1;  // they explain the same
  if (beyond_chance) {
    probability =
        std::min(*probability, ProbabilityOfLarger(exclusive.only_first, exclusive.only_second));
  }
  const double against = 1 - *probability;
  return *probability / (*probability + against * std::exp(-log_odds));
}

std::optional<Rigid3> FindAlternative(const PoseProblem& problem, const NormalizedProblem& prepared,
                                      const std::vector<bool>& explained, MatchSets scored,
                                      const EstimatorOptions& options) {
  Rng rng(StreamSeed(options.seed, problem.name, "rival"));
  const NormalizedProblem rest(Rest(problem, prepared, explained, scored),
                               options.reprojection_threshold_px, options.sampson_threshold_px, rng,
                               options.point_sigma);
  const P3pSampler p3p(rest);
  const E5p1Sampler e5p1(rest);
  std::vector<RansacSolver> solvers;
  const bool by_2d3d = P3pSampler::CanSample(rest);
  if (by_2d3d) {
    solvers.push_back({&p3p, Solver::kP3p, MatchSets::k2D3D});
  } else if (E5p1Sampler::CanSample(rest)) {
    solvers.push_back({&e5p1, Solver::kE5p1, MatchSets::k2D2D});
  }
  const PoseScore pose_score(by_2d3d ? MatchSets::k2D3D : MatchSets::k2D2D,
                             ScoreCombination::kSumMsac, rest.num_matches_2d3d,
                             rest.num_matches_2d2d, options.refinement);
  RansacOptions few(options);
  few.max_iterations = std::min(options.max_iterations, kAlternativeSamples);
  few.min_iterations = 1;
  const RansacReport report = RunRansac(rest, pose_score, solvers, SolverSchedule::kAll, few, rng);
  if (!report.best) return std::nullopt;
  return rest.ToWorld(report.best->pose);
}

}  // namespace raylift
