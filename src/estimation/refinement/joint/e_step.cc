#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "estimation/refinement/joint/model.h"
#include <Eigen/LU>

namespace raylift {
namespace {

using Eigen::Matrix2d;
using Eigen::Matrix3d;
using Eigen::Matrix4d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::Vector4d;
using Matrix34d = Eigen::Matrix<double, 3, 4>;
using Matrix23d = Eigen::Matrix<double, 2, 3>;
using Matrix24d = Eigen::Matrix<double, 2, 4>;

// A query's pixel is wrong, although its matches agree with each other, as often as that.
constexpr double kQueryWrong = 0.1;

// The leave-one-out prediction of residuals `e` with variances `variance`, of which a part
// `information` is among the evidence that gave them; `evidence_covariance` is the evidence's
// uncertainty in them.
template <int N>
struct Prediction {
  Eigen::Matrix<double, N, 1> error;
  Eigen::Matrix<double, N, N> covariance;

  Prediction(const Eigen::Matrix<double, N, 1>& e, const Eigen::Matrix<double, N, 1>& variance,
             const Eigen::Matrix<double, N, 1>& information,
             const Eigen::Matrix<double, N, N>& evidence_covariance) {
    const Eigen::Matrix<double, N, N> rest =
        Eigen::Matrix<double, N, N>::Identity() - evidence_covariance * information.asDiagonal();
    const Eigen::Matrix<double, N, N> without = rest.inverse();
    error = without * e;
    covariance = without * evidence_covariance;
    covariance.diagonal() += variance;
  }
};

// Sums what errors show of their variance: their squares, and how many of them are not explained by
// the unknowns that were fitted to them (MacKay 1992).
struct VarianceSum {
  double squares = 0, count = 0;

  double Estimate(const VariancePrior& prior, double now, double least, double largest) const {
    const double total = std::max(count, 0.0) + prior.count;
    if (!(total > 1)) return now;
    return std::clamp((squares + prior.count * prior.variance) / total, least, largest);
  }
};

// The share of what is right, as if `prior` of each kind had been seen before.
struct ShareSum {
  double right = 0, count = 0;

  double Estimate(double prior) const {
    return std::clamp((right + prior) / (count + 2 * prior), 0.01, 0.99);
  }
};

class ExpectationStep {
 public:
  ExpectationStep(double share, const Matrix7d& query_covariance, JointModel& model)
      : share_(share),
        query_covariance_(query_covariance),
        model_(model),
        evidence_(model.evidence),
        noise_(model.noise),
        far_(StudentFar(noise_.keypoint_tail)),
        is_pose_certain_(IsPoseCertain()) {}

  void UpdateWeights() {
    for (size_t k = 0; k < evidence_.keypoints.size(); ++k) UpdateKeypoint(k);
  }
  void UpdateNoise(const NoisePrior& prior);
  double LogLikelihood() const { return likelihood_.Sum(); }

 private:
  // A keypoint's point, as the evidence has it, for all of its observations.
  struct KeypointPosterior {
    QueryTerm query;
    Matrix4d covariance;       // of the point and its common error, the query's pose given
    Matrix4d full_covariance;  // of the same, the pose being uncertain
    // Unless the pose is certain: of how the query's unknowns displace a point, and by how much the
    // point and its common error follow that.
    Matrix4d frame_covariance;
    Matrix4d follows;
    double total = 0;  // weight
    int num_right = 0;
    bool query_far = false;  // and nothing tells whose pixel is wrong
    // A keypoint whose point has not settled yet says nothing of the noise.
    double trust = 0;
  };

  // Whether the pose's uncertainty moves pixels by so little that predictions need not know of it.
  bool IsPoseCertain() const;
  void UpdateKeypoint(size_t index);
  void UpdateEvidence(size_t index, const KeypointObservations& keypoint, KeypointState& state);
  void UpdateQuery(KeypointPosterior& posterior, KeypointState& state);
  void UpdateObservation(int i, const ObservationTerm& term, const KeypointPosterior& posterior);
  // How likely a right match is to look like this.
  struct Likelihood {
    double with_depth = 0;     // with its depth
    double without_depth = 0;  // with a useless depth or none
    double squared_across = 0;
  };
  Likelihood LikelihoodOf(const Observation& observation, const ObservationTerm& term,
                          const Matrix4d& point_covariance) const;
  void UpdateUnanchored(int i, const KeypointObservations& keypoint,
                        const KeypointPosterior& posterior, const Vector3d& displaced);
  void Drop(const KeypointObservations& keypoint);
  // The covariance of the point as the query sees it, the pose being uncertain.
  Matrix3d FullQueryCovariance(const KeypointPosterior& posterior) const {
    const Matrix3d of_point = posterior.covariance.topLeftCorner<3, 3>();
    if (is_pose_certain_) return of_point;
    Matrix34d seen = posterior.follows.topRows<3>();
    seen.leftCols<3>() += Matrix3d::Identity();
    return of_point + seen * posterior.frame_covariance * seen.transpose();
  }

  bool IsFar(const PixelResidual& seen, double variance) const {
    return seen.error_px.squaredNorm() > far_ * variance;
  }
  double Precision(const PixelResidual& seen, const Matrix2d& evidence_covariance,
                   double variance) const {
    return StudentPrecision((seen.error_px.squaredNorm() + evidence_covariance.trace()) / variance,
                            noise_.keypoint_tail);
  }
  double Density(const Vector2d& error, const Matrix2d& covariance) const {
    const double determinant = covariance.determinant();
    if (!(determinant > 0)) return 0;
    const double density =
        StudentDensity(error.dot(covariance.inverse() * error), noise_.keypoint_tail) /
        (2 * std::numbers::pi * std::sqrt(determinant));
    return std::isfinite(density) ? density : 0;
  }
  double Clutter(const Observation& observation) const {
    return model_.weights.epipolar_clutter[static_cast<size_t>(observation.reference)];
  }
  void Approach(double& weight, double next) const { weight += share_ * (next - weight); }

  double share_;
  const Matrix7d& query_covariance_;
  JointModel& model_;
  const KeypointEvidence& evidence_;
  JointNoise& noise_;
  double far_;  // squared, in variances
  bool is_pose_certain_;
  std::vector<ObservationTerm> terms_;

  VarianceSum pixels_, depths_, commons_, unanchored_;
  ShareSum right_, depth_right_, unanchored_right_;
  std::vector<double> across_;
  LogOfProduct likelihood_;
};

bool ExpectationStep::IsPoseCertain() const {
  // Of the pixels' variance, which itself is known to a few per cent at best.
  constexpr double kNegligibleShare = 0.02;
  // Some keypoints over all of the image tell.
  constexpr size_t kEnoughKeypoints = 32;
  if (query_covariance_.isZero(0)) return true;
  const size_t stride = evidence_.keypoints.size() / kEnoughKeypoints + 1;
  double variance = 0, count = 0;
  for (size_t k = 0; k < evidence_.keypoints.size(); k += stride) {
    const QueryTerm query = model_.QueryTermOf(k);
    if (!query.seen.in_front) continue;
    const Matrix3d of_point =
        DisplacementCovariance(query_covariance_, model_.keypoints[k].point).topLeftCorner<3, 3>();
    variance += (query.jacobian * of_point * query.jacobian.transpose()).trace();
    count += 2;
  }
  return variance < kNegligibleShare * count * noise_.keypoint_px2;
}

void ExpectationStep::UpdateKeypoint(size_t index) {
  const KeypointObservations& keypoint = evidence_.keypoints[index];
  KeypointState& state = model_.keypoints[index];
  right_.count += keypoint.end_observation - keypoint.first_observation;
  unanchored_right_.count += keypoint.end_unanchored - keypoint.first_unanchored;
  if (state.given_up) {
    for (const Observation& observation : evidence_.ObservationsOf(keypoint)) {
      likelihood_.Multiply((1 - noise_.right) * Clutter(observation));
    }
    for (int i = keypoint.first_unanchored; i < keypoint.end_unanchored; ++i) {
      likelihood_.Multiply(1 - noise_.unanchored_right);
    }
    return;
  }
  const bool was_wrong = model_.TotalWeight(keypoint) < kLeastWeight;
  UpdateEvidence(index, keypoint, state);
  state.given_up = was_wrong && model_.TotalWeight(keypoint) < kLeastWeight;
}

void ExpectationStep::UpdateEvidence(size_t index, const KeypointObservations& keypoint,
                                     KeypointState& state) {
  KeypointPosterior posterior;
  posterior.query = model_.QueryTermOf(index);
  if (!posterior.query.seen.in_front) {
    Drop(keypoint);
    return;
  }
  const Quadratic query_cost = posterior.query.Cost();
  Quadratic cost = model_.CostWithoutObservations(keypoint, state, query_cost,
                                                  model_.UnanchoredCost(keypoint, state.point));
  bool far = IsFar(posterior.query.seen, noise_.keypoint_px2);
  posterior.query_far = far;
  terms_.clear();
  for (int i = keypoint.first_observation; i < keypoint.end_observation; ++i) {
    const ObservationTerm& term = terms_.emplace_back(model_.ObservationTermOf(i, state));
    posterior.num_right += model_.weights.observation[i] > 0.5 ? 1 : 0;
    if (term.weight == 0) continue;
    term.AddTo(cost);
    far = far || IsFar(term.seen, term.pixel_variance);
  }
  for (int i = keypoint.first_unanchored; i < keypoint.end_unanchored; ++i) {
    posterior.num_right += model_.weights.unanchored[i] > 0.5 ? 1 : 0;
  }
  posterior.covariance = cost.hessian.inverse();
  if (!posterior.covariance.allFinite()) return;
  posterior.full_covariance = posterior.covariance;
  if (!is_pose_certain_) {
    // How the query's unknowns move the point.
    posterior.frame_covariance = DisplacementCovariance(query_covariance_, state.point);
    posterior.follows.noalias() =
        -posterior.covariance.leftCols<3>().lazyProduct(query_cost.hessian.topRows<3>());
    posterior.full_covariance.noalias() +=
        posterior.follows * posterior.frame_covariance * posterior.follows.transpose();
  }
  posterior.total = model_.TotalWeight(keypoint);
  posterior.query_far = posterior.query_far && posterior.num_right <= 1;
  posterior.trust = far ? 0 : std::min(1.0, posterior.total) * state.query_right;

  if (posterior.total > 0.1) UpdateQuery(posterior, state);
  double depth_weight = 0;
  for (int i = keypoint.first_observation; i < keypoint.end_observation; ++i) {
    const ObservationTerm& term = terms_[static_cast<size_t>(i - keypoint.first_observation)];
    if (term.depth_weight > 0) {
      depth_weight += model_.weights.observation[i] * model_.weights.depth[i];
    }
    UpdateObservation(i, term, posterior);
  }
  if (depth_weight > 0) {
    commons_.squares += posterior.trust * state.common * state.common;
    commons_.count += posterior.trust * (1 - posterior.covariance(3, 3) / noise_.common_depth);
  }
  const Vector3d displaced = model_.references[model_.UnanchoredFrame()].Displaced(state.point);
  for (int i = keypoint.first_unanchored; i < keypoint.end_unanchored; ++i) {
    UpdateUnanchored(i, keypoint, posterior, displaced);
  }
}

void ExpectationStep::Drop(const KeypointObservations& keypoint) {
  for (int i = keypoint.first_observation; i < keypoint.end_observation; ++i) {
    model_.weights.observation[i] = 0;
    likelihood_.Multiply(1 - noise_.right);
  }
  for (int i = keypoint.first_unanchored; i < keypoint.end_unanchored; ++i) {
    model_.weights.unanchored[i] = 0;
    likelihood_.Multiply(1 - noise_.unanchored_right);
  }
}

void ExpectationStep::UpdateQuery(KeypointPosterior& posterior, KeypointState& state) {
  const QueryTerm& query = posterior.query;
  const Matrix2d evidence_covariance =
      query.jacobian * posterior.covariance.topLeftCorner<3, 3>() * query.jacobian.transpose();
  Approach(state.query_precision, Precision(query.seen, evidence_covariance, noise_.keypoint_px2));
  // The noise, with the weights that gave the point and the precision that its residual shows (the
  // EM algorithm's order).
  pixels_.squares += posterior.trust * state.query_right * state.query_precision *
                     query.seen.error_px.squaredNorm();
  pixels_.count +=
      posterior.trust * (2 * state.query_right - query.weight * evidence_covariance.trace());

  // A single match does not tell whose pixel is wrong: that is its own weight.
  double right = 1;
  if (posterior.num_right >= 2) {
    const Prediction<2> predicted(
        query.seen.error_px, Vector2d::Constant(noise_.keypoint_px2),
        Vector2d::Constant(query.weight),
        query.jacobian * FullQueryCovariance(posterior) * query.jacobian.transpose());
    const double chance = kQueryWrong / evidence_.matched_area_px2;
    const double density = (1 - kQueryWrong) * Density(predicted.error, predicted.covariance);
    right = density / (density + chance);
  }
  Approach(state.query_right, right);
}

// The covariance of an observation's pixel by that of its point.
Matrix2d PixelCovariance(const ObservationTerm& term, const Matrix4d& covariance) {
  const Matrix23d half = term.seen.jacobian.lazyProduct(covariance.topLeftCorner<3, 3>());
  return half.lazyProduct(term.seen.jacobian.transpose());
}

// The variance of an observation's depth by that of its point and of the common error.
double DepthVariance(const ObservationTerm& term, const Matrix4d& covariance) {
  Vector4d depth_by_point;
  depth_by_point << term.log_gradient, -1;
  return depth_by_point.dot(covariance.lazyProduct(depth_by_point));
}

// The covariance of an observation's residuals, of its pixel and its depth, by that of its point.
Matrix3d ResidualCovariance(const ObservationTerm& term, const Matrix4d& covariance) {
  Matrix24d pixel_by_point;
  pixel_by_point << term.seen.jacobian, Vector2d::Zero();
  Vector4d depth_by_point;
  depth_by_point << term.log_gradient, -1;
  const Matrix24d half = pixel_by_point * covariance;
  Matrix3d evidence_covariance;
  evidence_covariance.topLeftCorner<2, 2>().noalias() = half * pixel_by_point.transpose();
  evidence_covariance.topRightCorner<2, 1>().noalias() = half * depth_by_point;
  evidence_covariance.bottomLeftCorner<1, 2>() =
      evidence_covariance.topRightCorner<2, 1>().transpose();
  evidence_covariance(2, 2) = depth_by_point.dot(covariance * depth_by_point);
  return evidence_covariance;
}

ExpectationStep::Likelihood ExpectationStep::LikelihoodOf(const Observation& observation,
                                                          const ObservationTerm& term,
                                                          const Matrix4d& point_covariance) const {
  if (!observation.has_depth) {
    const Prediction<2> predicted(term.seen.error_px, Vector2d::Constant(term.pixel_variance),
                                  Vector2d::Constant(term.weight),
                                  PixelCovariance(term, point_covariance));
    return {.without_depth = noise_.right * Density(predicted.error, predicted.covariance),
            .squared_across = SquaredAcross(predicted.error, predicted.covariance)};
  }
  const Prediction<3> predicted({term.seen.error_px.x(), term.seen.error_px.y(), term.depth_error},
                                {term.pixel_variance, term.pixel_variance, term.depth_variance},
                                {term.weight, term.weight, term.depth_weight},
                                ResidualCovariance(term, point_covariance));
  const Vector2d error = predicted.error.head<2>();
  const Matrix2d covariance = predicted.covariance.topLeftCorner<2, 2>();
  const double right_pixel = noise_.right * Density(error, covariance);
  // The depth, given the pixel.
  const Vector2d gain = covariance.inverse() * predicted.covariance.topRightCorner<2, 1>();
  const double depth_error = predicted.error[2] - gain.dot(error);
  const double depth_variance =
      std::max(predicted.covariance(2, 2) - gain.dot(predicted.covariance.topRightCorner<2, 1>()),
               term.depth_variance);
  return {.with_depth = right_pixel * noise_.depth_right *
                        Normal1D(depth_error * depth_error, depth_variance) /
                        DensityOfAnyDistance(noise_, observation.log_distance),
          .without_depth = right_pixel * (1 - noise_.depth_right),
          .squared_across = SquaredAcross(error, covariance)};
}

void ExpectationStep::UpdateObservation(int i, const ObservationTerm& term,
                                        const KeypointPosterior& posterior) {
  double& weight = model_.weights.observation[i];
  double& of_depth = model_.weights.depth[i];
  double& precision = model_.weights.precision[i];
  if (!term.seen.in_front) {
    weight = 0;
    likelihood_.Multiply(1 - noise_.right);
    return;
  }
  const Observation& observation = evidence_.observations[i];
  const Matrix2d pixel_covariance = PixelCovariance(term, posterior.covariance);
  Approach(precision, Precision(term.seen, pixel_covariance, term.pixel_variance));
  // The noise, as of the query's pixel.
  pixels_.squares += posterior.trust * weight * precision * term.seen.error_px.squaredNorm() *
                     noise_.keypoint_px2 / term.pixel_variance;
  pixels_.count += posterior.trust * (2 * weight - term.weight * pixel_covariance.trace());
  if (term.depth_weight > 0) {
    const double w = weight * of_depth;
    depths_.squares += posterior.trust * w * term.depth_error * term.depth_error * noise_.depth /
                       term.depth_variance;
    depths_.count +=
        posterior.trust * (w - term.depth_weight * DepthVariance(term, posterior.covariance));
  }

  auto [with_depth, without_depth, squared_across] =
      posterior.query_far || IsFar(term.seen, term.pixel_variance)
          ? Likelihood{}
          : LikelihoodOf(observation, term, posterior.full_covariance);
  if (!std::isfinite(with_depth + without_depth)) with_depth = without_depth = 0;
  const double wrong = (1 - noise_.right) / evidence_.matched_area_px2 * Clutter(observation);
  const double any = with_depth + without_depth + wrong;
  const double right = (with_depth + without_depth) / any;
  likelihood_.Multiply(any * evidence_.matched_area_px2);
  if (right > 0.5 && posterior.trust > 0.5) across_.push_back(squared_across);
  Approach(weight, right);
  Approach(of_depth, with_depth > 0 ? with_depth / (with_depth + without_depth) : 0);
  right_.right += weight;
  if (observation.has_depth) {
    depth_right_.right += weight * of_depth;
    depth_right_.count += weight;
  }
}

void ExpectationStep::UpdateUnanchored(int i, const KeypointObservations& keypoint,
                                       const KeypointPosterior& posterior,
                                       const Vector3d& displaced) {
  const UnanchoredPoint& point = evidence_.unanchored[i];
  double& weight = model_.weights.unanchored[i];
  const double variance = noise_.unanchored + point.variance;
  const double used = weight >= kLeastWeight ? weight / variance : 0;
  const Vector3d e = displaced - point.point;
  const Matrix3d evidence_covariance = posterior.covariance.topLeftCorner<3, 3>();
  unanchored_.squares += posterior.trust * weight * noise_.unanchored / variance * e.squaredNorm();
  unanchored_.count += posterior.trust * (3 * weight - used * evidence_covariance.trace());

  const PixelResidual seen =
      ResidualOf(keypoint.image_from_cam, keypoint.PointInCamera(model_.pose, point.point));
  if (!seen.in_front) {
    weight = 0;
    likelihood_.Multiply(1 - noise_.unanchored_right);
    return;
  }
  const Prediction<3> predicted(e, Vector3d::Constant(variance), Vector3d::Constant(used),
                                evidence_covariance);
  const double determinant = predicted.covariance.determinant();
  const double density =
      determinant > 0
          ? std::exp(-0.5 * predicted.error.dot(predicted.covariance.inverse() * predicted.error)) /
                std::sqrt(std::pow(2 * std::numbers::pi, 3) * determinant)
          : 0;
  // A wrong one is anywhere in the image, at any distance of the scene.
  const double distance = (point.point - keypoint.CenterOfCamera(model_.pose)).norm();
  const double px2 = 0.5 * seen.jacobian.squaredNorm();
  const double any = DensityOfAnyDistance(noise_, std::log(distance)) / distance * px2 /
                     evidence_.matched_area_px2;
  const double p = std::isfinite(density) ? noise_.unanchored_right * density : 0;
  const double wrong = (1 - noise_.unanchored_right) * any;
  Approach(weight, p / (p + wrong));
  if (any > 0) likelihood_.Multiply(std::clamp((p + wrong) / any, 1e-99, 1e99));
  unanchored_right_.right += weight;
}

void ExpectationStep::UpdateNoise(const NoisePrior& prior) {
  pixels_.count -= 6;  // the pose's own unknowns take from what the pixels show
  noise_.keypoint_px2 = pixels_.Estimate(prior.keypoint_px2, noise_.keypoint_px2, 1e-10, 1e10);
  noise_.depth = depths_.Estimate(prior.depth, noise_.depth, 1e-10, 1);
  noise_.common_depth = commons_.Estimate(prior.common_depth, noise_.common_depth, 1e-10, 1);
  noise_.keypoint_errors = std::max(0.0, pixels_.count);
  noise_.depth_errors = std::max(0.0, depths_.count);
  noise_.common_depth_errors = std::max(0.0, commons_.count);
  const double extent2 = std::exp(2 * noise_.log_distance_mean);
  noise_.unanchored = unanchored_.Estimate({}, noise_.unanchored, 1e-12 * extent2, extent2);
  noise_.right = right_.Estimate(2);
  noise_.depth_right = depth_right_.Estimate(1);
  noise_.unanchored_right = unanchored_right_.Estimate(1);
  noise_.keypoint_tail = EstimateTail(across_, prior.keypoint_tail);
}

}  // namespace

double SquaredAcross(const Vector2d& error, const Matrix2d& covariance) {
  const double mean = 0.5 * covariance.trace();
  const double half = 0.5 * (covariance(0, 0) - covariance(1, 1));
  const double cross = 0.5 * (covariance(0, 1) + covariance(1, 0));
  const double root = std::hypot(half, cross);
  if (!(root > 0)) return error.x() * error.x() / mean;
  // Along the axis of the smaller eigenvalue, which as a difference of such numbers would be lost.
  const double cos2 = -half / root;
  const double sin2 = -cross / root;
  const double squared =
      0.5 * (error.squaredNorm() + cos2 * (error.x() * error.x() - error.y() * error.y())) +
      sin2 * error.x() * error.y();
  return std::max(squared, 0.0) * (mean + root) / covariance.determinant();
}

void EStep(const NoisePrior& prior, double share, const Matrix7d& query_covariance,
           JointModel& model) {
  ExpectationStep step(share, query_covariance, model);
  step.UpdateWeights();
  step.UpdateNoise(prior);
  model.log_likelihood = step.LogLikelihood();
}

}  // namespace raylift
