// Minimal samples and the poses that they give: the three ways to make a hypothesis.

#pragma once

#include <vector>

#include "base/rng.h"
#include "estimation/joint_score.h"
#include "estimation/keypoint_evidence.h"
#include "estimation/prepared_problem.h"
#include "estimation/solvers/p3p.h"

namespace raylift {

class HypothesisGenerator {
 public:
  virtual ~HypothesisGenerator() = default;

  // Draws one sample and writes the poses that it gives (none for a degenerate sample).
  virtual void Generate(Rng& rng, std::vector<SolverPose>& poses) const = 0;

  // The probability that a sample is of inliers alone, if the inliers of a pose are the true ones.
  virtual double SuccessProbability(const InlierCounts& inliers) const = 0;

  // How many samples there are that differ.
  virtual double NumSamples() const = 0;
};

// Three 2D-3D matches, uniformly; of a rig, of whichever cameras.
class P3pGenerator final : public HypothesisGenerator {
 public:
  explicit P3pGenerator(const PreparedProblem& problem);
  static bool CanSample(const PreparedProblem& problem);

  void Generate(Rng& rng, std::vector<SolverPose>& poses) const override;
  double SuccessProbability(const InlierCounts& inliers) const override;
  double NumSamples() const override;

 private:
  const PreparedProblem& problem_;
};

// The pairs of all references whose center is another than one reference's, and those of a rig's
// other cameras with another center: one of them tells how far the query is from that reference.
class PairsElsewhere {
 public:
  PairsElsewhere(const PreparedProblem& problem, const ReferenceRun& run);

  bool empty() const { return count_ == 0; }
  int size() const { return count_; }
  const PreparedPair& Draw(const PreparedProblem& problem, Rng& rng) const;
  double InlierRatio(const InlierCounts& inliers) const;

 private:
  std::vector<ReferenceRun> runs_;
  int count_ = 0;
};

// Five 2D-2D matches of one reference and one of another with another center; references are drawn
// in proportion to their matches. Of a rig, the five are of one camera, and the sixth may be another
// camera's with the same reference, as the way between the cameras is known. Where all references share one center the length of the
// translation is not observable: then the sample is five matches, and the length is one local unit.
class E5p1Generator final : public HypothesisGenerator {
 public:
  explicit E5p1Generator(const PreparedProblem& problem);
  // Whether some reference has five matches.
  static bool CanSample(const PreparedProblem& problem);

  bool PositionObservable() const { return position_observable_; }

  void Generate(Rng& rng, std::vector<SolverPose>& poses) const override;
  double SuccessProbability(const InlierCounts& inliers) const override;
  double NumSamples() const override;

 private:
  // A reference for the five, and the pairs that may be the sixth.
  struct FiveSource {
    ReferenceRun run;
    PairsElsewhere sixth;
    int size() const { return run.size(); }
  };

  const PreparedProblem& problem_;
  std::vector<FiveSource> sources_;
  int num_five_ = 0;  // pairs of all sources together
  bool position_observable_ = false;
};

// Three 2D-2D matches of one reference that the geometry has lifted, whatever the scale of the
// reference's depths, and one match of another reference with another center; references are drawn
// in proportion to their lifted matches. Of a rig, cameras are as in E5+1.
class D3p1Generator final : public HypothesisGenerator {
 public:
  D3p1Generator(const PreparedProblem& problem, const KeypointEvidence& evidence);
  // Whether some reference has three lifted matches, and another a match.
  bool CanSample() const { return !sources_.empty(); }

  void Generate(Rng& rng, std::vector<SolverPose>& poses) const override;
  double SuccessProbability(const InlierCounts& inliers) const override;
  double NumSamples() const override;

 private:
  struct LiftedMatch {
    Eigen::Vector3d query_ray;
    Eigen::Matrix3d image_from_ray;     // of the query, as a PreparedPoint's
    Eigen::Vector3d point_from_center;  // world axes
  };
  // A reference for the three, and the pairs that may be the fourth.
  struct DepthSource {
    ReferenceRun run;
    std::vector<LiftedMatch> lifted;
    PairsElsewhere fourth;
    int size() const { return static_cast<int>(lifted.size()); }
  };

  // The share of the lifted matches whose points lie where the query sees them, once all of them
  // are moved along their rays by one factor.
  double InlierRatio(const DepthSource& source, const SolverPose& pose) const;

  const PreparedProblem& problem_;
  std::vector<DepthSource> sources_;
  int num_lifted_ = 0;  // matches of all sources together
};

}  // namespace raylift
