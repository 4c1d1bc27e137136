// The methods that estimate a pose, and their options.
//
//   P3P            LO-RANSAC on the 2D-3D matches (reprojection error).
//   E5+1           LO-RANSAC on the 2D-2D matches: an essential matrix from five matches to one
//                  reference, the translation's scale from one match to another (Sampson error). No
//                  geometry needed.
//   D3+1           LO-RANSAC on the 2D-2D matches with a semi-generalized sample of three points
//                  with depth and one without: the three, of one reference whose depths may have
//                  any scale, give the pose up to the translation's length (P3P), the match to
//                  another reference gives that. For depth from single images.
//   Adaptive       Both samples in every iteration, all poses scored on both match sets (Sec. 3).
//   Select         P3P and E5+1 apart, then one of the two poses by its 2D-2D inliers (Eq. 6).
//   Hybrid RANSAC  Each iteration first draws which solver; poses are compared by the sum of
//                  inliers and refined on the 2D-3D matches (Camposeco et al., CVPR 2018).
//   HLoc           The structure-based baseline: the retrieved references are clustered by
//                  covisibility, P3P is run for each cluster, and the pose with the most inliers is
//                  taken.

#pragma once

#include <cstdint>
#include <optional>

#include "raylift/base/enum_names.h"
#include "raylift/estimation/match_noise.h"

namespace raylift {

enum class Method { kP3p, kE5p1, kD3p1, kAdaptive, kSelect, kHybridRansac, kHloc };
template <>
inline constexpr auto kEnumNames<Method> = std::to_array<EnumName<Method>>({
    {Method::kP3p, "p3p", "P3P", "LO-RANSAC on the 2D-3D matches"},
    {Method::kE5p1, "e5p1", "E5+1", "LO-RANSAC on the 2D-2D matches; needs no geometry"},
    {Method::kD3p1, "d3p1", "D3+1",
     "as E5+1, sampling depth of any scale per reference (3pt+depth)"},
    {Method::kAdaptive, "adaptive", "Adaptive",
     "both samples in every iteration, scored on both match sets"},
    {Method::kSelect, "select", "Select",
     "P3P and E5+1 apart, then one of them by its 2D-2D inliers"},
    {Method::kHybridRansac, "hybrid_ransac", "Hybrid RANSAC",
     "solver drawn by probability, summed inliers (Camposeco et al. 2018)"},
    {Method::kHloc, "hloc", "HLoc",
     "P3P per covisibility cluster of the references, best by inliers"},
});

// Returns whether a method judges poses by 2D-2D matches alone, as E5+1 and D3+1 do.
constexpr bool Scores2D2DAlone(Method method) {
  return method == Method::kE5p1 || method == Method::kD3p1;
}
// Returns whether a method uses 2D-3D matches, as all but E5+1 do.
constexpr bool Uses2D3D(Method method) { return method != Method::kE5p1; }
// Returns whether a method cannot do without 2D-3D matches: P3P and HLoc have nothing else, and
// D3+1 draws them.
constexpr bool Needs2D3D(Method method) {
  return method == Method::kP3p || method == Method::kHloc || method == Method::kD3p1;
}

// The combination of both match sets' scores (Eqs. 1 to 5): I inliers, N matches, M MSAC sums.
enum class ScoreCombination {
  kSumInliers,       // I_3D + I_2D (Camposeco et al. 2018)
  kSumInlierRatios,  // I_3D / N_3D + I_2D / N_2D
  kMultInliers,      // I_3D * I_2D
  kSumMsac,          // M_3D / t_3D^2 + M_2D / t_2D^2
  kMultMsac,         // M_3D * M_2D
};
template <>
inline constexpr auto kEnumNames<ScoreCombination> = std::to_array<EnumName<ScoreCombination>>({
    {ScoreCombination::kSumInliers, "sum_inl", "sum. inl."},
    {ScoreCombination::kSumInlierRatios, "sum_inl_rat", "sum. inl. rat."},
    {ScoreCombination::kMultInliers, "mult_inl", "mult. inl."},
    {ScoreCombination::kSumMsac, "sum_msac", "sum. msac"},
    {ScoreCombination::kMultMsac, "mult_msac", "mult. msac"},
});

// The residuals that refine a new best pose of Adaptive.
enum class LocalOptimization {
  kHybrid,  // both kinds
  kSplit,   // the kind of the solver that made the hypothesis
};
template <>
inline constexpr auto kEnumNames<LocalOptimization> = std::to_array<EnumName<LocalOptimization>>({
    {LocalOptimization::kHybrid, "hybrid"},
    {LocalOptimization::kSplit, "split"},
});

// The steps that methods take beyond the paper.
enum class Refinement {
  // The pose is refined by maximum likelihood after RANSAC, Adaptive's and D3+1's by both match
  // sets together, and Adaptive draws samples of D3+1 as well; a pose that chance explains is none.
  kRobust,
  // The methods are the paper's: every new best pose is optimized locally on all matches, and the
  // best one is returned unrefined.
  kPaper,
};
template <>
inline constexpr auto kEnumNames<Refinement> = std::to_array<EnumName<Refinement>>({
    {Refinement::kRobust, "robust", "robust", "refined by maximum likelihood after RANSAC"},
    {Refinement::kPaper, "paper", "paper", "the paper's methods and nothing beyond"},
});

struct EstimatorOptions {
  Method method = Method::kAdaptive;
  ScoreCombination score = ScoreCombination::kSumMsac;
  LocalOptimization local_optimization = LocalOptimization::kHybrid;
  double alpha = 0.8;  // Select's
  Refinement refinement = Refinement::kRobust;

  double reprojection_threshold_px = 8.0;  // t_3D
  double sampson_threshold_px = 2.0;       // t_2D
  // This is the standard deviation (scene units) of the 3D points whose match carries none: it
  // widens a match's threshold by the point's error in pixels at its depth. With 0 points are
  // exact.
  double point_sigma = 0;
  // The prior of the noise, pooled over the scene's queries (PoolNoise()), for the robust
  // refinement of both match sets together. With nullopt each query's noise is estimated from
  // itself alone.
  std::optional<SceneNoise> scene_noise = std::nullopt;
  // Estimates the query's focal length with the pose, for photographs of unknown calibration,
  // within the factor `focal_range` of the camera's either way. Cameras without one (panoramas)
  // stay as they are. (A problem whose priors say that it is not known needs no option.)
  bool refine_focal = false;
  double focal_range = 1.3;
  // This is the standard deviation of the query's focal length as a share of it, which the pose
  // takes into account; with 0 the focal length is exact, and with nullopt the problem's priors say
  // it.
  std::optional<double> focal_sigma = std::nullopt;
  // Standard deviations of the references' errors (ReferenceSigmas), which the robust refinement of
  // both match sets together takes into account. With nullopt they are the problem's, or else
  // scene_noise's.
  std::optional<double> reference_factor_sigma = std::nullopt;
  std::optional<double> reference_rotation_sigma_deg = std::nullopt;
  std::optional<double> reference_position_sigma = std::nullopt;

  int min_iterations = 100;
  int max_iterations = 10000;
  double confidence = 0.9999;
  // Results depend on it, the problem's name, the problem and the other options alone.
  uint64_t seed = 0;

  // Throws OptionError for a value out of its range.
  void Validate() const;
};

// Returns whether poses are refined by both match sets together: only then an estimate has noise
// (PoseEstimate::noise), and scene_noise is used.
constexpr bool UsesSceneNoise(const EstimatorOptions& options) {
  const bool by_both_kinds =
      options.method == Method::kD3p1 || (options.method == Method::kAdaptive &&
                                          options.local_optimization == LocalOptimization::kHybrid);
  return by_both_kinds && options.refinement == Refinement::kRobust;
}

}  // namespace raylift
