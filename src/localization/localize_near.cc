#include "localization/localize_near.h"

#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "base/constants.h"
#include "estimation/confidence/confidence.h"
#include "estimation/problem/priors.h"
#include <Eigen/Eigenvalues>

#include "raylift/estimation/solvers.h"
#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

double LargestEigenvalue(const Matrix3d& covariance) {
  return Eigen::SelfAdjointEigenSolver<Matrix3d>(covariance, Eigen::EigenvaluesOnly)
      .eigenvalues()
      .maxCoeff();
}

// Returns the point of each keypoint by the first source that has one.
std::vector<std::optional<SurfacePoint>> FirstPoints(
    std::span<const std::shared_ptr<const GeometrySource>> sources, const PosedImage& reference,
    std::span<const Eigen::Vector2d> keypoints_px) {
  std::vector<std::optional<SurfacePoint>> first(keypoints_px.size());
  for (const auto& source : sources) {
    std::vector<size_t> missing;
    std::vector<Eigen::Vector2d> pixels;
    for (size_t i = 0; i < first.size(); ++i) {
      if (first[i]) continue;
      missing.push_back(i);
      pixels.push_back(keypoints_px[i]);
    }
    if (missing.empty()) break;
    const auto points = source->Lift(reference, pixels);
    for (size_t k = 0; k < missing.size(); ++k) first[missing[k]] = points[k];
  }
  return first;
}

// Tells where the query shows what the references' keypoints show.
class Expectation {
 public:
  Expectation(const PredictedPose& predicted, const Localizer& localizer, const Query& query)
      : predicted_(predicted),
        camera_(query.camera),
        sources_(localizer.scene().Geometry()),
        keypoint_variance_px2_(std::pow(
            localizer.options().estimator.reprojection_threshold_px / kSigmasOfThreshold, 2)),
        focal_sigma_(localizer.options().estimator.focal_sigma.value_or(
            query.priors.focal_sigma.value_or(0))) {}

  std::vector<std::optional<SearchRegion>> RegionsOf(
      const PosedImage& reference, std::span<const Eigen::Vector2d> keypoints_px) const {
    std::vector<std::optional<SearchRegion>> regions;
    for (const auto& point : FirstPoints(sources_, reference, keypoints_px)) {
      regions.push_back(point ? RegionOf(*point, reference) : std::nullopt);
    }
    return regions;
  }

 private:
  // Returns nullopt where the point is not in the image. A step v of the pose moves a point as one
  // of the point does; another focal length moves pixels away from the middle of the image.
  std::optional<SearchRegion> RegionOf(const SurfacePoint& point,
                                       const PosedImage& reference) const {
    const auto seen = ReprojectionError(camera_, predicted_.cam_from_world, point.point_in_world,
                                        Eigen::Vector2d::Zero());
    if (!seen || !camera_.Contains(seen->error_px)) return std::nullopt;
    const Eigen::Vector2d middle(0.5 * camera_.width_px(), 0.5 * camera_.height_px());
    const Eigen::Vector2d by_focal = focal_sigma_ * (seen->error_px - middle);
    const double distance =
        (point.point_in_world - reference.cam_from_world.OriginInSource()).norm();
    const double point_sigma =
        std::hypot(point.point_sigma.value_or(0), point.log_depth_sigma.value_or(0) * distance);
    const auto by_point = seen->jacobian.rightCols<3>();
    Eigen::Matrix2d covariance =
        seen->jacobian * predicted_.covariance * seen->jacobian.transpose() +
        point_sigma * point_sigma * by_point * by_point.transpose() +
        by_focal * by_focal.transpose();
    covariance.diagonal().array() += keypoint_variance_px2_;
    return SearchRegion{seen->error_px, covariance};
  }

  const PredictedPose& predicted_;
  const Camera& camera_;
  std::vector<std::shared_ptr<const GeometrySource>> sources_;
  double keypoint_variance_px2_;
  double focal_sigma_;
};

}  // namespace

PosePriors WithPrediction(PosePriors priors, const PredictedPose& predicted) {
  const Matrix3d world_from_cam = predicted.cam_from_world.rotation.conjugate().toRotationMatrix();
  // A step v moves the center by -R' v.
  const Matrix3d of_center =
      world_from_cam * predicted.covariance.bottomRightCorner<3, 3>() * world_from_cam.transpose();
  const Vector3d sigma = of_center.diagonal().cwiseSqrt();
  const Vector3d inverse = sigma.cwiseInverse();
  const double widening =
      LargestEigenvalue(inverse.asDiagonal() * of_center * inverse.asDiagonal());
  priors.position =
      PositionPrior{predicted.cam_from_world.OriginInSource(), std::sqrt(widening) * sigma};
  const double turn = LargestEigenvalue(predicted.covariance.topLeftCorner<3, 3>());
  priors.orientation = OrientationPrior{predicted.cam_from_world.rotation.normalized(),
                                        kDegPerRad * std::sqrt(turn)};
  priors.gravity.reset();
  priors.heading.reset();
  return priors;
}

QueryResult LocalizeNear(const PredictedPose& predicted, const Localizer& localizer,
                         const MatchSource& matches, const Query& query,
                         std::span<const PosedImage> references) {
  const Expectation expectation(predicted, localizer, query);
  const auto regions = [&](const PosedImage& reference,
                           std::span<const Eigen::Vector2d> keypoints_px) {
    return expectation.RegionsOf(reference, keypoints_px);
  };
  Query near = query;
  near.priors = WithPrediction(query.priors, predicted);
  QueryResult result = localizer.Localize(near, matches.MatchWithin(regions, query, references));
  const auto range = result.problem.priors.range;  // with the surface that it is of
  result.problem.priors = query.priors;
  result.problem.priors.range = range;
  LocalizedQuery& localized = result.localized;
  if (!localized.estimate.cam_from_world) return result;
  const EstimatorOptions& options = localizer.options().estimator;
  PoseEstimate refined = RefinePose(result.problem, options, *localized.estimate.cam_from_world);
  // Without the prediction the pose may go elsewhere, where fewer matches are right.
  if (2 * refined.inlier_keypoints < localized.estimate.inlier_keypoints) {
    refined.cam_from_world.reset();
    refined.failure = FailureReason::kNoConsistentSample;
  }
  if (refined.cam_from_world) Conclude(localized.estimate.confidence, 1, refined);
  localized.TakeEstimate(std::move(refined));
  localized.reason = ReasonNotLocalized(localized.estimate, localizer.options().min_confidence);
  return result;
}

}  // namespace raylift
