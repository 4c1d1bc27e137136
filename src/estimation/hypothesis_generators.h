// Minimal samples and the poses that they give: the two ways to make a hypothesis.

#pragma once

#include <vector>

#include "estimation/joint_score.h"
#include "estimation/prepared_problem.h"
#include "estimation/solvers/p3p.h"

#include "raylift/base/rng.h"

namespace raylift {

class HypothesisGenerator {
 public:
  virtual ~HypothesisGenerator() = default;

  // Draws one sample and writes the poses that it gives (none for a degenerate sample).
  virtual void Generate(Rng& rng, std::vector<SolverPose>& poses) const = 0;

  // The probability that a sample is of inliers alone, if the inliers of a pose are the true ones.
  virtual double SuccessProbability(const InlierCounts& inliers) const = 0;
};

// Three 2D-3D matches, uniformly.
class P3pGenerator final : public HypothesisGenerator {
 public:
  explicit P3pGenerator(const PreparedProblem& problem);
  static bool CanSample(const PreparedProblem& problem);

  void Generate(Rng& rng, std::vector<SolverPose>& poses) const override;
  double SuccessProbability(const InlierCounts& inliers) const override;

 private:
  const PreparedProblem& problem_;
};

// Five 2D-2D matches of one reference and one of another with another centre; references are drawn
// in proportion to their matches. Where all references share one centre the length of the
// translation is not observable: then the sample is five matches, and the length is one local unit.
class E5p1Generator final : public HypothesisGenerator {
 public:
  explicit E5p1Generator(const PreparedProblem& problem);
  // Whether some reference has five matches.
  static bool CanSample(const PreparedProblem& problem);

  bool PositionObservable() const { return position_observable_; }

  void Generate(Rng& rng, std::vector<SolverPose>& poses) const override;
  double SuccessProbability(const InlierCounts& inliers) const override;

 private:
  // A reference for the five, and the pairs that may be the sixth.
  struct FiveSource {
    ReferenceRun run;
    std::vector<ReferenceRun> sixth_runs;
    int num_sixth = 0;
  };

  const PreparedProblem& problem_;
  std::vector<FiveSource> sources_;
  int num_five_ = 0;  // pairs of all sources together
  bool position_observable_ = false;
};

}  // namespace raylift
