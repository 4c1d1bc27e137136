#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/rng.h"
#include "estimation/confidence/confidence.h"
#include "estimation/methods/methods.h"
#include "estimation/problem/observations.h"
#include "estimation/refinement/refinement.h"
#include "estimation/refinement/single_set.h"

#include "raylift/geometry/residuals.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {
namespace {

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
    described.reference_factor = std::sqrt(noise.reference_scale);
    described.reference_rotation_deg = std::sqrt(noise.reference_rotation) * 180 / std::numbers::pi;
    described.reference_position = std::sqrt(noise.reference_center) * scale;
  }
  return described;
}

// Alternatives less likely than this are dropped.
constexpr double kLeastAlternative = 0.01;

// Returns whether poses are one within their covariances' sum, in 99.9 % of cases (chi-squared with
// six degrees of freedom); without both covariances, whether they are equal.
bool AreOne(const AlternativePose& a, const AlternativePose& b) {
  constexpr double kWithin = 22.5;
  const Vector6d step = StepBetween(a.cam_from_world, b.cam_from_world);
  if (!a.covariance || !b.covariance) return step.norm() < 1e-6;
  return step.dot((*a.covariance + *b.covariance).ldlt().solve(step)) < kWithin;
}

// Returns the covariance of a step in local units in those of the scene.
Matrix6d ToWorldUnits(const NormalizedProblem& problem, const Matrix6d& covariance) {
  Vector6d unit;
  unit << 1, 1, 1, problem.scale, problem.scale, problem.scale;
  return unit.asDiagonal() * covariance * unit.asDiagonal();
}

// Sets what follows from the final pose: scores, inliers, noise, covariance.
void DescribePose(const NormalizedProblem& problem, const RefinedPose& final_pose,
                  PoseEstimate& estimate) {
  estimate.cam_from_world = problem.ToWorld(final_pose.pose);
  const Residuals residuals = ComputeResiduals(problem, final_pose.pose);
  const auto describe = [](const auto& matches, const std::vector<double>& squared,
                           const std::vector<size_t>& repeats, MatchSetScore& score,
                           std::vector<bool>& inliers) {
    std::vector<double> costs(repeats.size(), 1);
    for (size_t i = 0; i < matches.size(); ++i) {
      // In this order, what is no number costs 1.
      costs[static_cast<size_t>(matches[i].match)] = std::min(1.0, squared[i]);
    }
    score = {.num_matches = static_cast<int>(repeats.size())};
    inliers.clear();
    for (const size_t match : repeats) {
      inliers.push_back(costs[match] < 1);
      score.num_inliers += inliers.back() ? 1 : 0;
      score.msac_cost += costs[match];
    }
  };
  describe(problem.matches_2d3d, residuals.of_2d3d, problem.repeats.of_2d3d, estimate.score_2d3d,
           estimate.inliers_2d3d);
  describe(problem.matches_2d2d, residuals.of_2d2d, problem.repeats.of_2d2d, estimate.score_2d2d,
           estimate.inliers_2d2d);

  if (final_pose.noise) {
    estimate.noise = Describe(*final_pose.noise, final_pose.references_disagree, problem.scale);
  }
  if (final_pose.covariance) {
    SetCovariance(ToWorldUnits(problem, *final_pose.covariance), estimate);
  }
}

// The samplers that a method names, but those for which the problem has no sample.
class Samplers {
 public:
  Samplers(const NormalizedProblem& problem, const std::vector<RansacMethod::Draws>& wanted,
           const std::optional<KeypointEvidence>& evidence, Refinement refinement)
      : p3p_(problem),
        known_center_(problem),
        upright_(problem),
        e5p1_(problem, SixthMatchesPerSample(refinement)) {
    if (evidence) d3p1_.emplace(problem, *evidence);
    for (const auto& [solver, optimized] : wanted) {
      if (const HypothesisSampler* sampler = Find(solver, problem)) {
        solvers_.push_back({sampler, solver, optimized});
      }
    }
  }
  Samplers(const Samplers&) = delete;
  Samplers& operator=(const Samplers&) = delete;

  const std::vector<RansacSolver>& solvers() const { return solvers_; }
  const HypothesisSampler& Of(Solver solver) const {
    return *std::find_if(solvers_.begin(), solvers_.end(), [&](const RansacSolver& candidate) {
              return candidate.solver == solver;
            })->sampler;
  }
  bool E5p1ObservesPosition() const { return e5p1_.PositionObservable(); }

 private:
  const HypothesisSampler* Find(Solver solver, const NormalizedProblem& problem) const {
    const auto if_able = [](const HypothesisSampler& sampler, bool is_able) {
      return is_able ? &sampler : nullptr;
    };
    switch (solver) {
      case Solver::kP3p:
        return if_able(p3p_, P3pSampler::CanSample(problem));
      case Solver::kKnownCenter:
        return if_able(known_center_, KnownCenterSampler::CanSample(problem));
      case Solver::kUpright:
        return if_able(upright_, UprightSampler::CanSample(problem));
      case Solver::kE5p1:
        return if_able(e5p1_, E5p1Sampler::CanSample(problem));
      case Solver::kD3p1:
        return d3p1_ && d3p1_->CanSample() ? &*d3p1_ : nullptr;
    }
    return nullptr;
  }

  P3pSampler p3p_;
  KnownCenterSampler known_center_;
  UprightSampler upright_;
  E5p1Sampler e5p1_;
  std::optional<D3p1Sampler> d3p1_;
  std::vector<RansacSolver> solvers_;
};

PoseEstimate WithoutPose(const PoseProblem& problem) {
  PoseEstimate estimate;
  estimate.score_2d3d.num_matches = static_cast<int>(problem.matches_2d3d.size());
  estimate.score_2d2d.num_matches = static_cast<int>(problem.matches_2d2d.size());
  estimate.inliers_2d3d.assign(problem.matches_2d3d.size(), false);
  estimate.inliers_2d2d.assign(problem.matches_2d2d.size(), false);
  return estimate;
}

// Returns the pose from which RANSAC's best one is refined. Where few matches are right, wrong
// 2D-2D matches draw it onto their epipolar lines; a refinement by the 2D-3D matches, which made
// the sample, frees it from them before the joint one.
CamFromLocal StartOfRefinement(const RansacResult& best, const NormalizedProblem& problem,
                               MatchSets refined, Refinement refinement) {
  const bool frees = refinement == Refinement::kRobust && refined == MatchSets::kBoth &&
                     best.solver == Solver::kP3p;
  if (!frees) return best.pose;
  MaximumLikelihood likelihood(problem, MatchSets::k2D3D);
  likelihood.Refine(best.pose);
  return likelihood.pose();
}

// Returns the problem through the lens that a pose was found with; nullopt where that is the given
// one.
std::optional<NormalizedProblem> Refocused(const NormalizedProblem& problem,
                                           const RefinedPose& refined) {
  if (refined.focal_error == 0) return std::nullopt;
  std::optional<NormalizedProblem> refocused = problem;
  refocused->TakeFocalError(refined.focal_error);
  return refocused;
}

// Counts the matches within three thresholds of a pose, the nearer the more.
double NearMatches(const NormalizedProblem& problem, const CamFromLocal& pose) {
  const Residuals residuals = ComputeResiduals(problem, pose);
  double sum = 0;
  for (const auto* of_set : {&residuals.of_2d3d, &residuals.of_2d2d}) {
    for (const double squared : *of_set) sum += 1 - std::min(squared / kNearSquared, 1.0);
  }
  return sum;
}

// Returns RANSAC's other poses, which give reason to doubt the refined one.
std::vector<CamFromLocal> OtherPoses(const RansacReport& report) {
  std::vector<CamFromLocal> poses = report.alternatives;
  if (!report.best_of_2d2d.empty()) poses.push_back(report.best->pose);
  for (const RansacResult& other : report.best_of_2d2d) poses.push_back(other.pose);
  return poses;
}

// Returns the distance within which pixels show one feature: a fourth of the noise, as two noisy
// pixels of one point are that near in one case of sixty, 1 - exp(-1/64). The noise is the scene's,
// if known, else the thresholds'. It is 0 for the paper's methods, which take each match for
// itself.
double SameWithinPx(const EstimatorOptions& options) {
  if (options.refinement != Refinement::kRobust) return 0;
  const double by_thresholds_px =
      std::min(options.reprojection_threshold_px, options.sampson_threshold_px) /
      kSigmasOfThreshold;
  const bool is_known = options.scene_noise && options.scene_noise->keypoint_px.errors > 4;
  return 0.25 * (is_known ? options.scene_noise->keypoint_px.sigma : by_thresholds_px);
}

// Returns the likeliest alternative where the priors favor it: between places that look alike, the
// number of references retrieved of each has decided.
std::optional<Rigid3> FavoredByPriors(const NormalizedProblem& problem, const CamFromLocal& pose,
                                      const PoseEstimate& estimate) {
  if (estimate.alternatives.empty()) return std::nullopt;
  const AlternativePose& other = estimate.alternatives.front();
  const bool is_of_priors = problem.priors.LogEvidence(problem.ToLocal(other.cam_from_world)) >
                            problem.priors.LogEvidence(pose);
  if (!is_of_priors || !(other.probability > estimate.confidence)) return std::nullopt;
  return other.cam_from_world;
}

}  // namespace

NormalizedProblem Normalize(const PoseProblem& problem, const EstimatorOptions& options, Rng& rng) {
  return {problem,
          options.reprojection_threshold_px,
          options.sampson_threshold_px,
          rng,
          options.point_sigma,
          SameWithinPx(options)};
}

PoseEstimate RansacEstimator::Estimate(const PoseProblem& problem) const {
  const std::optional<double> range = UnknownFocalRange(problem, options_);
  const double focal_sigma = FocalSigma(problem, options_);
  return range ? EstimateWithFocal(*this, problem, options_, *range)
               : EstimateWithCamera(problem, focal_sigma);
}

PoseEstimate RansacEstimator::EstimateWithCamera(const PoseProblem& problem,
                                                 double focal_sigma) const {
  Rng rng(StreamSeed(options_.seed, problem.name, ToString(options_.method)));
  NormalizedProblem normalized = Normalize(problem, options_, rng);
  normalized.TakeFocalSigma(problem, focal_sigma);
  PoseEstimate estimate = WithoutPose(problem);
  std::optional<KeypointEvidence> evidence;
  if (Draws(Solver::kD3p1)) evidence = GatherEvidence(problem, normalized);
  const Samplers samplers(normalized, method_.samplers, evidence, options_.refinement);
  if (samplers.solvers().empty()) {
    estimate.failure = WhyNoSample(normalized);
    return estimate;
  }
  const PoseScore pose_score = ScoreFor(normalized);
  RansacOptions ransac(options_);
  ransac.keeps_best_of_2d2d = UsesSceneNoise(options_) && samplers.E5p1ObservesPosition();
  const RansacReport report =
      RunRansac(normalized, pose_score, samplers.solvers(), method_.schedule, ransac, rng);
  estimate.iterations = report.iterations;
  if (!report.best) {
    estimate.failure = FailureReason::kNoConsistentSample;
    return estimate;
  }
  estimate.solver = report.best->solver;
  estimate.ransac_value = report.best_value;
  RefinedPose refined = Refine(normalized, evidence, pose_score, report, estimate);
  std::vector<CamFromLocal> others = OtherPoses(report);
  const auto conclude = [&](const RefinedPose& final_pose) {
    const double num_samples =
        std::min<double>(report.iterations, samplers.Of(estimate.solver).NumSamples());
    // A sample gives some two poses; each solver has its share of the false alarms.
    Describe(problem, normalized, final_pose,
             2.0 * num_samples * static_cast<double>(samplers.solvers().size()), others, estimate);
  };
  conclude(refined);
  if (const auto other = FavoredByPriors(normalized, refined.pose, estimate)) {
    others.push_back(refined.pose);
    const RansacReport of_other = ReportOf(normalized, pose_score, *other, estimate.solver);
    estimate.ransac_value = of_other.best_value;
    estimate.noise.reset();
    DropCovariance(estimate);
    refined = Refine(normalized, evidence, pose_score, of_other, estimate);
    conclude(refined);
  }
  // A pose between references that err as wholes may fit none of them; RANSAC's fits one at least.
  if (refined.references_disagree && estimate.confidence < kLeastConfidence) {
    estimate.noise.reset();
    DropCovariance(estimate);
    estimate.solver = report.best->solver;
    estimate.refined_value = estimate.ransac_value;
    conclude({.pose = report.best->pose, .covariance = std::nullopt});
  }
  RejectUnsupported(samplers.E5p1ObservesPosition(), estimate);
  RefineAlternatives(normalized, evidence, pose_score, estimate);
  return estimate;
}

// If the 2D-2D matches alone fit another pose best, the joint model's likelihood decides: it knows
// that the depths of a reference are wrong together.
//
// The likeliest pose rarely has the best score, but one that explains far less has lost its way:
// then RANSAC's pose is kept.
RefinedPose RansacEstimator::Refine(const NormalizedProblem& problem,
                                    const std::optional<KeypointEvidence>& evidence,
                                    const PoseScore& pose_score, const RansacReport& report,
                                    PoseEstimate& estimate) const {
  const MatchSets sets = RefinedSets(report.best->solver);
  const CamFromLocal start = StartOfRefinement(*report.best, problem, sets, options_.refinement);
  RefinedPose refined = RefineFinally(problem, evidence, start, sets, options_);
  if (!report.best_of_2d2d.empty() && refined.noise) {
    const auto with_scales = [&](const CamFromLocal& pose) {
      return RefineWithScales(problem, *evidence, pose, options_);
    };
    double best = with_scales(start).log_likelihood;
    for (const RansacResult& result : report.best_of_2d2d) {
      RefinedPose other = with_scales(result.pose);
      if (!(other.log_likelihood > best)) continue;
      best = other.log_likelihood;
      refined = std::move(other);
      estimate.solver = result.solver;
    }
  }
  const std::optional<NormalizedProblem> refocused = Refocused(problem, refined);
  const NormalizedProblem& seen = refocused ? *refocused : problem;
  estimate.refined_value = pose_score.Value(Scorer(seen, pose_score).ScoreAll(refined.pose));
  const double nothing = pose_score.Value({{static_cast<double>(problem.num_matches_2d3d), 0},
                                           {static_cast<double>(problem.num_matches_2d2d), 0},
                                           problem.priors.WorstCost()});
  // A pose between references that err as wholes is near many matches, and fits few.
  const bool explains_enough =
      refined.references_disagree
          ? NearMatches(seen, refined.pose) > kKeptGain * NearMatches(problem, report.best->pose)
          : nothing - estimate.refined_value > kKeptGain * (nothing - estimate.ransac_value);
  if (!explains_enough) {
    // The uncertainty of a pose whose matches err with their references is not known.
    const bool references_agree = !refined.references_disagree;
    refined = KeepPose(problem, report.best->pose, sets);
    if (!references_agree) refined.covariance.reset();
    estimate.refined_value = estimate.ransac_value;
    estimate.solver = report.best->solver;
  }
  return refined;
}

void RansacEstimator::Describe(const PoseProblem& problem, const NormalizedProblem& seen,
                               const RefinedPose& final_pose, double num_poses_tried,
                               const std::vector<CamFromLocal>& alternatives,
                               PoseEstimate& estimate) const {
  DescribePose(seen, final_pose, estimate);
  AssessConfidence(problem, seen,
                   {.pose = final_pose.pose,
                    .position_sigma = estimate.position_sigma / seen.scale,
                    .solver = estimate.solver,
                    .scored = method_.scored,
                    .num_poses_tried = num_poses_tried,
                    .alternatives = alternatives},
                   options_, estimate);
}

PoseEstimate RansacEstimator::RefineFrom(const PoseProblem& problem,
                                         const Rigid3& cam_from_world) const {
  Rng rng(StreamSeed(options_.seed, problem.name, "refine"));
  NormalizedProblem normalized = Normalize(problem, options_, rng);
  normalized.TakeFocalSigma(problem, FocalSigma(problem, options_));
  PoseEstimate estimate = WithoutPose(problem);
  std::optional<KeypointEvidence> evidence;
  if (Draws(Solver::kD3p1)) evidence = GatherEvidence(problem, normalized);
  const PoseScore pose_score = ScoreFor(normalized);
  estimate.solver = method_.samplers.front().solver;
  if (normalized.matches_2d3d.empty() && Draws(Solver::kE5p1)) estimate.solver = Solver::kE5p1;
  if (!cam_from_world.IsFinite()) {
    estimate.failure = FailureReason::kNoConsistentSample;
    return estimate;
  }
  const RansacReport report = ReportOf(normalized, pose_score, cam_from_world, estimate.solver);
  estimate.ransac_value = report.best_value;
  const RefinedPose refined = Refine(normalized, evidence, pose_score, report, estimate);
  const std::optional<NormalizedProblem> refocused = Refocused(normalized, refined);
  Describe(problem, refocused ? *refocused : normalized, refined, 1, {}, estimate);
  RejectUnsupported(E5p1Sampler(normalized).PositionObservable(), estimate);
  RefineAlternatives(normalized, evidence, pose_score, estimate);
  return estimate;
}

RansacReport RansacEstimator::ReportOf(const NormalizedProblem& problem,
                                       const PoseScore& pose_score, const Rigid3& cam_from_world,
                                       Solver solver) const {
  const MatchSets sets = RefinedSets(solver);
  RansacReport report;
  report.best = RansacResult{OptimizeLocally(problem, problem.ToLocal(cam_from_world), sets,
                                             kLocalSteps, OptimizedMatches::kAll),
                             solver, sets};
  report.best_value = pose_score.Value(Scorer(problem, pose_score).ScoreAll(report.best->pose));
  return report;
}

void RansacEstimator::RefineAlternatives(const NormalizedProblem& problem,
                                         const std::optional<KeypointEvidence>& evidence,
                                         const PoseScore& pose_score,
                                         PoseEstimate& estimate) const {
  const std::vector<AlternativePose> found = std::exchange(estimate.alternatives, {});
  if (!estimate.cam_from_world || !estimate.position_observable) return;
  std::vector<AlternativePose> taken = {{*estimate.cam_from_world, 1, estimate.covariance}};
  for (AlternativePose alternative : found) {
    const RansacReport report =
        ReportOf(problem, pose_score, alternative.cam_from_world, estimate.solver);
    PoseEstimate of_alternative;
    of_alternative.ransac_value = report.best_value;
    const RefinedPose refined = Refine(problem, evidence, pose_score, report, of_alternative);
    alternative.cam_from_world = problem.ToWorld(refined.pose);
    if (refined.covariance && refined.covariance->allFinite()) {
      alternative.covariance = ToWorldUnits(problem, *refined.covariance);
    }
    const double position_sigma =
        alternative.covariance ? std::sqrt(refined.covariance->bottomRightCorner<3, 3>().trace())
                               : 0;
    alternative.probability *=
        ProbabilityOfPosition(position_sigma, SceneDistance(problem, refined.pose, method_.scored));
    const bool is_other =
        std::none_of(taken.begin(), taken.end(),
                     [&](const AlternativePose& other) { return AreOne(other, alternative); });
    if (!is_other || !alternative.cam_from_world.IsFinite() ||
        !(alternative.probability > kLeastAlternative)) {
      continue;
    }
    taken.push_back(alternative);
  }
  estimate.alternatives.assign(taken.begin() + 1, taken.end());
  SortByProbability(estimate.alternatives);
}

MatchSets RansacEstimator::RefinedSets(Solver solver) const {
  if (method_.refined) return *method_.refined;
  return std::find_if(method_.samplers.begin(), method_.samplers.end(),
                      [&](const RansacMethod::Draws& draws) { return draws.solver == solver; })
      ->optimized;
}

bool RansacEstimator::Draws(Solver solver) const {
  return std::any_of(method_.samplers.begin(), method_.samplers.end(),
                     [&](const RansacMethod::Draws& draws) { return draws.solver == solver; });
}

// A set whose matches are all unusable counts as empty.
PoseScore RansacEstimator::ScoreFor(const NormalizedProblem& problem) const {
  return {method_.scored, method_.score,
          problem.matches_2d3d.empty() ? 0 : problem.num_matches_2d3d,
          problem.matches_2d2d.empty() ? 0 : problem.num_matches_2d2d, options_.refinement};
}

FailureReason RansacEstimator::WhyNoSample(const NormalizedProblem& problem) const {
  if (Draws(Solver::kE5p1) && problem.matches_2d2d.size() >= 5) {
    return FailureReason::kNoReferencePair;
  }
  if (options_.method == Method::kD3p1 && problem.matches_2d2d.size() >= 4 &&
      problem.matches_2d3d.size() >= 3) {
    return FailureReason::kNoDepthPair;
  }
  return FailureReason::kTooFewMatches;
}

// Rejects a pose with fewer inliers than a minimal sample has matches, or that chance explains.
void RansacEstimator::RejectUnsupported(bool e5p1_observes_position, PoseEstimate& estimate) const {
  const bool enough_2d3d = Draws(Solver::kP3p) && estimate.score_2d3d.num_inliers >= 3;
  const bool enough_2d2d = (Draws(Solver::kE5p1) || Draws(Solver::kD3p1)) &&
                           estimate.score_2d2d.num_inliers >= (e5p1_observes_position ? 6 : 5);
  const bool by_chance =
      options_.refinement == Refinement::kRobust && estimate.confidence < kLeastConfidence;
  if (by_chance || !(enough_2d3d || enough_2d2d) || !estimate.cam_from_world->IsFinite()) {
    estimate.cam_from_world.reset();
    estimate.verdict = PoseVerdict::kFailed;
    estimate.noise.reset();
    DropCovariance(estimate);
    estimate.failure = FailureReason::kNoConsistentSample;
    return;
  }
  estimate.position_observable =
      e5p1_observes_position || options_.method == Method::kD3p1 || enough_2d3d;
  if (!estimate.position_observable) {
    DropCovariance(estimate);
    estimate.verdict = PoseVerdict::kDoubtful;
  }
}

void SetCovariance(const Matrix6d& covariance, PoseEstimate& estimate) {
  DropCovariance(estimate);
  if (!covariance.allFinite()) return;
  estimate.covariance = covariance;
  estimate.rotation_sigma_deg =
      std::sqrt(covariance.topLeftCorner<3, 3>().trace()) * 180 / std::numbers::pi;
  // The center is -R' t: a step moves it by -R' v in the world, whatever w is, as both R and t turn
  // with w.
  estimate.position_sigma = std::sqrt(covariance.bottomRightCorner<3, 3>().trace());
}

void DropCovariance(PoseEstimate& estimate) {
  estimate.covariance.reset();
  estimate.rotation_sigma_deg = 0;
  estimate.position_sigma = 0;
}

}  // namespace raylift
