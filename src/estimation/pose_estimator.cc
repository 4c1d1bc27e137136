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

constexpr double kLargestSigma = 1e6;
const Range kSigma{.says = fmt::format("must lie between 0 and {}", kLargestSigma),
                   .least = 0,
                   .most = kLargestSigma};

std::string MethodHelp() {
  std::string text = "Estimator:";
  for (const EnumName<Method>& method : kEnumNames<Method>) {
    text += fmt::format("\n{} = {}: {}", method.name, method.title, method.description);
  }
  return text;
}

void Require(bool condition, std::string_view name, const std::string& value,
             std::string_view constraint) {
  if (!condition) {
    throw OptionError(name, value, constraint);
  }
}

}  // namespace

std::vector<Field> NumberFieldsOf(EstimatorOptions& options) {
  return {
      {"refinement", options.refinement,
       "What happens beyond the paper, in every method: {}.\n"
       "robust refines the pose after RANSAC by maximum likelihood,\n"
       "Adaptive's and D3+1's by both kinds of matches with what they are\n"
       "found to be worth, draws samples of D3+1 in Adaptive as well, and\n"
       "drops poses that chance explains;\n"
       "paper optimizes each new best pose on all matches, no more"},
      {"reprojection_threshold_px", options.reprojection_threshold_px,
       "Inlier threshold of 2D-3D matches", kPositive},
      {"sampson_threshold_px", options.sampson_threshold_px, "Inlier threshold of 2D-2D matches",
       kPositive},
      {"point_sigma", options.point_sigma,
       "Standard deviation of the 3D points, in scene units:\n"
       "widens the inlier threshold of 2D-3D matches",
       kNotNegative},
      {"refine_focal", options.refine_focal, "Find the query's focal length with the pose"},
      {"focal_range", options.focal_range,
       "With --refine-focal: it is the given one up to this factor\n"
       "either way",
       Range{.says = fmt::format("must lie between 1 and {}", kMaxFocalRange),
             .least = 1,
             .most = kMaxFocalRange}},
      {"focal_sigma", options.focal_sigma,
       "Standard deviation of the query's focal length as a share of it,\n"
       "which the pose and its covariance take into account; 0: exact.\n"
       "Default: what is said with the query's camera",
       Range{.says = fmt::format("must lie between 0 and {}", kMaxFocalSigma),
             .least = 0,
             .most = kMaxFocalSigma}},
      {"reference_factor_sigma", options.reference_factor_sigma,
       "Standard deviation of the factor that all depths of a reference\n"
       "are wrong by, as a share: single images tell their scale by\n"
       "some 0.1. Default: what the problem says, or found where\n"
       "references disagree",
       kSigma},
      {"reference_rotation_sigma_deg", options.reference_rotation_sigma_deg,
       "The same of the references' orientations, about each axis", kSigma},
      {"reference_position_sigma", options.reference_position_sigma,
       "The same of their positions along each axis, in scene units", kSigma},
      {"min_iterations", options.min_iterations, "RANSAC", kAtLeastOne},
      {"max_iterations", options.max_iterations, "RANSAC",
       Range{.says = fmt::format("must not be below min_iterations = {}", options.min_iterations),
             .least = static_cast<double>(options.min_iterations)}},
      {"confidence", options.confidence,
       "RANSAC stops when a sample of inliers alone has\n"
       "been drawn with this probability",
       Range{.says = "must lie between 0 and 1",
             .least = 0,
             .most = 1,
             .without_least = true,
             .without_most = true}},
      {"seed", options.seed, "Seed of all random choices"},
  };
}

std::vector<Field> FieldsOf(EstimatorOptions& options) {
  std::vector<Field> fields = {
      {"method", options.method, MethodHelp()},
      {"score", options.score, "Score that Adaptive compares poses by:\n{}"},
      {"lo", options.local_optimization, "Adaptive's local optimization: {}"},
      {"alpha", options.alpha,
       "Select takes the P3P pose if it has more than alpha times\n"
       "the E5+1 pose's 2D-2D inliers",
       kNotNegative},
  };
  const std::vector<Field> numbers = NumberFieldsOf(options);
  fields.insert(fields.end(), numbers.begin(), numbers.end());
  return fields;
}

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
