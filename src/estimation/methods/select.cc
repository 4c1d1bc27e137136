#include "estimation/methods/methods.h"

namespace raylift {
namespace {

// Runs P3P and E5+1 apart, and selects one of the two poses.
class SelectEstimator final : public PoseEstimator {
 public:
  explicit SelectEstimator(const EstimatorOptions& options)
      : alpha_(options.alpha),
        p3p_(WithMethod(options, Method::kP3p), P3pMethod(options)),
        e5p1_(WithMethod(options, Method::kE5p1), E5p1Method(options)) {}

  PoseEstimate Estimate(const PoseProblem& problem) const override {
    return SelectPose(p3p_.Estimate(problem), e5p1_.Estimate(problem), alpha_);
  }

 private:
  // Each method has random numbers of its own.
  static EstimatorOptions WithMethod(EstimatorOptions options, Method method) {
    options.method = method;
    return options;
  }

  double alpha_;
  RansacEstimator p3p_;
  RansacEstimator e5p1_;
};

}  // namespace

PoseEstimate SelectPose(PoseEstimate p3p, PoseEstimate e5p1, double alpha) {
  const auto p3p_pose = p3p.cam_from_world;
  const auto e5p1_pose = e5p1.cam_from_world;
  const int iterations = p3p.iterations + e5p1.iterations;
  bool take_p3p = p3p.score_2d2d.num_inliers > alpha * e5p1.score_2d2d.num_inliers;
  if (!p3p_pose) take_p3p = false;
  if (!e5p1_pose || (!e5p1.position_observable && p3p_pose)) take_p3p = p3p_pose.has_value();
  PoseEstimate chosen = take_p3p ? std::move(p3p) : std::move(e5p1);
  chosen.p3p_cam_from_world = p3p_pose;
  chosen.e5p1_cam_from_world = e5p1_pose;
  chosen.iterations = iterations;
  return chosen;
}

std::unique_ptr<PoseEstimator> MakeSelectEstimator(const EstimatorOptions& options) {
  return std::make_unique<SelectEstimator>(options);
}

}  // namespace raylift
