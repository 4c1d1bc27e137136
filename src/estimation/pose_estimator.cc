#include "raylift/estimation/pose_estimator.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "estimation/hypothesis_generators.h"
#include "estimation/joint_score.h"
#include "estimation/prepared_problem.h"
#include "estimation/ransac.h"
#include "estimation/refinement.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/rng.h"

namespace raylift {
namespace {

// Fills what follows from the final pose: scores, inliers, covariance.
void DescribePose(const PreparedProblem& problem, const PoseProblem& original,
                  const FinalPose& final_pose, PoseEstimate& estimate) {
  estimate.cam_from_world = problem.CamFromWorld(final_pose.pose);
  const Residuals residuals = ComputeResiduals(problem, final_pose.pose);
  const auto describe = [](const auto& matches, const std::vector<double>& squared, size_t total,
                           MatchSetScore& score, std::vector<bool>& inliers) {
    inliers.assign(total, false);
    score.num_matches = static_cast<int>(total);
    score.msac_cost = static_cast<double>(total - matches.size());
    for (size_t i = 0; i < matches.size(); ++i) {
      const bool inlier = squared[i] < 1;
      inliers[matches[i].match] = inlier;
      score.num_inliers += inlier ? 1 : 0;
      score.msac_cost += inlier ? squared[i] : 1;
    }
  };
  describe(problem.points, residuals.points, original.matches_2d3d.size(), estimate.score_2d3d,
           estimate.inliers_2d3d);
  describe(problem.pairs, residuals.pairs, original.matches_2d2d.size(), estimate.score_2d2d,
           estimate.inliers_2d2d);

  if (final_pose.covariance) {
    Eigen::Matrix<double, 6, 1> unit;
    unit << 1, 1, 1, problem.scale, problem.scale, problem.scale;
    const Eigen::Matrix<double, 6, 6> covariance =
        unit.asDiagonal() * *final_pose.covariance * unit.asDiagonal();
    estimate.covariance = covariance;
    estimate.rotation_sigma_deg =
        std::sqrt(covariance.topLeftCorner<3, 3>().trace()) * 180 / std::numbers::pi;
    // The centre is -R' t: a step moves it by -R' v in the world, whatever w is, as both R and t
    // turn with w.
    estimate.position_sigma = std::sqrt(covariance.bottomRightCorner<3, 3>().trace());
  }
}

// P3P, E5+1 and Adaptive.
class RansacEstimator final : public PoseEstimator {
 public:
  explicit RansacEstimator(const EstimatorOptions& options) : options_(options) {}

  PoseEstimate Estimate(const PoseProblem& problem) const override {
    Rng rng(StreamSeed(options_.seed, problem.name, ToString(options_.method)));
    const PreparedProblem prepared(problem, options_.reprojection_threshold_px,
                                   options_.sampson_threshold_px, rng);
    PoseEstimate estimate;
    estimate.score_2d3d.num_matches = prepared.num_matches_2d3d;
    estimate.score_2d2d.num_matches = prepared.num_matches_2d2d;
    estimate.inliers_2d3d.assign(problem.matches_2d3d.size(), false);
    estimate.inliers_2d2d.assign(problem.matches_2d2d.size(), false);

    const bool adaptive = options_.method == Method::kAdaptive;
    const bool split = options_.local_optimization == LocalOptimization::kSplit;
    const P3pGenerator p3p(prepared);
    const E5p1Generator e5p1(prepared);
    std::vector<RansacSolver> solvers;
    if (options_.method != Method::kE5p1 && P3pGenerator::CanSample(prepared)) {
      solvers.push_back({&p3p, Solver::kP3p, {.points = true, .pairs = adaptive && !split}});
    }
    if (options_.method != Method::kP3p && E5p1Generator::CanSample(prepared)) {
      solvers.push_back({&e5p1, Solver::kE5p1, {.points = adaptive && !split, .pairs = true}});
    }
    if (solvers.empty()) {
      const bool enough_pairs = prepared.pairs.size() >= 5 && options_.method != Method::kP3p;
      estimate.failure =
          enough_pairs ? FailureReason::kNoReferencePair : FailureReason::kTooFewMatches;
      return estimate;
    }
    const Objective objective(adaptive
                                  ? Objective::Sets::kBoth
                                  : (options_.method == Method::kP3p ? Objective::Sets::kPoints
                                                                     : Objective::Sets::kPairs),
                              options_.score, static_cast<int>(prepared.points.size()),
                              static_cast<int>(prepared.pairs.size()));
    const RansacReport report = RunRansac(prepared, objective, solvers, options_, rng);
    estimate.iterations = report.iterations;
    if (!report.best) {
      estimate.failure = FailureReason::kNoConsistentSample;
      return estimate;
    }
    estimate.solver = report.best->solver;
    DescribePose(prepared, problem,
                 RefineFinally(prepared, report.best->pose, report.best->refined_kinds), estimate);
    CheckSupport(e5p1, estimate);
    return estimate;
  }

 private:
  // A pose that its own minimal sample alone supports says nothing.
  void CheckSupport(const E5p1Generator& e5p1, PoseEstimate& estimate) const {
    const bool enough_points = estimate.score_2d3d.num_inliers >= 3;
    const bool enough_pairs =
        estimate.score_2d2d.num_inliers >= (e5p1.PositionObservable() ? 6 : 5);
    const bool supported = options_.method == Method::kP3p    ? enough_points
                           : options_.method == Method::kE5p1 ? enough_pairs
                                                              : enough_points || enough_pairs;
    if (!supported || !estimate.cam_from_world->IsFinite()) {
      estimate.cam_from_world.reset();
      DropCovariance(estimate);
      estimate.failure = FailureReason::kNoConsistentSample;
      return;
    }
    estimate.position_observable =
        e5p1.PositionObservable() || (options_.method != Method::kE5p1 && enough_points);
    if (!estimate.position_observable) {
      DropCovariance(estimate);
    }
  }

  static void DropCovariance(PoseEstimate& estimate) {
    estimate.covariance.reset();
    estimate.rotation_sigma_deg = 0;
    estimate.position_sigma = 0;
  }

  EstimatorOptions options_;
};

// Eq. 6: the P3P pose if it explains nearly as many 2D-2D matches as the E5+1 pose does.
class SelectEstimator final : public PoseEstimator {
 public:
  explicit SelectEstimator(const EstimatorOptions& options)
      : alpha_(options.alpha),
        p3p_(WithMethod(options, Method::kP3p)),
        e5p1_(WithMethod(options, Method::kE5p1)) {}

  PoseEstimate Estimate(const PoseProblem& problem) const override {
    PoseEstimate p3p = p3p_.Estimate(problem);
    PoseEstimate e5p1 = e5p1_.Estimate(problem);
    const auto p3p_pose = p3p.cam_from_world;
    const auto e5p1_pose = e5p1.cam_from_world;
    const int iterations = p3p.iterations + e5p1.iterations;
    bool take_p3p = p3p.score_2d2d.num_inliers > alpha_ * e5p1.score_2d2d.num_inliers;
    if (!p3p_pose) take_p3p = false;
    if (!e5p1_pose || (!e5p1.position_observable && p3p_pose)) take_p3p = p3p_pose.has_value();
    PoseEstimate chosen = take_p3p ? std::move(p3p) : std::move(e5p1);
    chosen.p3p_cam_from_world = p3p_pose;
    chosen.e5p1_cam_from_world = e5p1_pose;
    chosen.iterations = iterations;
    return chosen;
  }

 private:
  static EstimatorOptions WithMethod(EstimatorOptions options, Method method) {
    options.method = method;
    return options;
  }

  double alpha_;
  RansacEstimator p3p_;
  RansacEstimator e5p1_;
};

void Require(bool condition, std::string_view name, const std::string& value,
             std::string_view constraint) {
  if (!condition) {
    throw OptionError(name, value, constraint);
  }
}

}  // namespace

void EstimatorOptions::Validate() const {
  const auto positive = [](double value, std::string_view name) {
    Require(std::isfinite(value) && value > 0, name, fmt::format("{}", value), "must be positive");
  };
  positive(reprojection_threshold_px, "--reprojection-threshold-px");
  positive(sampson_threshold_px, "--sampson-threshold-px");
  Require(std::isfinite(alpha) && alpha >= 0, "--alpha", fmt::format("{}", alpha),
          "must not be negative");
  Require(confidence > 0 && confidence < 1, "--confidence", fmt::format("{}", confidence),
          "must lie between 0 and 1");
  Require(min_iterations >= 1, "--min-iterations", fmt::format("{}", min_iterations),
          "must be at least 1");
  Require(max_iterations >= min_iterations, "--max-iterations", fmt::format("{}", max_iterations),
          fmt::format("must not be below --min-iterations = {}", min_iterations));
}

std::unique_ptr<PoseEstimator> MakePoseEstimator(const EstimatorOptions& options) {
  options.Validate();
  switch (options.method) {
    case Method::kP3p:
    case Method::kE5p1:
    case Method::kAdaptive:
      return std::make_unique<RansacEstimator>(options);
    case Method::kSelect:
      return std::make_unique<SelectEstimator>(options);
  }
  return nullptr;
}

}  // namespace raylift
