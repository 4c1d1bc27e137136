// Minimal samples and the poses that they give.

#pragma once

#include <array>
#include <limits>
#include <vector>

#include "base/rng.h"
#include "estimation/problem/normalized_problem.h"
#include "estimation/problem/observations.h"
#include "estimation/ransac/scores.h"

#include "raylift/estimation/options.h"

namespace raylift {

class HypothesisSampler {
 public:
  virtual ~HypothesisSampler() = default;

  // Draws one sample and writes the poses that it gives (none for a degenerate sample).
  virtual void Sample(Rng& rng, std::vector<CamFromLocal>& poses) const = 0;

  // Returns the probability that a sample is of inliers alone, if the inliers of a pose are the
  // true ones.
  virtual double SuccessProbability(const InlierCounts& inliers) const = 0;

  // Returns the number of different samples.
  virtual double NumSamples() const = 0;
};

// Draws three 2D-3D matches uniformly; of a rig, of whichever cameras.
class P3pSampler final : public HypothesisSampler {
 public:
  explicit P3pSampler(const NormalizedProblem& problem);
  static bool CanSample(const NormalizedProblem& problem);

  void Sample(Rng& rng, std::vector<CamFromLocal>& poses) const override;
  double SuccessProbability(const InlierCounts& inliers) const override;
  double NumSamples() const override;

 private:
  const NormalizedProblem& problem_;
};

// The 2D-2D matches that tell how far the query is from a group's reference: those with references
// at another center, and those of a rig's cameras at another center.
class MatchesElsewhere {
 public:
  MatchesElsewhere(const NormalizedProblem& problem, const MatchGroup& group);

  bool empty() const { return count_ == 0; }
  int size() const { return count_; }
  const NormalizedMatch2D2D& Draw(const NormalizedProblem& problem, Rng& rng) const;
  double InlierRatio(const InlierCounts& inliers) const;

 private:
  std::vector<MatchGroup> groups_;
  int count_ = 0;
};

// Returns how many sixth matches are tried for each essential matrix of E5+1, as they cost little
// beside the five-point solver. The paper draws one sample of 5+1 (Sec. 3).
constexpr int SixthMatchesPerSample(Refinement refinement) {
  return refinement == Refinement::kPaper ? 1 : 2;
}

// Draws five 2D-2D matches of one reference, and some of others with another center, each of which
// gives the poses a length; references are drawn in proportion to their matches. Of a rig, the five
// are of one camera, and the sixth may be another camera's with the same reference, as the way
// between the cameras is known. Where all references share one center the length of the translation
// is not observable: then the sample is five matches, and the length is one local unit.
class E5p1Sampler final : public HypothesisSampler {
 public:
  explicit E5p1Sampler(const NormalizedProblem& problem,
                       int sixth_matches = SixthMatchesPerSample(Refinement::kRobust));
  // Returns whether some reference has five matches with one camera.
  static bool CanSample(const NormalizedProblem& problem);

  bool PositionObservable() const { return position_observable_; }

  void Sample(Rng& rng, std::vector<CamFromLocal>& poses) const override;
  double SuccessProbability(const InlierCounts& inliers) const override;
  double NumSamples() const override;

 private:
  // A reference for the five, and the matches that may be the sixth.
  struct FiveSource {
    MatchGroup group;
    MatchesElsewhere sixth;
    int size() const { return group.size(); }
  };

  const NormalizedProblem& problem_;
  int sixth_matches_;  // per sample
  std::vector<FiveSource> sources_;
  int num_five_ = 0;  // matches of all sources together
  bool position_observable_ = false;
};

// Draws three 2D-2D matches of one reference that the geometry has lifted (to the keypoint's ray
// or, as SfM's points lie, within the threshold of it), whatever the scale of the reference's
// depths, and one match of another reference with another center; references are drawn in
// proportion to their lifted matches. Of a rig, cameras are as in E5+1.
class D3p1Sampler final : public HypothesisSampler {
 public:
  D3p1Sampler(const NormalizedProblem& problem, const KeypointEvidence& evidence);
  // Returns whether some reference has three lifted matches, and one at another center a match.
  bool CanSample() const { return !sources_.empty(); }

  void Sample(Rng& rng, std::vector<CamFromLocal>& poses) const override;
  double SuccessProbability(const InlierCounts& inliers) const override;
  double NumSamples() const override;

 private:
  struct LiftedMatch {
    Eigen::Vector3d query_ray;
    Eigen::Matrix3d image_from_ray;     // of the query, as a NormalizedMatch2D3D's
    Eigen::Vector3d point_from_center;  // world axes
  };
  // A reference for the three, and the matches that may be the fourth.
  struct DepthSource {
    MatchGroup group;
    std::vector<LiftedMatch> lifted;
    MatchesElsewhere fourth;
    int size() const { return static_cast<int>(lifted.size()); }
  };

  // Returns the share of the lifted matches whose points project within three thresholds of their
  // pixels, once all points are moved along their rays by one factor.
  double InlierRatio(const DepthSource& source, const CamFromLocal& pose) const;

  const NormalizedProblem& problem_;
  std::vector<DepthSource> sources_;
  int num_lifted_ = 0;  // matches of all sources together
};

// Minimal samples with a prior of the pose: two 2D-3D matches, and a draw of the prior.

// The base of both samplers: draws two matches, and weighs their success by the prior's
// probability.
class PriorSampler : public HypothesisSampler {
 public:
  double SuccessProbability(const InlierCounts& inliers) const override;
  double NumSamples() const override { return std::numeric_limits<double>::infinity(); }

 protected:
  explicit PriorSampler(const NormalizedProblem& problem) : problem_(problem) {}

  struct TwoPoints {
    std::array<Eigen::Vector3d, 2> centers, rays, points;  // of the cameras that see them
  };
  TwoPoints Draw(Rng& rng) const;
  virtual double ProbabilityOfPrior(const CamFromLocal& pose) const = 0;

  const NormalizedProblem& problem_;
  double share_near_ = 0;  // of draws that are as good as the truth, if the prior is right
};

// Draws two matches, and the center from the position's prior.
class KnownCenterSampler final : public PriorSampler {
 public:
  explicit KnownCenterSampler(const NormalizedProblem& problem);
  static bool CanSample(const NormalizedProblem& problem);

  void Sample(Rng& rng, std::vector<CamFromLocal>& poses) const override;

 private:
  double ProbabilityOfPrior(const CamFromLocal& pose) const override;
};

// Draws two matches, and the vertical direction from gravity's prior.
class UprightSampler final : public PriorSampler {
 public:
  explicit UprightSampler(const NormalizedProblem& problem);
  static bool CanSample(const NormalizedProblem& problem);

  void Sample(Rng& rng, std::vector<CamFromLocal>& poses) const override;

 private:
  double ProbabilityOfPrior(const CamFromLocal& pose) const override;
};

}  // namespace raylift
