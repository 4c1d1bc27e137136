// Compares a pose with its alternatives, and looks for one in the matches that it does not explain.

#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/rng.h"
#include "estimation/confidence/confidence.h"
#include "estimation/problem/repeats.h"
#include "estimation/ransac/ransac.h"
#include "estimation/ransac/samplers.h"
#include "estimation/ransac/scores.h"

#include "raylift/scene/pose_problem.h"

namespace raylift {
namespace {

// Returns the matches of the reference that most of them are of; all matches if none has two
// samples.
std::vector<int> OfOneReference(const PoseProblem& problem, const std::vector<int>& matches_2d3d) {
  std::vector<std::vector<int>> by_reference(problem.references.size());
  for (const int i : matches_2d3d) {
    const std::optional<size_t> reference = ReferenceOf(problem, static_cast<size_t>(i));
    if (reference) by_reference[*reference].push_back(i);
  }
  const auto largest =
      std::max_element(by_reference.begin(), by_reference.end(),
                       [](const auto& a, const auto& b) { return a.size() < b.size(); });
  return largest != by_reference.end() && largest->size() >= 6 ? *largest : matches_2d3d;
}

// Returns the problem without the explained matches, and without those that cannot count: its 2D-3D
// matches, if they are scored and enough for a sample, else its 2D-2D matches. Of the 2D-3D matches
// it has only one reference's: these agree on another answer where those of others may not.
PoseProblem Rest(const PoseProblem& problem, const NormalizedProblem& normalized,
                 const std::vector<bool>& explained, MatchSets scored) {
  PoseProblem rest;
  rest.name = problem.name;
  rest.query_camera = problem.query_camera;
  rest.other_cameras = problem.other_cameras;
  rest.references = problem.references;
  rest.priors = problem.priors;
  size_t index = 0;
  if (Has2D3D(scored)) {
    std::vector<int> left;
    for (const NormalizedMatch2D3D& point : normalized.matches_2d3d) {
      if (!explained[index++]) left.push_back(point.match);
    }
    for (const int i : OfOneReference(problem, left)) {
      rest.matches_2d3d.push_back(problem.matches_2d3d[static_cast<size_t>(i)]);
      rest.matches_2d3d.back().match_2d2d.reset();
    }
    if (rest.matches_2d3d.size() >= 3) return rest;
    rest.matches_2d3d.clear();
  }
  if (Has2D2D(scored)) {
    for (const NormalizedMatch2D2D& pair : normalized.matches_2d2d) {
      if (explained[index++]) continue;
      rest.matches_2d2d.push_back(problem.matches_2d2d[static_cast<size_t>(pair.match)]);
    }
  }
  return rest;
}

}  // namespace

std::optional<double> ExclusiveInliers::ProbabilityOfFirst(double clustering) const {
  const double all = (only_first + only_second) / clustering;
  if (!(all > 0)) return std::nullopt;
  const double z = (only_first - only_second) / clustering / std::sqrt(all);
  return 0.5 * std::erfc(-z / std::numbers::sqrt2);
}

double ProbabilityOfLarger(double first, double second) {
  return first * first / (first * first + second * second);
}

bool InlierEvidence::LeavesRoomForAnAlternative() const {
  const auto inliers = static_cast<double>(std::count(inlier.begin(), inlier.end(), true));
  return inliers > 0 && ProbabilityOfLarger(inliers, static_cast<double>(inlier.size()) - inliers) <
                            kLocalizedConfidence;
}

double ProbabilityOverAlternative(const ExclusiveInliers& exclusive, double clustering,
                                  bool beyond_chance, double log_odds) {
  auto probability = exclusive.ProbabilityOfFirst(clustering);
  if (!probability) return 1;  // they explain the same
  if (beyond_chance) {
    const double first = exclusive.only_first, second = exclusive.only_second;
    const bool are_places = std::min(first, second) >= kOnePlace * (first + second);
    probability = are_places ? 0.5 : std::min(*probability, ProbabilityOfLarger(first, second));
  }
  const double against = 1 - *probability;
  return *probability / (*probability + against * std::exp(-log_odds));
}

std::optional<Rigid3> FindAlternative(const PoseProblem& problem,
                                      const NormalizedProblem& normalized,
                                      const std::vector<bool>& explained, MatchSets scored,
                                      const EstimatorOptions& options) {
  Rng rng(StreamSeed(options.seed, problem.name, "rival"));
  const NormalizedProblem rest(Rest(problem, normalized, explained, scored),
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
