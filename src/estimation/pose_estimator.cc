#include "raylift/estimation/pose_estimator.h"

#include <cmath>

#include "estimation/fields.h"
#include "estimation/methods/methods.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/estimation/options.h"
#include "raylift/estimation/solvers.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {
namespace {

void Require(bool condition, std::string_view name, const std::string& value,
             std::string_view constraint) {
  if (!condition) {
    throw OptionError(name, value, constraint);
  }
}

}  // namespace

void EstimatorOptions::Validate() const {
  CheckRanges(ConstFieldsOf(*this));
  if (!scene_noise) return;
  for (const KnownNoise& known :
       {scene_noise->keypoint_px, scene_noise->depth, scene_noise->common_depth,
        scene_noise->reference_factor, scene_noise->reference_rotation_deg,
        scene_noise->reference_position}) {
    Require(known.errors >= 0 && std::isfinite(known.errors) && std::isfinite(known.sigma) &&
                (known.errors == 0 || known.sigma > 0),
            "scene_noise", fmt::format("{} by {} errors", known.sigma, known.errors),
            "must be positive");
  }
  Require(scene_noise->keypoint_tail >= 0 && scene_noise->keypoint_tail <= 1,
          "scene_noise, keypoint_tail", fmt::format("{}", scene_noise->keypoint_tail),
          "must lie between 0 and 1");
}

std::unique_ptr<PoseEstimator> MakePoseEstimator(const EstimatorOptions& options) {
  options.Validate();
  if (options.method == Method::kSelect) return MakeSelectEstimator(options);
  if (options.method == Method::kHloc) return MakeHlocEstimator(options);
  return std::make_unique<RansacEstimator>(options, RansacMethodOf(options));
}

PoseEstimate RefinePose(const PoseProblem& problem, const EstimatorOptions& options,
                        const Rigid3& initial_cam_from_world) {
  options.Validate();
  const auto refine = [&](RansacMethod method) {
    return RansacEstimator(options, std::move(method)).RefineFrom(problem, initial_cam_from_world);
  };
  PoseEstimate refined = refine(RansacMethodOf(options));
  if (options.method != Method::kSelect) return refined;
  return SelectPose(std::move(refined), refine(E5p1Method(options)), options.alpha);
}

}  // namespace raylift
