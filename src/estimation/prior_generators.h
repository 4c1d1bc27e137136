// Minimal samples where something is known of the pose beforehand: two 2D-3D matches, and a draw of
// what is known.

#pragma once

#include <limits>
#include <vector>

#include "estimation/hypothesis_generators.h"
#include "estimation/prepared_problem.h"

namespace raylift {

// The centre is drawn from the position's prior.
class KnownCentreGenerator final : public HypothesisGenerator {
 public:
  explicit KnownCentreGenerator(const PreparedProblem& problem);
  static bool CanSample(const PreparedProblem& problem);

  void Generate(Rng& rng, std::vector<SolverPose>& poses) const override;
  double SuccessProbability(const InlierCounts& inliers) const override;
  double NumSamples() const override { return std::numeric_limits<double>::infinity(); }

 private:
  const PreparedProblem& problem_;
  double share_near_ = 0;  // of draws that are as good as the centre, if the prior is right
};

// The vertical direction is drawn from gravity's prior.
class UprightGenerator final : public HypothesisGenerator {
 public:
  explicit UprightGenerator(const PreparedProblem& problem);
  static bool CanSample(const PreparedProblem& problem);

  void Generate(Rng& rng, std::vector<SolverPose>& poses) const override;
  double SuccessProbability(const InlierCounts& inliers) const override;
  double NumSamples() const override { return std::numeric_limits<double>::infinity(); }

 private:
  const PreparedProblem& problem_;
  double share_near_ = 0;
};

}  // namespace raylift
