// Minimal samples where something is known of the pose beforehand: two 2D-3D matches, and a draw of
// what is known.

#pragma once

#include <array>
#include <limits>
#include <vector>

#include "estimation/hypothesis_generators.h"
#include "estimation/prepared_problem.h"

namespace raylift {

// What both have in common.
class PriorGenerator : public HypothesisGenerator {
 public:
  double SuccessProbability(const InlierCounts& inliers) const override;
  double NumSamples() const override { return std::numeric_limits<double>::infinity(); }

 protected:
  explicit PriorGenerator(const PreparedProblem& problem) : problem_(problem) {}

  struct TwoPoints {
    std::array<Eigen::Vector3d, 2> centers, rays, points;  // of the cameras that see them
  };
  TwoPoints Draw(Rng& rng) const;
  virtual double ProbabilityOfPrior(const SolverPose& pose) const = 0;

  const PreparedProblem& problem_;
  double share_near_ = 0;  // of draws that are as good as the truth, if the prior is right
};

// The center is drawn from the position's prior.
class KnownCenterGenerator final : public PriorGenerator {
 public:
  explicit KnownCenterGenerator(const PreparedProblem& problem);
  static bool CanSample(const PreparedProblem& problem);

  void Generate(Rng& rng, std::vector<SolverPose>& poses) const override;

 private:
  double ProbabilityOfPrior(const SolverPose& pose) const override;
};

// The vertical direction is drawn from gravity's prior.
class UprightGenerator final : public PriorGenerator {
 public:
  explicit UprightGenerator(const PreparedProblem& problem);
  static bool CanSample(const PreparedProblem& problem);

  void Generate(Rng& rng, std::vector<SolverPose>& poses) const override;

 private:
  double ProbabilityOfPrior(const SolverPose& pose) const override;
};

}  // namespace raylift
