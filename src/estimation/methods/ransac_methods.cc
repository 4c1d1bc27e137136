#include "estimation/methods/methods.h"

namespace raylift {

// Returns LO-RANSAC on the 2D-3D matches. Two of them are enough where the position or gravity is
// known.
RansacMethod P3pMethod(const EstimatorOptions& options) {
  return {.samplers = {{Solver::kP3p, MatchSets::k2D3D},
                       {Solver::kKnownCenter, MatchSets::k2D3D},
                       {Solver::kUpright, MatchSets::k2D3D}},
          .scored = MatchSets::k2D3D,
          .score = options.score};
}

// Returns LO-RANSAC on the 2D-2D matches: five to one reference, and a sixth to another for the
// length of the translation.
RansacMethod E5p1Method(const EstimatorOptions& options) {
  return {.samplers = {{Solver::kE5p1, MatchSets::k2D2D}},
          .scored = MatchSets::k2D2D,
          .score = options.score};
}

namespace {

// Returns LO-RANSAC on the 2D-2D matches, drawing three lifted ones of a reference whose depths may
// have any scale, and a fourth of another reference for the length of the translation. The joint
// refinement then uses the depths, too, as it estimates what they are worth.
RansacMethod D3p1Method(const EstimatorOptions& options) {
  return {.samplers = {{Solver::kD3p1, MatchSets::k2D2D}},
          .scored = MatchSets::k2D2D,
          .score = options.score,
          .refined = UsesSceneNoise(options) ? MatchSets::kBoth : MatchSets::k2D2D};
}

// Returns the method of Sec. 3 of the paper: in every iteration P3P and E5+1 draw one sample each,
// all poses are scored on both match sets (Eqs. 1 to 5), and a new best is optimized locally: over
// both sets (hybrid), or over the set that it was drawn from (split).
//
// Beyond the paper, two 2D-3D matches are drawn as well where the position or gravity is known, and
// D3+1 draws where the joint refinement can use its poses.
RansacMethod AdaptiveMethod(const EstimatorOptions& options) {
  const bool is_split = options.local_optimization == LocalOptimization::kSplit;
  const MatchSets after_2d3d = is_split ? MatchSets::k2D3D : MatchSets::kBoth;
  const MatchSets after_2d2d = is_split ? MatchSets::k2D2D : MatchSets::kBoth;
  RansacMethod method = {.samplers = {{Solver::kP3p, after_2d3d},
                                      {Solver::kKnownCenter, after_2d3d},
                                      {Solver::kUpright, after_2d3d},
                                      {Solver::kE5p1, after_2d2d}},
                         .schedule = SolverSchedule::kAll,
                         .scored = MatchSets::kBoth,
                         .score = options.score};
  if (UsesSceneNoise(options)) method.samplers.push_back({Solver::kD3p1, MatchSets::kBoth});
  return method;
}

// Returns the method of Camposeco et al. (CVPR 2018): each iteration first draws the solver, poses
// are compared by the sum of inliers and optimized on the 2D-3D matches.
RansacMethod HybridRansacMethod() {
  return {.samplers = {{Solver::kP3p, MatchSets::k2D3D},
                       {Solver::kKnownCenter, MatchSets::k2D3D},
                       {Solver::kUpright, MatchSets::k2D3D},
                       {Solver::kE5p1, MatchSets::k2D3D}},
          .schedule = SolverSchedule::kByProbability,
          .scored = MatchSets::kBoth,
          .score = ScoreCombination::kSumInliers};
}

}  // namespace

RansacMethod RansacMethodOf(const EstimatorOptions& options) {
  switch (options.method) {
    case Method::kP3p:
    case Method::kHloc:
    case Method::kSelect:
      break;
    case Method::kE5p1:
      return E5p1Method(options);
    case Method::kD3p1:
      return D3p1Method(options);
    case Method::kAdaptive:
      return AdaptiveMethod(options);
    case Method::kHybridRansac:
      return HybridRansacMethod();
  }
  return P3pMethod(options);
}

}  // namespace raylift
