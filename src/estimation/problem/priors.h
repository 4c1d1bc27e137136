// The pose's priors, each as one more residual.
//
// A prior may be wrong, as a match may: with a chance of one in twenty it says nothing, and the
// position is anywhere about the references, gravity, heading, orientation or range any. The
// probability of a pose is a mixture of both, so that a prior's cost is bounded: one that
// contradicts what the matches say costs all poses there the same.

#pragma once

#include <array>
#include <optional>
#include <span>

#include "estimation/problem/cam_from_local.h"
#include <Eigen/Core>

#include "raylift/scene/photographs.h"

namespace raylift {

// The priors of a pose, in the local frame of a NormalizedProblem.
class NormalizedPriors {
 public:
  NormalizedPriors() = default;
  // `centers` are those of the references, local. Throws InputError for a prior that is not finite.
  NormalizedPriors(const PosePriors& priors, const Eigen::Vector3d& origin_in_world, double scale,
                   std::span<const Eigen::Vector3d> centers);

  struct Position {
    Eigen::Vector3d center;
    Eigen::Vector3d sigma;
  };
  struct Gravity {
    Eigen::Vector3d down_in_cam;    // unit
    Eigen::Vector3d down_in_local;  // unit
    double sigma;                   // radians
  };
  const std::optional<Position>& position() const { return position_; }
  const std::optional<Gravity>& gravity() const { return gravity_; }
  bool empty() const { return !position_ && !gravity_ && !heading_ && !orientation_ && !range_; }

  // Return the probability that the position's or gravity's prior is right at a pose; 0 without
  // one.
  double ProbabilityOfPosition(const CamFromLocal& pose) const;
  double ProbabilityOfGravity(const CamFromLocal& pose) const;

  // Returns the logarithm of how much likelier the priors make a pose. A range is of the surface
  // that the pose itself chose: one that fits says nothing for it, another speaks against it.
  double LogEvidence(const CamFromLocal& pose) const;

  // Returns how much a pose's evidence falls short of the greatest, in the unit of a match's
  // squared residual over its squared threshold; at most WorstCost().
  double Cost(const CamFromLocal& pose) const;
  double WorstCost() const;

  // Adds the priors to the normal equations of a step (w, v) in the camera's tangent frame; their
  // cost is in squared residuals over variances.
  void AddTo(const CamFromLocal& pose, double weight, NormalEquations& equations) const;
  // Adds them, without their cost, for a pose with this covariance of a step, as where the lens is
  // found with it: a prior is not wrong that the pose may yet come to.
  void AddTo(const CamFromLocal& pose, const Matrix6d& covariance,
             NormalEquations& equations) const;

 private:
  struct Heading {
    Eigen::Vector3d right_in_cam;                    // unit
    Eigen::Vector3d right_in_local, ahead_in_local;  // unit, horizontal
    double sigma;                                    // radians
  };
  struct Orientation {
    Eigen::Matrix3d cam_from_local;
    double sigma;  // radians
  };

  struct Range {
    Eigen::Vector3d point, normal;  // of the surface's plane; unit
    double range;
    double sigma;
  };

  // One prior's residual at a pose.
  struct Term {
    Eigen::Vector3d residual;  // over its standard deviations
    double log_peak;  // the logarithm of the density at its greatest, over that of knowing nothing
    Eigen::Matrix<double, 3, 6> jacobian;  // of the residual by a step (w, v)

    double LogEvidence() const;
    double Probability() const;  // that the prior is right
    double Probability(const Matrix6d& covariance) const;
    double Shortfall() const;  // of the evidence from its greatest

    // Adds the residual to the normal equations, without its cost.
    void AddPull(double weight, NormalEquations& equations) const;
  };
  std::optional<Term> PositionTerm(const CamFromLocal& pose) const;
  std::optional<Term> GravityTerm(const CamFromLocal& pose) const;
  std::optional<Term> HeadingTerm(const CamFromLocal& pose) const;
  std::optional<Term> OrientationTerm(const CamFromLocal& pose) const;
  std::optional<Term> RangeTerm(const CamFromLocal& pose) const;
  std::array<std::optional<Term>, 5> Terms(const CamFromLocal& pose) const;
  // Returns the shortfall of a heading or a range that says nothing of a pose: that of no prior
  // from a right one.
  double Silence(const CamFromLocal& pose) const;

  std::optional<Position> position_;
  std::optional<Gravity> gravity_;
  std::optional<Heading> heading_;
  std::optional<Orientation> orientation_;
  std::optional<Range> range_;
  double position_log_peak_ = 0;
  double gravity_log_peak_ = 0;
  double heading_log_peak_ = 0;
  double orientation_log_peak_ = 0;
  double range_log_peak_ = 0;
};

// A threshold is some two and a half standard deviations of the keypoints' noise, and stays so of
// both errors together where a point or a reference is uncertain: t^2 becomes t^2 + (2.5 sigma)^2.
inline constexpr double kSigmasOfThreshold = 2.5;

// The squared residual of one standard deviation over its squared threshold.
inline constexpr double kSquaredSigma = 1 / (kSigmasOfThreshold * kSigmasOfThreshold);

}  // namespace raylift
