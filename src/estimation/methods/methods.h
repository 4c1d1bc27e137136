// The methods as configurations of one LO-RANSAC: the samplers that draw, the score by which poses
// are compared, the matches that optimize a new best pose locally, and those that refine the last
// one.

#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "estimation/problem/normalized_problem.h"
#include "estimation/ransac/ransac.h"

#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"

namespace raylift {

struct RefinedPose;

struct RansacMethod {
  // A sampler, used where the problem has what it draws, and the matches that optimize its poses
  // locally.
  struct Draws {
    Solver solver;
    MatchSets optimized;
  };
  std::vector<Draws> samplers;
  SolverSchedule schedule = SolverSchedule::kAll;
  MatchSets scored;
  ScoreCombination score;
  // The final refinement takes these matches; with nullopt it takes those that optimized the pose.
  std::optional<MatchSets> refined = std::nullopt;
};
RansacMethod P3pMethod(const EstimatorOptions& options);
RansacMethod E5p1Method(const EstimatorOptions& options);
// Returns the one RANSAC of a method: for HLoc that of each cluster, for Select the first one.
RansacMethod RansacMethodOf(const EstimatorOptions& options);

// A refined pose keeps at least this share of what RANSAC's gains over a pose that nothing fits.
inline constexpr double kKeptGain = 0.5;

// Returns the problem normalized by these options, its repeats found.
NormalizedProblem Normalize(const PoseProblem& problem, const EstimatorOptions& options, Rng& rng);

// Estimates a problem's pose by any of those methods.
class RansacEstimator final : public PoseEstimator {
 public:
  RansacEstimator(const EstimatorOptions& options, RansacMethod method)
      : options_(options), method_(std::move(method)) {}

  PoseEstimate Estimate(const PoseProblem& problem) const override;
  // Takes the focal length of the query's camera for granted, but for errors of this share of it
  // (standard deviation).
  PoseEstimate EstimateWithCamera(const PoseProblem& problem, double focal_sigma = 0) const;
  // Refines a pose without RANSAC.
  PoseEstimate RefineFrom(const PoseProblem& problem, const Rigid3& cam_from_world) const;

  MatchSets scored() const { return method_.scored; }
  // Returns the matches that refine a pose which this solver made.
  MatchSets RefinedSets(Solver solver) const;

 private:
  bool Draws(Solver solver) const;
  PoseScore ScoreFor(const NormalizedProblem& problem) const;
  // Refines RANSAC's pose, and sets the values by which the estimate compares both.
  RefinedPose Refine(const NormalizedProblem& problem,
                     const std::optional<KeypointEvidence>& evidence, const PoseScore& pose_score,
                     const RansacReport& report, PoseEstimate& estimate) const;
  // Sets the estimate's scores, inliers, covariance and confidence at the final pose, by the
  // residuals in `seen`.
  void Describe(const PoseProblem& problem, const NormalizedProblem& seen,
                const RefinedPose& final_pose, double num_poses_tried,
                const std::vector<CamFromLocal>& alternatives, PoseEstimate& estimate) const;
  // Refines the estimate's alternatives, and drops those that become one of the others, or whose
  // position the matches hardly determine.
  void RefineAlternatives(const NormalizedProblem& problem,
                          const std::optional<KeypointEvidence>& evidence,
                          const PoseScore& pose_score, PoseEstimate& estimate) const;
  // Optimizes a given pose locally, and reports it as RANSAC reports its best one.
  RansacReport ReportOf(const NormalizedProblem& problem, const PoseScore& pose_score,
                        const Rigid3& cam_from_world, Solver solver) const;
  FailureReason WhyNoSample(const NormalizedProblem& problem) const;
  void RejectUnsupported(bool e5p1_observes_position, PoseEstimate& estimate) const;

  EstimatorOptions options_;
  RansacMethod method_;
};

// Sets the covariance and the standard deviations that follow from it; leaves them out where it is
// not finite.
void SetCovariance(const Matrix6d& covariance, PoseEstimate& estimate);
void DropCovariance(PoseEstimate& estimate);

// Selects the P3P pose if it has more than `alpha` times the 2D-2D inliers of the E5+1 pose, which
// is taken otherwise (Eq. 6).
PoseEstimate SelectPose(PoseEstimate p3p, PoseEstimate e5p1, double alpha);
std::unique_ptr<PoseEstimator> MakeSelectEstimator(const EstimatorOptions& options);

std::unique_ptr<PoseEstimator> MakeHlocEstimator(const EstimatorOptions& options);
// Returns the cluster of each reference, numbered by first member from 0, for problems whose
// clusters are not known from an SfM model: references are linked where a query keypoint matches
// both.
std::vector<int> ClusterBySharedKeypoints(const PoseProblem& problem);

// Returns the standard deviation of the query's focal length as a share of it. Throws InputError
// where the problem's priors have one out of range.
double FocalSigma(const PoseProblem& problem, const EstimatorOptions& options);
// Returns the factor within which the query's focal length is to be found; nullopt where the
// camera's holds. Throws InputError for a prior or a camera with which it cannot be looked for.
std::optional<double> UnknownFocalRange(const PoseProblem& problem,
                                        const EstimatorOptions& options);
// Finds the focal length with the pose, by any method's estimator.
PoseEstimate EstimateWithFocal(const RansacEstimator& estimator, const PoseProblem& problem,
                               const EstimatorOptions& options, double range);

}  // namespace raylift
