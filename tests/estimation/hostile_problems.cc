// Estimators on random problems that nobody wrote them for (hostile_problem.h):
//   hostile_problems COUNT [FIRST]
// estimates the problems FIRST ... FIRST + COUNT - 1. Each must give a pose that its own inliers
// support, a reason, or an error that blames the input, in bounded time. Prints how many were which
// and the slowest one, or the first that is unsound: `hostile_problems 1 NUMBER` repeats it.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <ctime>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "base/rng.h"
#include "base/statistics.h"
#include "estimation/hostile_problem.h"
#include "estimation/methods/methods.h"
#include "estimation/standard_options.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/geometry/residuals.h"
#include "raylift/scene/keypoints.h"

namespace raylift {
namespace {

// Of the processor, for one problem of at most 30 matches of either kind; in an optimized build it
// takes some milliseconds.
constexpr double kMostSeconds = 20;

double ProcessorSeconds() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

// What estimators may blame the input for.
bool IsWellFormed(const PoseProblem& problem) {
  const auto is_keypoint = [](const std::optional<int>& index) {
    return !index || (*index >= 0 && *index <= kLargestKeypoint);
  };
  const PosePriors& priors = problem.priors;
  const auto is_direction = [](const Eigen::Vector3d& v) {
    return v.allFinite() && v.norm() > 0 && std::isfinite(v.norm());
  };
  return std::ranges::all_of(problem.matches_2d2d,
                             [&](const auto& m) { return is_keypoint(m.query_keypoint); }) &&
         std::ranges::all_of(problem.matches_2d3d,
                             [&](const auto& m) { return is_keypoint(m.query_keypoint); }) &&
         (problem.reference_clusters.empty() ||
          problem.reference_clusters.size() == problem.references.size()) &&
         (!priors.position ||
          (priors.position->position.allFinite() && priors.position->sigma.allFinite() &&
           priors.position->sigma.minCoeff() >= 0)) &&
         (!priors.gravity ||
          (is_direction(priors.gravity->down_in_cam) &&
           is_direction(priors.gravity->down_in_world) &&
           std::isfinite(priors.gravity->sigma_deg) && priors.gravity->sigma_deg >= 0)) &&
         priors.focal_range >= 1 && priors.focal_range <= kMaxFocalRange &&
         // Else there is none in its range that is a number.
         problem.query_camera.focal_x_px() > 1e-290 && problem.query_camera.focal_x_px() < 1e290 &&
         problem.query_camera.focal_y_px() > 1e-290 && problem.query_camera.focal_y_px() < 1e290;
}

// The estimators' residual is exact for pinholes, up to 80 degrees off their axes, and that of
// first order elsewhere.
bool HasExactResidual(const Camera& camera, const Eigen::Vector2d& pixel) {
  constexpr double kMaxSlope = 5;
  const double from_axis_px = (pixel - camera.principal_point_px()).norm();
  return camera.model() == CameraModel::kPinhole &&
         from_axis_px < kMaxSlope * std::min(camera.focal_x_px(), camera.focal_y_px());
}

// Of the 3D points from the origin: the estimators work in a frame of that size, in which what is
// smaller by the number of digits that there are is one point.
double MedianDistance(const PoseProblem& problem) {
  std::vector<double> distances;
  for (const Match2D3D& match : problem.matches_2d3d) {
    const double distance = match.point_in_world.stableNorm();
    if (std::isfinite(distance)) distances.push_back(distance);
  }
  return UpperMedianOr(std::move(distances), 0);
}

// What is wrong with the inliers of a pose, by the residuals' reference implementations; empty
// where nothing is. Numbers of such sizes that rounding alone could make an inlier are passed over,
// as are points of uncertain references, and matches that repeat another one, which are what that
// one is.
std::string FaultOfInliers(const HostileProblem& made, const PoseEstimate& estimate) {
  const PoseProblem& problem = made.problem;
  const Rigid3& pose = *estimate.cam_from_world;
  const Camera& camera = estimate.refined_camera.value_or(problem.query_camera);
  constexpr double kRounding = 1e-11;  // some hundred operations
  double extent = std::max(pose.translation.stableNorm(), MedianDistance(problem));
  for (const PosedImage& reference : problem.references) {
    const double distance = reference.cam_from_world.OriginInSource().stableNorm();
    if (std::isfinite(distance)) extent = std::max(extent, distance);
  }
  const double focal_px = std::max(camera.focal_x_px(), camera.focal_y_px());
  const double most_px = made.options.reprojection_threshold_px;
  Rng rng(0);
  const NormalizedProblem normalized = Normalize(problem, made.options, rng);
  const ReferenceSigmas& sigmas = problem.reference_sigmas;
  const bool references_are_uncertain = sigmas.factor.value_or(0) > 0 ||
                                        sigmas.rotation_deg.value_or(0) > 0 ||
                                        sigmas.position.value_or(0) > 0;
  for (size_t i = 0; i < problem.matches_2d3d.size(); ++i) {
    const Match2D3D& match = problem.matches_2d3d[i];
    if (!estimate.inliers_2d3d[i] || match.point_sigma || made.options.point_sigma > 0) continue;
    if (match.reference && references_are_uncertain) continue;
    if (normalized.repeats.of_2d3d[i] != i) continue;
    if (!HasExactResidual(camera, match.query_px)) continue;
    const double depth = (pose * match.point_in_world).z();
    // On which side of the camera it is, is rounding alone.
    if (std::abs(depth) < kRounding * (extent + match.point_in_world.norm())) continue;
    const double rounding_px =
        kRounding * (focal_px * (extent + match.point_in_world.norm()) / std::abs(depth) +
                     match.query_px.norm() + camera.principal_point_px().norm());
    if (!(rounding_px < 0.01 * most_px)) continue;
    const auto residual = ReprojectionError(camera, pose, match.point_in_world, match.query_px);
    if (!residual) return fmt::format("2D-3D inlier {} is behind the camera", i);
    const double error_px = residual->error_px.stableNorm();
    if (error_px > 1.02 * most_px) {
      return fmt::format("2D-3D inlier {} is off by {} px", i, error_px);
    }
  }
  return {};
}

std::string FaultOf(const HostileProblem& made, const PoseEstimate& estimate) {
  if (const auto sound = IsSound(estimate, made.problem); !sound) return sound.message();
  const auto fits = [](const MatchSetScore& score, const std::vector<bool>& inliers) {
    return score.num_inliers == std::ranges::count(inliers, true) &&
           score.num_matches == static_cast<int>(inliers.size());
  };
  const bool has_pose = estimate.cam_from_world.has_value();
  if (has_pose && (!fits(estimate.score_2d3d, estimate.inliers_2d3d) ||
                   !fits(estimate.score_2d2d, estimate.inliers_2d2d))) {
    return "the counts are not those of the inliers";
  }
  if (has_pose == (estimate.verdict == PoseVerdict::kFailed)) return "the verdict is another";
  if (estimate.covariance && !(estimate.covariance->diagonal().minCoeff() >= 0)) {
    return "a variance is negative";
  }
  if (!has_pose) return {};
  if (std::max(estimate.score_2d3d.num_inliers, estimate.score_2d2d.num_inliers) < 3) {
    return "hardly a match supports the pose";
  }
  return FaultOfInliers(made, estimate);
}

struct Slowest {
  double seconds = 0;
  int64_t number = 0;
};

int Run(int64_t first, int64_t count) {
  std::map<std::string, int64_t> outcomes;
  Slowest slowest;
  for (int64_t number = first; number < first + count; ++number) {
    Rng rng(StreamSeed(static_cast<uint64_t>(number), "hostile", "problem"));
    const HostileProblem made = MakeHostileProblem(rng);
    const double begin = ProcessorSeconds();
    std::string fault;
    try {
      const PoseEstimate estimate = MakePoseEstimator(made.options)->Estimate(made.problem);
      fault = FaultOf(made, estimate);
      ++outcomes[std::string(ToString(estimate.failure))];
    } catch (const InputError& error) {
      if (IsWellFormed(made.problem)) fault = error.what();
      ++outcomes["refused"];
    } catch (const std::exception& error) {
      fault = error.what();
    }
    const double seconds = ProcessorSeconds() - begin;
    if (seconds > slowest.seconds) slowest = {seconds, number};
    if (fault.empty() && seconds > kMostSeconds) fault = fmt::format("it took {:.1f} s", seconds);
    if (!fault.empty()) {
      fmt::print("problem {} ({}): {}\n", number, ToString(made.options.method), fault);
      return 1;
    }
  }
  for (const auto& [outcome, times] : outcomes) fmt::print("{:10} {}\n", times, outcome);
  fmt::print("slowest: problem {}, {:.1f} ms\n", slowest.number, 1e3 * slowest.seconds);
  return 0;
}

}  // namespace
}  // namespace raylift

int main(int argc, char** argv) {
  const auto count = argc > 1 ? raylift::ParseInt(argv[1]) : std::nullopt;
  const auto first = argc > 2 ? raylift::ParseInt(argv[2]) : 0;
  if (!count || !first || argc > 3) {
    std::fprintf(stderr, "Usage: hostile_problems COUNT [FIRST]\n");
    return 2;
  }
  return raylift::Run(*first, *count);
}
