// Refines a pose, in double precision, with each set's noise estimated from its own inliers, so
// that inaccurate geometry does not drag the pose, and a robust loss.

#pragma once

#include <optional>
#include <vector>

#include "estimation/kernels/kernels.h"
#include "estimation/problem/normalized_problem.h"
#include "estimation/refinement/pose_minimizer.h"

namespace raylift {

// Refines a pose by maximum likelihood. Holds a reference to the problem.
class MaximumLikelihood {
 public:
  MaximumLikelihood(const NormalizedProblem& problem, MatchSets sets)
      : problem_(problem), sets_(sets) {}

  void Refine(const CamFromLocal& start);

  // Takes the pose as it is, for its covariance.
  void StayAt(const CamFromLocal& pose);

  // Returns the covariance of the step (w, v) in the camera's tangent frame; nullopt where
  // singular.
  std::optional<Matrix6d> Covariance() const;

  // Returns the step of the focal length that the matches near the pose ask for. The problem must
  // know how they move with it (TakeFocalSigma()).
  std::optional<FocalStep> StepOfFocal() const;

  const CamFromLocal& pose() const { return pose_; }

 private:
  // Blocks of the matches near the pose.
  struct GatheredMatches {
    Blocks2D3D<double> blocks_2d3d;
    Blocks2D2D<double> blocks_2d2d;

    ActiveMatches<double> Active() const {
      return {blocks_2d3d.blocks, blocks_2d3d.block_camera, blocks_2d2d.blocks,
              blocks_2d2d.block_camera_reference};
    }
  };

  void Gather();
  void Minimize();
  // Returns the matches seen through a lens whose focal length is longer by this factor's
  // logarithm, a small number.
  GatheredMatches WithFocal(const GatheredMatches& matches, double log_factor) const;

  const NormalizedProblem& problem_;
  MatchSets sets_;
  CamFromLocal pose_;
  MatchSetWeights weights_;
  GatheredMatches near_;
};

// The noise of the residuals near a pose, estimated from themselves, and the robust loss for it.
// All in units of the squared threshold.

// The prior of the noise's variance, as if a few matches had shown it.
inline constexpr double kPriorVariance = 0.1;

// The distribution of one set's residuals at unit variance: the mean square of those below a limit,
// and the limit of the robust loss.
struct ResidualModel {
  double (*mean_square_below)(double squared_limit);
  double squared_loss_limit;  // 95 % of the efficiency of least squares on normal residuals
};
extern const ResidualModel kModel2D3D;  // of two residuals per match
extern const ResidualModel kModel2D2D;  // of one

// Returns the variance of one residual component: the one that explains the mean square of the
// residuals within two and a half standard deviations. Where the residuals spread evenly over all
// that lies near, as with inaccurate geometry, it may grow up to its bound, 100.
double NoiseVariance(const std::vector<double>& squared_residuals, const ResidualModel& model);

kernels::KernelLoss RobustLoss(double variance, const ResidualModel& model);

// The 2D-2D matches near a pose that can be trusted to refine it.
//
// A wrong match lands near its epipolar line by chance, and then mostly as a point close to the
// cameras, where random rays meet. Nothing in its residual tells it from a right one, but so near a
// point pulls at the position many times as hard as the true ones do: a handful of them spoils what
// hundreds of inliers know. How many of the matches at one parallax are there by chance shows in
// the residuals a little farther off, where only wrong ones are.

// Returns the indices, in order, of the 2D-2D matches whose squared residual is below `limit`,
// without those at parallaxes where chance explains too many of them. `variance` is that of the
// residuals of right matches; all in units of the squared threshold.
std::vector<int> ReliableMatches2D2D(const NormalizedProblem& problem, const CamFromLocal& pose,
                                     const std::vector<double>& squared_residuals, double variance,
                                     double limit);

}  // namespace raylift
