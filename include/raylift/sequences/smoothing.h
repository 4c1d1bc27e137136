// Estimates the poses of a walk's frames from the poses of single frames and odometry, by one pose
// graph: its maximum of likelihood, and exact covariances there. The noise of the odometry is
// estimated from the walk itself.
//
// Unknown are the poses T_i (cam_from_world), the odometry's scale s and noise, and the factor f by
// which the frames' standard deviations are too small. With the step e(A, B) that turns pose A into
// pose B (StepBetween), minimized is
//
//   - 2 sum_i log( max_k c_ik N(e(Z_ik, T_i); f^2 S_ik) + (1 - sum_k c_ik) u )
//                                                                 a frame's own poses Z_ik, or the
//                                                                 one found where it is predicted
//   - 2 sum_i log N(e(s O_i O_i-1^-1, T_i T_i-1^-1); V_i)           a step of the odometry's O
//
// each N with a broader part, so that a few large errors count little. A frame has one pose of its
// own or several that its matches cannot tell apart (PoseEstimate::alternatives), at most one of
// which is right: c_ik is the probability of each, S_ik its covariance, u the density of a wrong
// pose, which may be anywhere. V_i grows with how much the camera moves and turns in the step.
// Where frames that agree on both sides show that the odometry was lost in between, it may be
// anything there.

#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "raylift/base/enum_names.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {

// The pose of a single frame, or an alternative that explains its matches about as well.
struct SinglePose {
  Rigid3 cam_from_world;
  Eigen::Matrix<double, 6, 6> covariance;  // of the step, as PoseEstimate's
  double confidence = 0;
};

struct StepLength {
  double way = 0;  // units of the odometry
  double turn_deg = 0;
};

// The pose that a frame's matches tell near where the rest of the walk predicts it, and what a
// wrong one may be off by, the covariance of that prediction.
struct RematchedPose {
  SinglePose pose;
  Eigen::Matrix<double, 6, 6> predicted_covariance;
};

struct WalkEvidence {
  Rigid3 cam_from_odometry;
  std::vector<SinglePose> singles = {};  // none without a pose; at most one of them is right
  // A lower bound of how far the camera moved and turned since the frame before: where frames
  // between them are left out, it is more than the odometry's poses differ.
  StepLength since_before = {};
  // Stands in place of the others, but for the question whether the walk is right, which it does
  // not tell, as it was looked for there alone.
  std::optional<RematchedPose> rematched = std::nullopt;
};

enum class OdometryScale { kKnown, kUnknown };
template <>
inline constexpr auto kEnumNames<OdometryScale> = std::to_array<EnumName<OdometryScale>>({
    {OdometryScale::kKnown, "known", "the scene's units"},
    {OdometryScale::kUnknown, "unknown", "any; it is found"},
});

// What the rest of the walk tells of a frame.
struct FramePrediction {
  Rigid3 cam_from_world;
  Eigen::Matrix<double, 6, 6> covariance;
};

struct SmoothedFrame {
  Rigid3 cam_from_world;
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();  // marginal
  // The probability that the frames which agree with this one by odometry are not all wrong: those
  // of one place are wrong together, and no more than three count; frames that do not agree, and
  // other walks that the alternatives of agreeing frames would make, lower it.
  double confidence = 0;
  // The probability that a pose of its own is right, 0 without one; and the index of that pose.
  double single_agrees = 0;
  size_t single = 0;
  double rematched_agrees = 0;  // the probability that `rematched` is right, 0 without one
  // Where no pose of its own agrees: the probability that these are wrong, not the odometry's pose
  // of this frame alone, as where it is of another time; 1 else.
  double against_own = 1;
  std::optional<FramePrediction> predicted = std::nullopt;  // nullopt where it tells nothing
  bool lost_before = false;  // between the frame before and this one the odometry was lost
};

struct SmoothedWalk {
  // There are none where no frame has a pose of its own, or where an unknown scale is not
  // observable.
  std::vector<SmoothedFrame> frames = {};
  // This is false where the scale is unknown and there are no three frames with poses at different
  // places that determine it.
  bool scale_is_observable = true;
  double scale = 1;  // scene units per unit of the odometry
  double scale_sigma = 0;
  // The odometry's noise over a step as long as the walk's mean one; scene units.
  double step_sigma = 0;
  double step_rotation_sigma_deg = 0;
  double single_sigma_factor = 1;  // f
  // The scale by which frames contradict a known scale, as where units differ; nullopt where they
  // do not.
  std::optional<double> contradicting_scale = std::nullopt;
};

// Smooths a walk of two frames at least.
SmoothedWalk SmoothWalk(std::span<const WalkEvidence> frames, OdometryScale scale);

}  // namespace raylift
