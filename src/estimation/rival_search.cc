#include "estimation/rival_search.h"

#include <algorithm>

#include "base/rng.h"
#include "estimation/hypothesis_generators.h"
#include "estimation/joint_score.h"
#include "estimation/ransac.h"

namespace raylift {
namespace {

// The problem without the matches of explained keypoints, and without those that cannot count: its
// 2D-3D matches, if they are scored and enough for a sample, else its 2D-2D matches.
PoseProblem Rest(const PoseProblem& problem, const PreparedProblem& prepared,
                 const std::vector<bool>& explained, ResidualKinds scored) {
  PoseProblem rest;
  rest.name = problem.name;
  rest.query_camera = problem.query_camera;
  rest.other_cameras = problem.other_cameras;
  rest.references = problem.references;
  rest.priors = problem.priors;
  if (scored.points) {
    for (const PreparedPoint& point : prepared.points) {
      if (explained[point.keypoint]) continue;
      Match2D3D match = problem.matches_2d3d[static_cast<size_t>(point.match)];
      match.match_2d2d.reset();
      rest.matches_2d3d.push_back(match);
    }
    if (rest.matches_2d3d.size() >= 3) return rest;
    rest.matches_2d3d.clear();
  }
  if (scored.pairs) {
    for (const PreparedPair& pair : prepared.pairs) {
      if (explained[pair.keypoint]) continue;
      rest.matches_2d2d.push_back(problem.matches_2d2d[static_cast<size_t>(pair.match)]);
    }
  }
  return rest;
}

}  // namespace

std::optional<Rigid3> FindRival(const PoseProblem& problem, const PreparedProblem& prepared,
                                const std::vector<bool>& explained, ResidualKinds scored,
                                const EstimatorOptions& options) {
  Rng rng(StreamSeed(options.seed, problem.name, "rival"));
  const PreparedProblem rest(Rest(problem, prepared, explained, scored),
                             options.reprojection_threshold_px, options.sampson_threshold_px, rng,
                             options.point_sigma);
  const P3pGenerator p3p(rest);
  const E5p1Generator e5p1(rest);
  std::vector<RansacSolver> solvers;
  const bool by_points = P3pGenerator::CanSample(rest);
  if (by_points) {
    solvers.push_back({&p3p, Solver::kP3p, {.points = true, .pairs = false}});
  } else if (E5p1Generator::CanSample(rest)) {
    solvers.push_back({&e5p1, Solver::kE5p1, {.points = false, .pairs = true}});
  }
  const Objective objective(by_points ? Objective::Sets::kPoints : Objective::Sets::kPairs,
                            ScoreCombination::kSumMsac, rest.num_matches_2d3d,
                            rest.num_matches_2d2d, options.refinement);
  EstimatorOptions few = options;
  few.max_iterations = std::min(options.max_iterations, kRivalSamples);
  few.min_iterations = 1;
  const RansacReport report = RunRansac(rest, objective, solvers, SolverSchedule::kAll, few, rng);
  if (!report.best) return std::nullopt;
  return rest.CamFromWorld(report.best->pose);
}

}  // namespace raylift
