// Assesses a pose: the probability that it is right, and the alternatives to it.
//
//   confidence = min(P_chance, P_alternative, P_patch, P_points, max(0.05, P_position))
//
//   P_chance       The inliers are not there by chance: 1 / (1 + NFA / L), with the expected number
//                  of false alarms NFA (below) and how much likelier the priors make the pose, L.
//   P_alternative  No other pose explains the matches as well: 1 / (1 + the sum of the odds against
//                  it) of those that RANSAC found and of one that is looked for in what the pose
//                  leaves unexplained, as far as they are different answers.
//   P_patch        1/2 where the inliers lie on a small part of what is matched.
//   P_points       1/2 where the points of the keypoints that fit by their 2D-2D matches do not
//                  fit.
//   P_position     The matches tell where the camera is: within 1.25 % of the distance to the
//                  scene, and not by chance along the line on which the dominant reference leaves
//                  it. Where they do not, the orientation holds all the same: so no less than what
//                  is needed for a pose.
//
// NFA is an a-contrario test (Moisan and Stival, IJCV 2004): how many poses with so many inliers
// would wrong matches give? Wrong matches fall anywhere, so each is an inlier with the share of the
// area of all matches that its threshold covers (more for uncertain points and references), or with
// the density of the residuals well beyond the threshold if that is larger. A keypoint counts once,
// in however many references it is matched; and keypoints that lie together count as fewer, as what
// repeats (a sign, a window) repeats with all of its keypoints. The logarithm of the expected
// number of such poses among those that were tried is bounded by Hoeffding's inequality.

#pragma once

#include <optional>
#include <vector>

#include "estimation/problem/normalized_problem.h"

#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"

namespace raylift {

// The least confidence of a pose: one as surely wrong as a localized one is right is rejected.
inline constexpr double kLeastConfidence = 1 - kLocalizedConfidence;

// The largest share of a window or a sign, which a scene may hold twice: of what the photograph
// shows, or of the keypoints that speak for one of two poses. Anything larger is a place of its
// own.
inline constexpr double kOnePlace = 0.25;

struct AssessedPose {
  CamFromLocal pose;
  double position_sigma;  // local units; 0: not known
  Solver solver;          // that made it
  MatchSets scored;       // by which it was chosen
  double num_poses_tried;
  std::vector<CamFromLocal> alternatives;  // that RANSAC found
};

// Sets the estimate's confidence, verdict, counts of keypoints and alternatives (not yet refined,
// without a covariance).
void AssessConfidence(const PoseProblem& problem, const NormalizedProblem& normalized,
                      const AssessedPose& assessed, const EstimatorOptions& options,
                      PoseEstimate& estimate);

// Puts the likeliest first.
void SortByProbability(std::vector<AlternativePose>& alternatives);

// Sets the confidence to min(confidence, max(kLeastConfidence, of_position)), and the verdict that
// follows.
void Conclude(double confidence, double of_position, PoseEstimate& estimate);

// Returns the logarithm of Hoeffding's bound on the probability that at least k = `successes` of n
// = `trials` independent trials succeed, each with the probability `chance`: -n KL(k / n, chance).
double LogBinomialTail(double trials, double successes, double chance);

// IsInRing() returns whether a squared residual lies between 5 and 15 thresholds, where wrong
// residuals are counted, as even inaccurate right ones are rare there. RingPerInlier() returns how
// many wrong residuals lie there for each one within the threshold: their number grows with the
// `dimensions`th power of their limit.
bool IsInRing(double squared);
double RingPerInlier(int dimensions);

// The evidence of a pose's inliers for it, of the match sets in use.
struct InlierEvidence {
  CamFromLocal pose = {};
  int keypoints = 0;         // that have matches
  int inlier_keypoints = 0;  // of which one match is an inlier
  // The logarithm of the expected number of poses that chance supports as well.
  double log_false_alarms = 0;
  // Holds one flag for each match, true for an inlier: the 2D-3D matches, then the 2D-2D matches,
  // of the sets in use.
  std::vector<bool> inlier = {};
  double clustering = 1;  // inlier keypoints per cell of the image
  double chance = 0;      // that a keypoint with wrong matches alone is an inlier, on average
  // `paired` counts the keypoints that have both a 2D-3D match and a 2D-2D inlier, `paired_right`
  // those of them that are not due to chance, and `paired_agreeing` those that have a 2D-3D inlier.
  int paired = 0;
  double paired_right = 0;
  int paired_agreeing = 0;
  double line_chance = 0;  // that the point of one such keypoint agrees if its depth is wrong

  // Returns whether an alternative that explains all the rest would make the pose doubtful.
  bool LeavesRoomForAnAlternative() const;
};

// Counts the keypoints that speak for one of two poses: those of which it explains more matches
// than the other one does. Where they are of two places that look alike, how many references of
// which place were retrieved says nothing: then all keypoints that each explains in its references.
struct ExclusiveInliers {
  double only_first = 0, only_second = 0;
  double left = 0;  // that have a match which the first does not explain

  // Returns the probability that the first is right if one of them is, each keypoint speaking for
  // itself; nullopt where there is no such keypoint.
  std::optional<double> ProbabilityOfFirst(double clustering) const;
};

// Returns the probability a^2 / (a^2 + b^2) that the first of two sets of keypoints beyond chance
// is the right one: each set counts as one witness, right with the share that agrees with it.
double ProbabilityOfLarger(double first, double second);

// Assesses poses of one problem, to which it holds references.
class InlierAssessor {
 public:
  // `sample_2d3d` 2D-3D matches fit the pose by construction.
  InlierAssessor(const PoseProblem& original, const NormalizedProblem& problem, MatchSets sets,
                 double num_poses_tried, int sample_2d3d = 3);

  InlierEvidence Assess(const CamFromLocal& pose) const;

  // Returns what only one of two poses explains; nullopt where they explain mostly the same
  // matches, and are one answer.
  std::optional<ExclusiveInliers> Compare(const InlierEvidence& first,
                                          const InlierEvidence& second) const;

  // Returns whether more of the keypoints that the best pose leaves a match of speak for the
  // alternative than chance would have: then the scene holds something twice, or one of them is
  // wrong as a whole.
  bool IsBeyondChance(const InlierEvidence& alternative, const ExclusiveInliers& exclusive) const;

  // Returns the share of the keypoints with matches that lie as near to the middle of the inliers
  // as two thirds of these do, over two thirds: 1 where inliers are spread as all are.
  double ShareNearInliers(const InlierEvidence& evidence) const;

  // Returns whether the geometry is there and does not agree with the pose. A right 2D-2D match has
  // its point within the threshold, which is kSigmasOfThreshold stated standard deviations; if pose
  // or geometry is wrong, the point may be anywhere on the match's epipolar line. So points
  // disagree if no more of them fit than by chance, and fewer than with a right pose.
  bool PointsDisagree(const InlierEvidence& evidence) const;

 private:
  // Returns the keypoint of a match, which is numbered as in InlierEvidence::inlier.
  size_t KeypointOf(size_t match) const;
  // Compares poses of two places that look alike as wholes, each with references that speak for it
  // (places.cc); nullopt for all other poses.
  std::optional<ExclusiveInliers> CompareAsPlaces(const InlierEvidence& first,
                                                  const InlierEvidence& second) const;
  // Returns the reference of each match of the sets in use; nullopt where it is of none.
  std::vector<std::optional<size_t>> ReferencesOfMatches() const;
  // Returns the flags of the keypoints that have one of these matches.
  std::vector<bool> KeypointsOf(const std::vector<bool>& matches) const;
  // Returns whether a reference sees at least a fourth of these matches' 3D points, or there is
  // none.
  bool SeesPointsOf(const std::vector<bool>& matches, const PosedImage& reference) const;
  // Returns whether a pose, which `references` speak for and which explains the keypoints
  // `explained`, has some of these in three of four parts of the photograph in which `others` are
  // and which the references show.
  bool ExplainsAll(const CamFromLocal& pose, const std::vector<PosedImage>& references,
                   const std::vector<bool>& explained, const std::vector<bool>& others) const;
  // Return the mean factor by which uncertain points widen the area of a 2D-3D inlier, and
  // uncertain references the width of a 2D-2D inlier.
  double Widening2D3D(const CamFromLocal& pose) const;
  double Widening2D2D() const;

  const PoseProblem& original_;
  const NormalizedProblem& problem_;
  MatchSets sets_;
  double num_poses_tried_;
  int sample_2d3d_;
  double area_px2_;
  std::vector<int> cell_;  // of the image, that each keypoint lies in
  std::vector<Eigen::Vector2d> pixel_;
  std::vector<int> camera_;  // of each keypoint
};

// Returns the probability that the first of two poses is right if one of them is, from the
// keypoints that speak for one of them and the prior log odds for it. If the alternative is beyond
// chance, keypoints do not speak each for itself: that many agree says that they show one thing,
// not that it is the right one. They count as two witnesses then, each of them right with the share
// of the keypoints that agree with it. But an alternative that is more than a window or a sign
// (kOnePlace) is another place as a whole: how many keypoints were matched there says nothing, and
// it is 1/2.
double ProbabilityOverAlternative(const ExclusiveInliers& exclusive, double clustering,
                                  bool beyond_chance, double log_odds = 0);

// The number of samples of which, with 95 % probability, one is of right matches alone where one in
// 64 is: three of a quarter, six of a half.
inline constexpr int kAlternativeSamples = 191;

// Looks for a pose among the matches that the pose does not explain (InlierEvidence::inlier), by
// samples of three 2D-3D matches where these are of the scored sets and left, of E5+1 otherwise. Of
// the 2D-3D matches only those of the reference that most are left of are looked at. If there is
// one, the scene holds something twice, or one of the two poses is wrong as a whole. nullopt where
// none is found.
std::optional<Rigid3> FindAlternative(const PoseProblem& problem,
                                      const NormalizedProblem& normalized,
                                      const std::vector<bool>& explained, MatchSets scored,
                                      const EstimatorOptions& options);

// A position is right within this share of the distance to the scene: a quarter of a meter at
// twenty, the finest threshold in use outdoors, and 3 cm in a room.
inline constexpr double kRightPosition = 0.0125;

// Returns the median distance from the camera to the inliers' points, local units; 1 without
// inliers.
double SceneDistance(const NormalizedProblem& problem, const CamFromLocal& pose, MatchSets sets);

// The uncertainty of the scale of one reference's depths.
struct DepthScale {
  double depth_sigma = 0;  // of one depth, relative
  std::optional<double> known_sigma =
      std::nullopt;  // of the scale itself, where it is known before

  // Returns the probability that the scale errs by no more than a share: by a normal distribution
  // where its standard deviation is known; else by Cauchy's distribution (Student's t with one
  // degree of freedom), as wide as the error of one depth.
  double ProbabilityWithin(double share) const;
};

// Returns the probability that the pose is right in its distance from the reference that explains
// most of its 2D-2D matches; 1 where no 2D-2D match is explained, or the camera is at that
// reference. Those matches fit at any distance, so that others alone tell it: those with other
// references (or of other cameras of a rig), and that reference's depths. They are two witnesses.
// For each, more keypoints must speak for the pose than for any place elsewhere on that line, and
// more than chance has agree there, as what few among many agree on is chance's. If others'
// agreement may be chance and the depths' scale may not hold, the distance is right by luck.
double ProbabilityOfDistance(const NormalizedProblem& problem, const CamFromLocal& pose,
                             MatchSets sets, double scene_distance, const DepthScale& scale,
                             const InlierEvidence& evidence);

// Returns whether the depths of the reference that explains most 2D-2D matches would agree with the
// pose if all were longer or shorter by one factor, between 1/2 and 2: more keypoints than chance
// has agree on one. Then pose and geometry are right but for its scale.
bool DepthsAgreeUpToFactor(const NormalizedProblem& problem, const CamFromLocal& pose,
                           double scene_distance, const InlierEvidence& evidence);

// Returns the probability that the position is right (kRightPosition) by its standard deviation;
// both arguments are in local units. 1/2 for a standard deviation of 0 (not known).
double ProbabilityOfPosition(double position_sigma, double scene_distance);

}  // namespace raylift
