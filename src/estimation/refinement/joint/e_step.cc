#include <algorithm>
#include <cmath>
#include <vector>

#include "estimation/kernels/kernel_table.h"
#include "estimation/refinement/joint/model.h"
#include <Eigen/LU>

namespace raylift {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;
using Eigen::Vector3d;

// The probability that a query's pixel is wrong although its matches agree with each other.
constexpr double kQueryWrong = 0.1;

// Returns the variance of errors: their squares over how many of them are not explained by the
// unknowns that were fitted to them (MacKay 1992), with the prior; `now` where they are too few.
double Variance(const kernels::JointSum& sum, const VariancePrior& prior, double now, double least,
                double largest) {
  const double total = std::max(sum.count, 0.0) + prior.count;
  if (!(total > 1)) return now;
  return std::clamp((sum.squares + prior.count * prior.variance) / total, least, largest);
}

// Returns the share of what is right, as if `prior` of each kind had been seen before.
double Share(double right, double count, double prior) {
  return std::clamp((right + prior) / (count + 2 * prior), 0.01, 0.99);
}

// Returns whether the pose's uncertainty moves pixels so little that predictions may leave it out.
bool IsPoseCertain(const Matrix7d& query_covariance, const JointModel& model) {
  // The share is of the pixels' variance, which itself is known to a few per cent at best.
  constexpr double kNegligibleShare = 0.02;
  // Some keypoints over all of the image tell.
  constexpr size_t kEnoughKeypoints = 32;
  if (query_covariance.isZero(0)) return true;
  const KeypointEvidence& evidence = model.evidence;
  const size_t stride = evidence.keypoints.size() / kEnoughKeypoints + 1;
  double variance = 0, count = 0;
  for (size_t k = 0; k < evidence.keypoints.size(); k += stride) {
    const KeypointObservations& keypoint = evidence.keypoints[k];
    const Vector3d point = model.blocks.PointOf(k);
    const PixelResidual seen =
        ResidualOf(keypoint.image_from_cam, keypoint.PointInCamera(model.pose, point));
    if (!seen.in_front) continue;
    const Eigen::Matrix<double, 2, 6> by_pose =
        seen.jacobian * model.pose.rotation * DisplacementJacobian(point);
    variance += (by_pose * query_covariance.topLeftCorner<6, 6>() * by_pose.transpose()).trace();
    count += 2;
  }
  return variance < kNegligibleShare * count * model.noise.keypoint_px2;
}

// Returns some hundred leave-one-out errors of pixels, which tell the tail: squared, along the axis
// that is best predicted, over the variance.
std::vector<double> ErrorsAcross(const JointModel& model) {
  struct SlotLane {
    const kernels::JointObservations* slot;
    size_t lane;
  };
  std::vector<SlotLane> telling;
  for (const kernels::JointObservations& slot : model.blocks.Observations()) {
    for (size_t lane = 0; lane < kernels::kLanes<double>; ++lane) {
      if (slot.tells_noise[lane] != 0) telling.push_back({&slot, lane});
    }
  }
  std::vector<double> errors;
  const size_t stride = telling.size() / kErrorsOfTail + 1;
  for (size_t i = 0; i < telling.size(); i += stride) {
    const auto& [slot, lane] = telling[i];
    const auto& predicted = slot->predicted_covariance;
    Matrix2d covariance;
    covariance << predicted[0][lane], predicted[1][lane], predicted[1][lane], predicted[2][lane];
    errors.push_back(
        SquaredAcross({slot->predicted_px[0][lane], slot->predicted_px[1][lane]}, covariance));
  }
  return errors;
}

void UpdateNoise(const NoisePrior& prior, kernels::JointSums sums, JointModel& model) {
  JointNoise& noise = model.noise;
  sums.pixels.count -= 6;  // the pose's own unknowns take from what the pixels show
  noise.keypoint_px2 = Variance(sums.pixels, prior.keypoint_px2, noise.keypoint_px2, 1e-10, 1e10);
  noise.depth = Variance(sums.depths, prior.depth, noise.depth, 1e-10, 1);
  noise.common_depth = Variance(sums.commons, prior.common_depth, noise.common_depth, 1e-10, 1);
  noise.keypoint_errors = std::max(0.0, sums.pixels.count);
  noise.depth_errors = std::max(0.0, sums.depths.count);
  noise.common_depth_errors = std::max(0.0, sums.commons.count);
  const double extent2 = std::exp(2 * noise.log_distance_mean);
  noise.unanchored = Variance(sums.unanchored, {}, noise.unanchored, 1e-12 * extent2, extent2);
  noise.right = Share(sums.right, static_cast<double>(model.evidence.observations.size()), 2);
  noise.depth_right = Share(sums.depth_right, sums.depth_count, 1);
  noise.unanchored_right =
      Share(sums.unanchored_right, static_cast<double>(model.evidence.unanchored.size()), 1);
  noise.keypoint_tail = EstimateTail(ErrorsAcross(model), prior.keypoint_tail);
}

}  // namespace

double SquaredAcross(const Vector2d& error, const Matrix2d& covariance) {
  const double mean = 0.5 * covariance.trace();
  const double half = 0.5 * (covariance(0, 0) - covariance(1, 1));
  const double cross = 0.5 * (covariance(0, 1) + covariance(1, 0));
  const double root = std::hypot(half, cross);
  if (!(root > 0)) return error.x() * error.x() / mean;
  // The error is along the axis of the smaller eigenvalue, which is the determinant over the larger
  // one, as the difference of such numbers would be lost.
  const double cos2 = -half / root;
  const double sin2 = -cross / root;
  const double squared =
      0.5 * (error.squaredNorm() + cos2 * (error.x() * error.x() - error.y() * error.y())) +
      sin2 * error.x() * error.y();
  return std::max(squared, 0.0) * (mean + root) / covariance.determinant();
}

void EStep(const NoisePrior& prior, double share, const Matrix7d& query_covariance,
           JointModel& model) {
  kernels::JointExpectation expectation = {
      .share = share,
      .far = StudentFar(model.noise.keypoint_tail),
      .query_wrong = kQueryWrong,
      .is_pose_certain = IsPoseCertain(query_covariance, model)};
  Eigen::Map<Matrix7d>(expectation.query_covariance) = query_covariance;
  const kernels::JointSums sums = kernels::ActiveKernels().expect_jointly(
      model.blocks.ForKernels(), model.ForKernels(), expectation);
  model.log_likelihood = sums.log_likelihood;
  UpdateNoise(prior, sums, model);
}

}  // namespace raylift
