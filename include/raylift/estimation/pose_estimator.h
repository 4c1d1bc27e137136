// Estimates a camera pose from matches by the methods of Panek, Sattler and Kukelova, "Combining
// Absolute and Semi-Generalized Relative Poses for Visual Localization" (2024), and more
// (options.h), behind one interface.

#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "raylift/base/enum_names.h"
#include "raylift/estimation/match_noise.h"
#include "raylift/geometry/camera.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

enum class Solver { kP3p, kE5p1, kD3p1, kKnownCenter, kUpright };
template <>
inline constexpr auto kEnumNames<Solver> = std::to_array<EnumName<Solver>>({
    {Solver::kP3p, "p3p"},
    {Solver::kE5p1, "e5p1"},
    {Solver::kD3p1, "d3p1"},
    {Solver::kKnownCenter, "p2p_centre"},  // two 2D-3D matches, and the position's prior
    {Solver::kUpright, "up2p"},            // two 2D-3D matches, and gravity
});

// The reason why there is no pose.
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
    {FailureReason::kNoDepthPair,
     "no reference has three matches with depth and another one a match"},
    {FailureReason::kNoConsistentSample, "no pose that enough matches agree on"},
});

// The score of one match set under one pose.
struct MatchSetScore {
  int num_matches = 0;
  int num_inliers = 0;
  double msac_cost = 0;  // sum of min(e^2 / t^2, 1)
};

// The verdict on a pose, by its confidence.
enum class PoseVerdict { kFailed, kDoubtful, kLocalized };
template <>
inline constexpr auto kEnumNames<PoseVerdict> = std::to_array<EnumName<PoseVerdict>>({
    {PoseVerdict::kFailed, "failed"},
    {PoseVerdict::kDoubtful, "doubtful"},
    {PoseVerdict::kLocalized, "localized"},
});
// A pose is localized from this confidence on.
inline constexpr double kLocalizedConfidence = 0.95;

// A pose elsewhere that explains the matches about as well as the estimated one: that of a
// look-alike place, or one of the matches that the estimated one does not explain.
struct AlternativePose {
  Rigid3 cam_from_world;
  double probability = 0;
  std::optional<Eigen::Matrix<double, 6, 6>> covariance = std::nullopt;  // as PoseEstimate's
};

// The result of an estimator: the pose or a reason, its support, and how sure it is.
struct PoseEstimate {
  std::optional<Rigid3> cam_from_world;
  FailureReason failure = FailureReason::kNone;

  // The final pose's scores with the thresholds of the options, always over both match sets.
  MatchSetScore score_2d3d;
  MatchSetScore score_2d2d;
  std::vector<bool> inliers_2d3d;  // one per match of the problem
  std::vector<bool> inliers_2d2d;

  Solver solver = Solver::kP3p;  // which solver the pose comes from
  int iterations = 0;

  // The covariance of the step (w, v) in the camera's tangent frame (geometry/residuals.h), from
  // the normal equations at the final pose with the residuals' own variance; nullopt where the
  // inliers do not determine the pose.
  std::optional<Eigen::Matrix<double, 6, 6>> covariance;
  double rotation_sigma_deg = 0;  // root mean square over the axes' sum; 0 without a covariance
  double position_sigma = 0;      // of the camera center, scene units

  // The probability that the pose is right: that its inliers are not there by chance, that no other
  // pose explains the matches as well, that more than one small part of the photograph speaks for
  // it, and that the matches tell where the camera is, within 1.25 % of the distance to the scene.
  // src/estimation/README.md has the formula.
  double confidence = 0;
  PoseVerdict verdict = PoseVerdict::kFailed;
  // The alternatives that lower the confidence below that of a localized pose, the likeliest first,
  // each with the probability that it, not the pose or another alternative, is right.
  std::vector<AlternativePose> alternatives;
  int inlier_keypoints = 0;  // of the query: one counts once, in however many references
  int num_keypoints = 0;     // with matches

  std::optional<MatchNoise> noise;
  // The value by which the method compares poses (smaller is better), of the best pose of RANSAC
  // and of the refined one.
  double ransac_value = 0;
  double refined_value = 0;

  // This is false where only the orientation is determined (E5+1 with all references at one
  // center).
  bool position_observable = true;

  // The query's camera with the refined focal length, where that was asked for or not known.
  std::optional<Camera> refined_camera;

  // Select keeps both candidates, for the diagnostics.
  std::optional<Rigid3> p3p_cam_from_world;
  std::optional<Rigid3> e5p1_cam_from_world;
};

// Returns the noise that the estimates of a scene's queries have in common (PoolNoise() of those
// that are localized); nullopt where they are too few.
inline constexpr size_t kLeastForCommonNoise = 3;
std::optional<SceneNoise> CommonNoise(std::span<const PoseEstimate> estimates);

struct EstimatorOptions;

// Learns the noise from some 30 of `count` problems of one scene, evenly spaced; nullopt where they
// are too few to tell, or the options make no use of it. `problem_at` is called from several
// threads.
std::optional<SceneNoise> LearnSceneNoise(size_t count,
                                          const std::function<PoseProblem(size_t)>& problem_at,
                                          const EstimatorOptions& options, int threads);

// Estimates poses by one method. Thread safe: Estimate() keeps no state between calls.
class PoseEstimator {
 public:
  virtual ~PoseEstimator() = default;
  virtual PoseEstimate Estimate(const PoseProblem& problem) const = 0;
};

// Returns the estimator of the options' method, for which matches that are not finite, or whose
// pixel has no ray, count as outliers. Throws OptionError where the options are out of range.
std::unique_ptr<PoseEstimator> MakePoseEstimator(const EstimatorOptions& options);

}  // namespace raylift
