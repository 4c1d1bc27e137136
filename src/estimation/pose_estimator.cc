#include "raylift/estimation/pose_estimator.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>

#include "base/rng.h"
#include "estimation/covisibility.h"
#include "estimation/final_refinement.h"
#include "estimation/focal_refinement.h"
#include "estimation/hypothesis_generators.h"
#include "estimation/joint_score.h"
#include "estimation/keypoint_evidence.h"
#include "estimation/match_residuals.h"
#include "estimation/prepared_problem.h"
#include "estimation/prior_generators.h"
#include "estimation/ransac.h"
#include "estimation/rival_search.h"
#include "estimation/support.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

// A refined pose keeps at least this share of what RANSAC's gains over a pose that nothing fits.
constexpr double kKeptGain = 0.5;

// Less sure than this is no pose.
constexpr double kLeastConfidence = 0.1;

MatchNoise Describe(const JointNoise& noise, bool references_disagree, double scale) {
  MatchNoise described;
  described.keypoint_px = std::sqrt(noise.keypoint_px2);
  described.keypoint_tail = noise.keypoint_tail;
  described.depth = std::sqrt(noise.depth);
  described.common_depth = std::sqrt(noise.common_depth);
  described.keypoint_errors = noise.keypoint_errors;
  described.depth_errors = noise.depth_errors;
  described.common_depth_errors = noise.common_depth_errors;
  if (references_disagree) {
    described.reference_factor = std::sqrt(noise.reference_factor);
    described.reference_rotation_deg = std::sqrt(noise.reference_rotation) * 180 / std::numbers::pi;
    described.reference_position = std::sqrt(noise.reference_center) * scale;
  }
  return described;
}

// None where the numbers end.
void SetCovariance(const Matrix6d& covariance, PoseEstimate& estimate) {
  estimate.covariance.reset();
  if (!covariance.allFinite()) return;
  estimate.covariance = covariance;
  estimate.rotation_sigma_deg =
      std::sqrt(covariance.topLeftCorner<3, 3>().trace()) * 180 / std::numbers::pi;
  // The center is -R' t: a step moves it by -R' v in the world, whatever w is, as both R and t turn
  // with w.
  estimate.position_sigma = std::sqrt(covariance.bottomRightCorner<3, 3>().trace());
}

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

  if (final_pose.noise) {
    estimate.noise = Describe(*final_pose.noise, final_pose.references_disagree, problem.scale);
  }
  if (final_pose.covariance) {
    Eigen::Matrix<double, 6, 1> unit;
    unit << 1, 1, 1, problem.scale, problem.scale, problem.scale;
    SetCovariance(unit.asDiagonal() * *final_pose.covariance * unit.asDiagonal(), estimate);
  }
}

// How a method configures the one RANSAC loop.
struct RansacMethod {
  Objective::Sets scored_sets;
  ScoreCombination score;
  SolverSchedule schedule = SolverSchedule::kAll;
  // The residuals that refine a pose, by the solver that made it; none: the solver is not used.
  std::optional<ResidualKinds> refined_after_p3p;
  std::optional<ResidualKinds> refined_after_e5p1;
  std::optional<ResidualKinds> refined_after_d3p1 = std::nullopt;
  // The residuals of the final refinement; none: those of the solver that made the pose.
  std::optional<ResidualKinds> refined_finally = std::nullopt;
};

RansacMethod Configure(const EstimatorOptions& options) {
  constexpr ResidualKinds kPoints{.points = true, .pairs = false};
  constexpr ResidualKinds kPairs{.points = false, .pairs = true};
  constexpr ResidualKinds kBoth{.points = true, .pairs = true};
  switch (options.method) {
    case Method::kP3p:
    case Method::kHloc:  // of one cluster
      return {.scored_sets = Objective::Sets::kPoints,
              .score = options.score,
              .refined_after_p3p = kPoints,
              .refined_after_e5p1 = std::nullopt};
    case Method::kE5p1:
      return {.scored_sets = Objective::Sets::kPairs,
              .score = options.score,
              .refined_after_p3p = std::nullopt,
              .refined_after_e5p1 = kPairs};
    case Method::kD3p1:
      return {.scored_sets = Objective::Sets::kPairs,
              .score = options.score,
              .refined_after_p3p = std::nullopt,
              .refined_after_e5p1 = std::nullopt,
              .refined_after_d3p1 = kPairs,
              .refined_finally = UsesSceneNoise(options) ? kBoth : kPairs};
    case Method::kHybridRansac:
      return {.scored_sets = Objective::Sets::kBoth,
              .score = ScoreCombination::kSumInliers,
              .schedule = SolverSchedule::kByProbability,
              .refined_after_p3p = kPoints,
              .refined_after_e5p1 = kPoints};
    case Method::kAdaptive:
    case Method::kSelect:  // made of two others
      break;
  }
  const bool split = options.local_optimization == LocalOptimization::kSplit;
  return {.scored_sets = Objective::Sets::kBoth,
          .score = options.score,
          .refined_after_p3p = split ? kPoints : kBoth,
          .refined_after_e5p1 = split ? kPairs : kBoth,
          .refined_after_d3p1 = UsesSceneNoise(options) ? std::optional(kBoth) : std::nullopt};
}

// P3P, E5+1, D3+1, Adaptive and Hybrid RANSAC.
// All focal lengths in the range must be numbers.
void RequireFocalRange(const PoseProblem& problem, double range) {
  const Camera& camera = problem.query_camera;
  for (const double focal_px : {camera.focal_x_px(), camera.focal_y_px()}) {
    if (focal_px / range >= std::numeric_limits<double>::min() && std::isfinite(focal_px * range)) {
      continue;
    }
    throw InputError(
        fmt::format("{}: query camera: no focal lengths within a factor of {} of {} px",
                    problem.name, range, focal_px));
  }
}

class RansacEstimator final : public PoseEstimator {
 public:
  explicit RansacEstimator(const EstimatorOptions& options)
      : options_(options), method_(Configure(options)) {}

  PoseEstimate Estimate(const PoseProblem& problem) const override {
    const double prior = problem.priors.focal_range;
    if (!(prior >= 1 && prior <= kMaxFocalRange)) {
      throw InputError(fmt::format("focal range prior: expected a factor from 1 to {}, found {}",
                                   kMaxFocalRange, prior));
    }
    const double range = std::max(options_.refine_focal ? options_.focal_range : 1, prior);
    const bool is_known = range == 1 || problem.query_camera.is_panorama();
    if (!is_known && !problem.other_cameras.empty()) {
      throw InputError(problem.name + ": the focal lengths of a rig's cameras must be known");
    }
    if (!is_known) RequireFocalRange(problem, range);
    return is_known ? EstimateWithCamera(problem) : EstimateWithFocal(problem, range);
  }

 private:
  PoseEstimate EstimateWithCamera(const PoseProblem& problem) const {
    Rng rng(StreamSeed(options_.seed, problem.name, ToString(options_.method)));
    const PreparedProblem prepared(problem, options_.reprojection_threshold_px,
                                   options_.sampson_threshold_px, rng, options_.point_sigma);
    PoseEstimate estimate;
    estimate.score_2d3d.num_matches = prepared.num_matches_2d3d;
    estimate.score_2d2d.num_matches = prepared.num_matches_2d2d;
    estimate.inliers_2d3d.assign(problem.matches_2d3d.size(), false);
    estimate.inliers_2d2d.assign(problem.matches_2d2d.size(), false);

    const P3pGenerator p3p(prepared);
    const KnownCenterGenerator known_center(prepared);
    const UprightGenerator upright(prepared);
    const E5p1Generator e5p1(prepared);
    std::vector<RansacSolver> solvers;
    if (method_.refined_after_p3p && P3pGenerator::CanSample(prepared)) {
      solvers.push_back({&p3p, Solver::kP3p, *method_.refined_after_p3p});
    }
    if (method_.refined_after_p3p && KnownCenterGenerator::CanSample(prepared)) {
      solvers.push_back({&known_center, Solver::kKnownCenter, *method_.refined_after_p3p});
    }
    if (method_.refined_after_p3p && UprightGenerator::CanSample(prepared)) {
      solvers.push_back({&upright, Solver::kUpright, *method_.refined_after_p3p});
    }
    if (method_.refined_after_e5p1 && E5p1Generator::CanSample(prepared)) {
      solvers.push_back({&e5p1, Solver::kE5p1, *method_.refined_after_e5p1});
    }
    std::optional<KeypointEvidence> evidence;
    std::optional<D3p1Generator> d3p1;
    if (method_.refined_after_d3p1) {
      evidence = GatherEvidence(problem, prepared);
      d3p1.emplace(prepared, *evidence);
      if (d3p1->CanSample()) {
        solvers.push_back({&*d3p1, Solver::kD3p1, *method_.refined_after_d3p1});
      }
    }
    if (solvers.empty()) {
      estimate.failure = WhyNoSample(prepared);
      return estimate;
    }
    // A set of which nothing can be used is none.
    const Objective objective(
        method_.scored_sets, method_.score, prepared.points.empty() ? 0 : prepared.num_matches_2d3d,
        prepared.pairs.empty() ? 0 : prepared.num_matches_2d2d, options_.refinement);
    const RansacReport report =
        RunRansac(prepared, objective, solvers, method_.schedule, options_, rng);
    estimate.iterations = report.iterations;
    if (!report.best) {
      estimate.failure = FailureReason::kNoConsistentSample;
      return estimate;
    }
    estimate.solver = report.best->solver;
    const RansacResult& best = *report.best;
    const Scorer scorer(prepared, objective);
    const auto value_of = [&](const SolverPose& pose) {
      return objective.Value(scorer.ScoreAll(pose));
    };
    const ResidualKinds finally = KindsOf(best.solver);
    FinalPose final_pose =
        RefineFinally(prepared, evidence, StartOf(best, prepared, finally), finally, options_);
    estimate.ransac_value = report.best_value;
    estimate.refined_value = value_of(final_pose.pose);
    // The likeliest pose rarely has the best score, but one that explains far less has lost its
    // way.
    const double nothing = objective.Value({{static_cast<double>(prepared.num_matches_2d3d), 0},
                                            {static_cast<double>(prepared.num_matches_2d2d), 0},
                                            prepared.priors.WorstCost()});
    if (!(nothing - estimate.refined_value > kKeptGain * (nothing - estimate.ransac_value))) {
      EstimatorOptions unrefined = options_;
      unrefined.refinement = Refinement::kPaper;
      final_pose = RefineFinally(prepared, evidence, best.pose, finally, unrefined);
      estimate.refined_value = estimate.ransac_value;
    }
    DescribePose(prepared, problem, final_pose, estimate);
    Judge(problem, prepared, report, final_pose.pose, solvers, estimate);
    CheckSupport(e5p1, estimate);
    return estimate;
  }

  // Where few matches are right, wrong pairs draw RANSAC's pose to their epipolar lines, which its
  // points alone let go of.
  SolverPose StartOf(const RansacResult& best, const PreparedProblem& prepared,
                     ResidualKinds finally) const {
    const bool is_joint = finally.points && finally.pairs;
    if (options_.refinement == Refinement::kPaper || !is_joint || best.solver != Solver::kP3p) {
      return best.pose;
    }
    constexpr ResidualKinds kPoints{.points = true, .pairs = false};
    return RefineFinally(prepared, std::nullopt, best.pose, kPoints, options_).pose;
  }

  FailureReason WhyNoSample(const PreparedProblem& problem) const {
    if (method_.refined_after_e5p1 && problem.pairs.size() >= 5) {
      return FailureReason::kNoReferencePair;
    }
    if (options_.method == Method::kD3p1 && problem.pairs.size() >= 4 &&
        problem.points.size() >= 3) {
      return FailureReason::kNoDepthPair;
    }
    return FailureReason::kTooFewMatches;
  }

  // How sure the pose is, against chance and against the other poses that were found.
  void Judge(const PoseProblem& problem, const PreparedProblem& prepared,
             const RansacReport& report, const SolverPose& pose,
             const std::vector<RansacSolver>& solvers, PoseEstimate& estimate) const {
    const ResidualKinds kinds{.points = method_.scored_sets != Objective::Sets::kPairs,
                              .pairs = method_.scored_sets != Objective::Sets::kPoints};
    // A sample gives some two poses; each solver has its share of the false alarms.
    const RansacSolver& solver = *std::find_if(
        solvers.begin(), solvers.end(),
        [&](const RansacSolver& candidate) { return candidate.solver == estimate.solver; });
    const double samples = std::min<double>(report.iterations, solver.generator->NumSamples());
    const double tried = 2.0 * samples * static_cast<double>(solvers.size());
    const bool drawn_by_prior =
        solver.solver == Solver::kKnownCenter || solver.solver == Solver::kUpright;
    const SupportAssessor assessor(problem, prepared, kinds, tried, drawn_by_prior ? 2 : 3);
    const Support support = assessor.Of(pose);
    estimate.num_keypoints = support.keypoints;
    estimate.inlier_keypoints = support.inlier_keypoints;
    const auto confidence_of = [](double log_false_alarms) {
      return 1 / (1 + std::exp(std::min(log_false_alarms, 700.0)));
    };
    estimate.confidence = confidence_of(support.log_false_alarms);
    // That a pose fits the priors says something if it was not made by them; that it does not makes
    // it doubtful, and takes none away.
    const double evidence = prepared.priors.LogEvidence(pose);
    if (evidence < 0 || !drawn_by_prior) {
      estimate.confidence = std::max(confidence_of(support.log_false_alarms - evidence),
                                     std::min(estimate.confidence, kLeastConfidence));
    }
    std::vector<SolverPose> others = report.rivals;
    if (options_.refinement == Refinement::kRobust && support.LeavesRoomForARival()) {
      const auto other = FindRival(problem, prepared, support.inlier, kinds, options_);
      if (other) others.push_back(prepared.CamFromLocal(*other));
    }
    for (const SolverPose& other : others) {
      const Support rival = assessor.Of(other);
      if (ExplainTheSame(support, rival)) continue;
      const double odds = evidence - prepared.priors.LogEvidence(other);
      estimate.confidence = std::min(
          estimate.confidence,
          ProbabilityOverRival(support, rival, assessor.IsBeyondChance(support, rival), odds));
    }
    // Where the position is in doubt the orientation holds all the same, so that it stays a pose.
    double of_position =
        assessor.ProbabilityOfPosition(pose, estimate.position_sigma / prepared.scale);
    if (!kinds.points) {
      of_position = std::min(of_position, assessor.ProbabilityOfDistance(pose, support));
    }
    estimate.confidence = std::min(estimate.confidence, std::max(kLeastConfidence, of_position));
    estimate.verdict = estimate.confidence >= kLocalizedConfidence ? PoseVerdict::kLocalized
                                                                   : PoseVerdict::kDoubtful;
  }

  // The focal length is refined at the best of the poses found with some in its range; the estimate
  // is then made anew, as a better focal length has more inliers.
  PoseEstimate EstimateWithFocal(const PoseProblem& problem, double range) const {
    const double focal_px = problem.query_camera.MeanFocalPx();
    EstimatorOptions fixed_focal = options_;
    fixed_focal.refine_focal = false;
    const RansacEstimator estimator(fixed_focal);
    PoseProblem changed = problem;
    std::optional<PoseEstimate> first;
    Camera camera;
    int iterations = 0;
    for (const Camera& candidate : FocalCandidates(problem.query_camera, range)) {
      changed.query_camera = candidate;
      PoseEstimate estimate = estimator.EstimateWithCamera(changed);
      iterations += estimate.iterations;
      const bool is_better =
          first && estimate.cam_from_world &&
          (!first->cam_from_world || estimate.refined_value < first->refined_value);
      if (!first || is_better) {
        first = std::move(estimate);
        camera = candidate;
      }
    }
    first->iterations = iterations;
    if (!first->cam_from_world) return *first;
    first->refined_camera = camera;
    if (!first->position_observable) return *first;
    changed.query_camera = camera;
    const FocalRefinement refined = RefineFocal(changed, *first->cam_from_world,
                                                KindsOf(first->solver), options_, focal_px, range);
    changed.query_camera = refined.camera;
    PoseEstimate second = estimator.EstimateWithCamera(changed);
    second.iterations += iterations;
    second.refined_camera = refined.camera;
    if (!second.cam_from_world || NumInliers(second) < kKeptGain * NumInliers(*first)) {
      DropCovariance(*first);  // it takes the camera for granted
      return *first;
    }
    if (refined.covariance_by_focal && second.covariance) {
      SetCovariance(*second.covariance + *refined.covariance_by_focal, second);
    } else {
      DropCovariance(second);
    }
    return second;
  }

  static int NumInliers(const PoseEstimate& estimate) {
    return estimate.score_2d3d.num_inliers + estimate.score_2d2d.num_inliers;
  }

  // Of the final refinement of a pose that this solver made.
  ResidualKinds KindsOf(Solver solver) const {
    if (method_.refined_finally) return *method_.refined_finally;
    switch (solver) {
      case Solver::kP3p:
      case Solver::kKnownCenter:
      case Solver::kUpright:
        return *method_.refined_after_p3p;
      case Solver::kE5p1:
        return *method_.refined_after_e5p1;
      case Solver::kD3p1:
        return *method_.refined_after_d3p1;
    }
    return {};
  }

  // A pose that its own minimal sample alone supports, or that chance supports as well, says
  // nothing.
  void CheckSupport(const E5p1Generator& e5p1, PoseEstimate& estimate) const {
    const bool enough_points = estimate.score_2d3d.num_inliers >= 3;
    const bool enough_pairs =
        estimate.score_2d2d.num_inliers >= (e5p1.PositionObservable() ? 6 : 5);
    const bool by_chance =
        options_.refinement == Refinement::kRobust && estimate.confidence < kLeastConfidence;
    const bool by_pairs = method_.refined_after_e5p1 || method_.refined_after_d3p1;
    const bool supported =
        (method_.refined_after_p3p && enough_points) || (by_pairs && enough_pairs);
    if (by_chance || !supported || !estimate.cam_from_world->IsFinite()) {
      estimate.cam_from_world.reset();
      estimate.verdict = PoseVerdict::kFailed;
      estimate.noise.reset();
      DropCovariance(estimate);
      estimate.failure = FailureReason::kNoConsistentSample;
      return;
    }
    estimate.position_observable = e5p1.PositionObservable() || options_.method == Method::kD3p1 ||
                                   (method_.refined_after_p3p && enough_points);
    if (!estimate.position_observable) {
      DropCovariance(estimate);
      estimate.verdict = PoseVerdict::kDoubtful;
    }
  }

  static void DropCovariance(PoseEstimate& estimate) {
    estimate.covariance.reset();
    estimate.rotation_sigma_deg = 0;
    estimate.position_sigma = 0;
  }

  EstimatorOptions options_;
  RansacMethod method_;
};

EstimatorOptions WithMethod(EstimatorOptions options, Method method) {
  options.method = method;
  return options;
}

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
  double alpha_;
  RansacEstimator p3p_;
  RansacEstimator e5p1_;
};

// P3P for each covisibility cluster, as hloc does (Sarlin et al., CVPR 2019).
class HlocEstimator final : public PoseEstimator {
 public:
  explicit HlocEstimator(const EstimatorOptions& options) : p3p_(options) {}

  PoseEstimate Estimate(const PoseProblem& problem) const override {
    const std::vector<int> clusters = ClustersOf(problem);
    std::set<int> names(clusters.begin(), clusters.end());
    if (names.empty()) names.insert(0);  // of points that no reference has
    std::optional<PoseEstimate> best;
    int iterations = 0;
    for (const int cluster : names) {
      PoseEstimate estimate = EstimateCluster(problem, clusters, cluster);
      iterations += estimate.iterations;
      const bool better =
          best && estimate.cam_from_world &&
          (!best->cam_from_world || estimate.score_2d3d.num_inliers > best->score_2d3d.num_inliers);
      if (better || !best) {
        best = std::move(estimate);
      }
    }
    best->iterations = iterations;
    return *best;
  }

 private:
  static std::vector<int> ClustersOf(const PoseProblem& problem) {
    if (problem.reference_clusters.empty()) return ClusterBySharedKeypoints(problem);
    if (problem.reference_clusters.size() != problem.references.size()) {
      throw InputError(
          fmt::format("reference_clusters: expected one for each of {} references, found {}",
                      problem.references.size(), problem.reference_clusters.size()));
    }
    return problem.reference_clusters;
  }

  // The estimate from the cluster's matches, its inliers counted among all matches of the problem.
  PoseEstimate EstimateCluster(const PoseProblem& problem, const std::vector<int>& clusters,
                               int cluster) const {
    PoseProblem part = problem;
    part.matches_2d3d.clear();
    std::vector<size_t> kept;
    for (size_t i = 0; i < problem.matches_2d3d.size(); ++i) {
      const auto& reference = problem.matches_2d3d[i].reference;
      const bool exists =
          reference && *reference >= 0 && static_cast<size_t>(*reference) < clusters.size();
      if (!reference || (exists && clusters[static_cast<size_t>(*reference)] == cluster)) {
        kept.push_back(i);
        part.matches_2d3d.push_back(problem.matches_2d3d[i]);
      }
    }
    PoseEstimate estimate = p3p_.Estimate(part);
    std::vector<bool> inliers(problem.matches_2d3d.size(), false);
    for (size_t k = 0; k < kept.size(); ++k) {
      inliers[kept[k]] = estimate.inliers_2d3d[k];
    }
    estimate.inliers_2d3d = std::move(inliers);
    const int left_out = static_cast<int>(problem.matches_2d3d.size() - kept.size());
    estimate.score_2d3d.num_matches += left_out;
    estimate.score_2d3d.msac_cost += left_out;
    return estimate;
  }

  RansacEstimator p3p_;
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
  positive(reprojection_threshold_px, "reprojection_threshold_px");
  positive(sampson_threshold_px, "sampson_threshold_px");
  Require(std::isfinite(alpha) && alpha >= 0, "alpha", fmt::format("{}", alpha),
          "must not be negative");
  Require(std::isfinite(point_sigma) && point_sigma >= 0, "point_sigma",
          fmt::format("{}", point_sigma), "must not be negative");
  if (scene_noise) {
    for (const KnownNoise& known :
         {scene_noise->keypoint_px, scene_noise->depth, scene_noise->common_depth}) {
      Require(known.errors >= 0 && std::isfinite(known.errors) && std::isfinite(known.sigma) &&
                  (known.errors == 0 || known.sigma > 0),
              "scene_noise", fmt::format("{} by {} errors", known.sigma, known.errors),
              "must be positive");
    }
    Require(scene_noise->keypoint_tail >= 0 && scene_noise->keypoint_tail <= 1,
            "scene_noise, keypoint_tail", fmt::format("{}", scene_noise->keypoint_tail),
            "must lie between 0 and 1");
  }
  Require(focal_range >= 1 && focal_range <= kMaxFocalRange, "focal_range",
          fmt::format("{}", focal_range), fmt::format("must lie between 1 and {}", kMaxFocalRange));
  Require(confidence > 0 && confidence < 1, "confidence", fmt::format("{}", confidence),
          "must lie between 0 and 1");
  Require(min_iterations >= 1, "min_iterations", fmt::format("{}", min_iterations),
          "must be at least 1");
  Require(max_iterations >= min_iterations, "max_iterations", fmt::format("{}", max_iterations),
          fmt::format("must not be below min_iterations = {}", min_iterations));
}

std::optional<SceneNoise> CommonNoise(std::span<const PoseEstimate> estimates) {
  std::vector<MatchNoise> noise;
  for (const PoseEstimate& estimate : estimates) {
    if (estimate.verdict == PoseVerdict::kLocalized && estimate.noise) {
      noise.push_back(*estimate.noise);
    }
  }
  if (noise.size() < kLeastForCommonNoise) return std::nullopt;
  return PoolNoise(noise);
}

std::unique_ptr<PoseEstimator> MakePoseEstimator(const EstimatorOptions& options) {
  options.Validate();
  switch (options.method) {
    case Method::kP3p:
    case Method::kE5p1:
    case Method::kD3p1:
    case Method::kAdaptive:
    case Method::kHybridRansac:
      return std::make_unique<RansacEstimator>(options);
    case Method::kSelect:
      return std::make_unique<SelectEstimator>(options);
    case Method::kHloc:
      return std::make_unique<HlocEstimator>(options);
  }
  return nullptr;
}

}  // namespace raylift
