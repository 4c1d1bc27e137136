// From matches to a camera pose: the methods of Panek, Sattler and Kukelova, "Combining Absolute
// and Semi-Generalized Relative Poses for Visual Localization" (2024), behind one interface.
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
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "raylift/base/enum_names.h"
#include "raylift/estimation/match_noise.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/scene/pose_problem.h"

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

// E5+1 and D3+1 judge poses by 2D-2D matches alone.
constexpr bool ScoresPairsAlone(Method method) {
  return method == Method::kE5p1 || method == Method::kD3p1;
}
// All but E5+1 use 2D-3D matches.
constexpr bool UsesPoints(Method method) { return method != Method::kE5p1; }
// P3P and HLoc have nothing else, and D3+1 draws them; the others can do without.
constexpr bool NeedsPoints(Method method) {
  return method == Method::kP3p || method == Method::kHloc || method == Method::kD3p1;
}

// How the scores of the two match sets become one (Eqs. 1 to 5): I inliers, N matches, M MSAC sums.
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

// Which residuals refine a new best pose of Adaptive.
enum class LocalOptimization {
  kHybrid,  // both kinds
  kSplit,   // the kind of the solver that made the hypothesis
};
template <>
inline constexpr auto kEnumNames<LocalOptimization> = std::to_array<EnumName<LocalOptimization>>({
    {LocalOptimization::kHybrid, "hybrid"},
    {LocalOptimization::kSplit, "split"},
});

// What happens beyond the paper, in every method.
enum class Refinement {
  // The pose is refined by maximum likelihood after RANSAC, Adaptive's and D3+1's by both match
  // sets together, and Adaptive draws samples of D3+1 as well; a pose that chance explains is none.
  kRobust,
  // Nothing: every new best pose is optimized locally on all matches, and the best one is returned
  // as it is.
  kPaper,
};
template <>
inline constexpr auto kEnumNames<Refinement> = std::to_array<EnumName<Refinement>>({
    {Refinement::kRobust, "robust", "robust", "refined by maximum likelihood after RANSAC"},
    {Refinement::kPaper, "paper", "paper", "the paper's methods and nothing beyond"},
});

enum class Solver { kP3p, kE5p1, kD3p1, kKnownCenter, kUpright };
template <>
inline constexpr auto kEnumNames<Solver> = std::to_array<EnumName<Solver>>({
    {Solver::kP3p, "p3p"},
    {Solver::kE5p1, "e5p1"},
    {Solver::kD3p1, "d3p1"},
    {Solver::kKnownCenter, "p2p_centre"},  // two 2D-3D matches, and the position's prior
    {Solver::kUpright, "up2p"},            // two 2D-3D matches, and gravity
});

struct EstimatorOptions {
  Method method = Method::kAdaptive;
  ScoreCombination score = ScoreCombination::kSumMsac;
  LocalOptimization local_optimization = LocalOptimization::kHybrid;
  double alpha = 0.8;  // Select's
  Refinement refinement = Refinement::kRobust;

  double reprojection_threshold_px = 8.0;  // t_3D
  double sampson_threshold_px = 2.0;       // t_2D
  // Standard deviation (scene units) of the 3D points whose match carries none: it widens a match's
  // threshold by the point's error in pixels at its depth. 0: points are exact.
  double point_sigma = 0;
  // What the scene's queries have in common (PoolNoise()), for the robust refinement of both match
  // sets together. None: each query tells by itself.
  std::optional<SceneNoise> scene_noise = std::nullopt;
  // Find the query's focal length with the pose, for photographs of unknown calibration, within
  // this factor of the camera's either way. Lenses without one stay as they are. (A problem whose
  // priors say that it is not known needs no option.)
  bool refine_focal = false;
  double focal_range = 1.3;

  int min_iterations = 100;
  int max_iterations = 10000;
  double confidence = 0.9999;
  // Results depend on it, the problem's name, the problem and the other options alone.
  uint64_t seed = 0;

  // Throws OptionError for a value out of its range.
  void Validate() const;
};

// Whether a pose is refined by both match sets together: then the estimate tells of the scene's
// noise (PoseEstimate::noise) and takes it.
constexpr bool UsesSceneNoise(const EstimatorOptions& options) {
  const bool by_both_kinds =
      options.method == Method::kD3p1 || (options.method == Method::kAdaptive &&
                                          options.local_optimization == LocalOptimization::kHybrid);
  return by_both_kinds && options.refinement == Refinement::kRobust;
}

// Why there is no pose.
enum class FailureReason {
  kNone,
  kTooFewMatches,       // fewer than the method's minimal samples need
  kNoReferencePair,     // E5+1 alone: no reference with five matches and another with one
  kNoDepthPair,         // D3+1 alone: no reference with three lifted matches and another with one
  kNoConsistentSample,  // no sample gave a pose that enough matches agree on
};
template <>
inline constexpr auto kEnumNames<FailureReason> = std::to_array<EnumName<FailureReason>>({
    {FailureReason::kNone, "ok"},
    {FailureReason::kTooFewMatches, "too few matches"},
    {FailureReason::kNoReferencePair, "no reference has five matches"},
    {FailureReason::kNoDepthPair, "no reference has three matches with depth"},
    {FailureReason::kNoConsistentSample, "no pose that enough matches agree on"},
});

// The score of one match set under one pose.
struct MatchSetScore {
  int num_matches = 0;
  int num_inliers = 0;
  double msac_cost = 0;  // sum of min(e^2 / t^2, 1)
};

// Whether a pose can be trusted.
enum class PoseVerdict { kFailed, kDoubtful, kLocalized };
template <>
inline constexpr auto kEnumNames<PoseVerdict> = std::to_array<EnumName<PoseVerdict>>({
    {PoseVerdict::kFailed, "failed"},
    {PoseVerdict::kDoubtful, "doubtful"},
    {PoseVerdict::kLocalized, "localized"},
});
// Localized from this confidence on.
inline constexpr double kLocalizedConfidence = 0.95;

struct PoseEstimate {
  std::optional<Rigid3> cam_from_world;
  FailureReason failure = FailureReason::kNone;

  // Of the final pose, with the thresholds of the options; always over both match sets.
  MatchSetScore score_2d3d;
  MatchSetScore score_2d2d;
  std::vector<bool> inliers_2d3d;  // one per match of the problem
  std::vector<bool> inliers_2d2d;

  Solver solver = Solver::kP3p;  // which solver the pose comes from
  int iterations = 0;

  // Of the step (w, v) in the camera's tangent frame (geometry/residuals.h), from the normal
  // equations at the final pose with the residuals' own spread; none where the inliers do not
  // determine the pose.
  std::optional<Eigen::Matrix<double, 6, 6>> covariance;
  double rotation_sigma_deg = 0;  // root mean square over the axes' sum; 0 without a covariance
  double position_sigma = 0;      // of the camera center, scene units

  // The probability that the pose is right: that its inliers are not there by chance, that no other
  // pose explains the matches as well, among those that its RANSAC found and one that is looked for
  // in what it leaves unexplained, and, of E5+1's, that it is right in its
  // distance from the reference that explains most: pairs of other references must tell that. See
  // support.h in src/estimation.
  double confidence = 0;
  PoseVerdict verdict = PoseVerdict::kFailed;
  int inlier_keypoints = 0;  // of the query: one counts once, in however many references
  int num_keypoints = 0;     // with matches

  std::optional<MatchNoise> noise;
  // The value by which the method compares poses (smaller is better), of the best pose of RANSAC
  // and of the refined one.
  double ransac_value = 0;
  double refined_value = 0;

  // False where only the orientation is determined (E5+1 with all references at one center).
  bool position_observable = true;

  // The query's camera with the refined focal length, where that was asked for or not known.
  std::optional<Camera> refined_camera;

  // Select keeps both candidates, for the diagnostics.
  std::optional<Rigid3> p3p_cam_from_world;
  std::optional<Rigid3> e5p1_cam_from_world;
};

// Thread safe: Estimate() keeps no state between calls.
class PoseEstimator {
 public:
  virtual ~PoseEstimator() = default;
  virtual PoseEstimate Estimate(const PoseProblem& problem) const = 0;
};

// What the estimates of a scene's queries tell of another one's (PoolNoise() of those that are
// localized); none where they are too few.
inline constexpr size_t kLeastForCommonNoise = 3;
std::optional<SceneNoise> CommonNoise(std::span<const PoseEstimate> estimates);

// Throws OptionError where the options are out of range. Matches that are not finite, or whose
// pixel has no ray, count as outliers.
std::unique_ptr<PoseEstimator> MakePoseEstimator(const EstimatorOptions& options);

}  // namespace raylift
