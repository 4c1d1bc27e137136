// Whether the inliers of a pose are there by chance.
//
// An a-contrario test (Moisan and Stival, IJCV 2004): how many poses with so many inliers would
// wrong matches give? Wrong matches fall anywhere, so each is an inlier with the share of the image
// that its threshold covers (more for uncertain points and references), or with the density of the
// residuals well beyond the threshold if that is larger. A keypoint counts once, in however many
// references it is matched; and keypoints that lie together count as fewer, as what repeats (a
// sign, a window) repeats with all of its keypoints. The logarithm of the expected number of such
// poses among those that were tried is bounded by Hoeffding's inequality.

#pragma once

#include <vector>

#include "estimation/match_residuals.h"
#include "estimation/prepared_problem.h"

namespace raylift {

struct Support {
  int keypoints = 0;         // that have matches
  int inlier_keypoints = 0;  // of which one is an inlier, of the kinds in use
  // The logarithm of the expected number of poses that chance supports as well.
  double log_false_alarms = 0;
  std::vector<bool> inlier;  // by keypoint, of the kinds in use
  double clustering = 1;     // inlier keypoints per place in the image
  double chance = 0;         // that a keypoint with wrong matches alone is an inlier, on average

  // Whether a rival that explains all the rest would make the pose doubtful.
  bool LeavesRoomForARival() const;
};

// Of poses of one problem. Holds a reference to it.
class SupportAssessor {
 public:
  // `points_of_sample`: how many 2D-3D matches fit the pose by construction.
  SupportAssessor(const PoseProblem& original, const PreparedProblem& problem, ResidualKinds kinds,
                  double num_poses_tried, int points_of_sample = 3);

  Support Of(const SolverPose& pose) const;

  // Whether the rival explains more of the keypoints that the best pose does not than chance would:
  // then the scene holds something twice, or one of them is wrong as a whole.
  bool IsBeyondChance(const Support& best, const Support& rival) const;

  // The probability that the pose is right in its distance from the reference that explains most of
  // its pairs: those fit at any distance, so that pairs of other references (or of other cameras of
  // a rig) alone tell it, and they
  // must explain more keypoints than where the pose is moved along that line (by a good part of the
  // references' spread; 1 where no such move is one). `support`: of the pose.
  double ProbabilityOfDistance(const SolverPose& pose, const Support& support) const;

  // The probability that the position errs by less than the distances that it is measured by: from
  // the references, among them, or to the points that fit. What errs by more says nothing of where
  // the camera is, however many matches agree (on the sky, or far away). `position_sigma` in local
  // units; 0: not known, which speaks for nothing.
  double ProbabilityOfPosition(const SolverPose& pose, double position_sigma) const;

 private:
  // By how much uncertain points and references widen the area or the width of an inlier, on
  // average.
  double PointWidening(const SolverPose& pose) const;
  double PairWidening() const;
  std::vector<PreparedPair> InlierPairs(const SolverPose& pose) const;

  const PreparedProblem& problem_;
  ResidualKinds kinds_;
  double num_poses_tried_;
  int points_of_sample_;
  double area_px2_;
  std::vector<int> place_;  // of each keypoint, in the image
};

// Whether two poses explain mostly the same keypoints: then they are one answer.
bool ExplainTheSame(const Support& a, const Support& b);

// The probability that the first of two poses is right if one of them is, from the keypoints that
// only one of them explains, and the logarithm of the odds for it beforehand. Where the rival is
// beyond chance, keypoints do not speak each for itself: that many agree says that they show one
// thing, not that it is the right one. They count as two witnesses then, each of them right with the
// share of the keypoints that agree with it.
double ProbabilityOverRival(const Support& best, const Support& rival, bool beyond_chance,
                            double log_odds = 0);

}  // namespace raylift
