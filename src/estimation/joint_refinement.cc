#include "estimation/joint_refinement.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "estimation/keypoint_consensus.h"
#include "estimation/keypoint_sight.h"
#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>

#include "raylift/geometry/rigid3.h"

namespace raylift {
namespace {

using Eigen::Matrix2d;
using Eigen::Matrix3d;
using Eigen::Matrix4d;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::Vector4d;
using Eigen::VectorXd;
using Matrix23d = Eigen::Matrix<double, 2, 3>;
using Matrix24d = Eigen::Matrix<double, 2, 4>;
using Matrix36d = Eigen::Matrix<double, 3, 6>;
using Matrix47d = Eigen::Matrix<double, 4, 7>;
using Matrix4Xd = Eigen::Matrix<double, 4, Eigen::Dynamic>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using Vector7d = Eigen::Matrix<double, 7, 1>;

// Evidence with less weight is left out.
constexpr double kLeastWeight = 1e-3;
// Residuals of so many variances are beyond what the linearization tells.
constexpr double kFarSquared = 30;
// Densities of depths have tails that no normal distribution has.
constexpr double kLeastDensity = 1e-9;
// A query's pixel is wrong, although its matches agree with each other, as often as that.
constexpr double kQueryWrong = 0.1;

constexpr int kFirstRounds = 2;
constexpr int kMaxRounds = 8;
// The squared lengths of steps, in standard deviations of the pose.
constexpr double kFarStep = 4;
constexpr double kSettledStep = 0.01;
constexpr int kReferenceRounds = 3;

// What is wrong with a reference: points seem displaced to it by turn x point + shift, and its
// depths have a factor.
struct ReferenceError {
  Vector3d turn = Vector3d::Zero();
  Vector3d shift = Vector3d::Zero();
  double log_factor = 0;

  Vector3d Displaced(const Vector3d& point) const { return point + turn.cross(point) + shift; }
};

// The unknowns of a view, by how they displace a point: by a turn about the local origin, and a
// shift. (Common to all views of a point, so that one matrix serves them all.)
Matrix36d DisplacementJacobian(const Vector3d& point) {
  Matrix36d jacobian;
  jacobian << 0, point.z(), -point.y(), 1, 0, 0,  //
      -point.z(), 0, point.x(), 0, 1, 0,          //
      point.y(), -point.x(), 0, 0, 0, 1;
  return jacobian;
}

// Of a quadratic in a point's displacement and the logarithm of its depths' factor.
struct Quadratic {
  Matrix4d hessian = Matrix4d::Zero();
  Vector4d gradient = Vector4d::Zero();

  void Add(const Quadratic& other) {
    hessian += other.hessian;
    gradient += other.gradient;
  }
};

// A sighting, linearized.
struct SightingTerm {
  PixelResidual seen;
  double pixel_variance = 0;
  Vector3d log_gradient = Vector3d::Zero();  // of the logarithm of the distance
  double depth_error = 0;
  double depth_variance = 0;
  double weight = 0;        // of the pixel, over its variance
  double depth_weight = 0;  // of the depth, over its variance

  Quadratic Cost() const {
    Quadratic q;
    q.hessian.topLeftCorner<3, 3>().noalias() = weight * seen.jacobian.transpose() * seen.jacobian;
    q.gradient.head<3>().noalias() = weight * seen.jacobian.transpose() * seen.error_px;
    if (depth_weight > 0) {
      Vector4d d;
      d << log_gradient, -1;
      q.hessian.noalias() += depth_weight * d * d.transpose();
      q.gradient += depth_weight * depth_error * d;
    }
    return q;
  }
};

// The query's view, with the prior of the point's distance.
struct QueryTerm {
  PixelResidual seen;
  Matrix23d jacobian = Matrix23d::Zero();  // by the point
  double weight = 0;                       // of the pixel, over its variance
  Vector3d log_gradient = Vector3d::Zero();
  double distance_error = 0;     // logarithm of the distance less the prior's mean
  double prior_information = 0;  // of the distance's logarithm

  Matrix3d Hessian() const {
    Matrix3d hessian = prior_information * log_gradient * log_gradient.transpose();
    hessian.noalias() += weight * jacobian.transpose() * jacobian;
    return hessian;
  }
  Vector3d Gradient() const {
    Vector3d gradient = prior_information * distance_error * log_gradient;
    gradient.noalias() += weight * jacobian.transpose() * seen.error_px;
    return gradient;
  }
  // With the prior's mean as the fourth unknown.
  Quadratic Cost() const {
    Quadratic q;
    q.hessian.topLeftCorner<3, 3>() = Hessian();
    q.hessian.topRightCorner<3, 1>() = -prior_information * log_gradient;
    q.hessian.bottomLeftCorner<1, 3>() = -prior_information * log_gradient.transpose();
    q.hessian(3, 3) = prior_information;
    q.gradient << Gradient(), -prior_information * distance_error;
    return q;
  }
};

// Whether another round would change little.
bool IsSettled(const JointNoise& before, const JointNoise& now) {
  const auto alike = [](double a, double b) { return std::abs(a - b) < 0.05 * b; };
  return alike(before.keypoint_px2, now.keypoint_px2) && alike(before.depth, now.depth) &&
         alike(before.common_depth, now.common_depth) && alike(before.loose, now.loose);
}

// Whether a step of the query is one that the linearization can be believed for.
bool IsModest(const Eigen::Ref<const VectorXd>& step) {
  constexpr double kLargestTurn = 0.5;
  constexpr double kLargestFactor = 1;  // of the mean distance, as a logarithm
  return step.allFinite() && step.head<3>().norm() < kLargestTurn &&
         std::abs(step[6]) < kLargestFactor;
}

class JointRefinement {
 public:
  JointRefinement(const KeypointEvidence& evidence, const SolverPose& start,
                  double keypoint_variance_px2, double prior_variance_px2)
      : evidence_(evidence),
        prior_variance_px2_(prior_variance_px2),
        pose_(start),
        noise_(GuessNoise(evidence, start, keypoint_variance_px2)),
        references_(evidence.centres.size()),
        column_(evidence.centres.size(), -1),
        backs_(evidence.keypoints.size()) {
    FindConsensus(evidence_, pose_, noise_, states_, weights_);
  }

  JointResult Run() {
    if (HasAmbiguousKeypoints()) {
      // RANSAC's pose is so far off that some find no consensus, or a wrong one: it is looked for
      // again at a better pose.
      for (int i = 0; i < kFirstRounds; ++i) {
        if (Step() > kFarStep) Step();
        Reweigh();
      }
      noise_ = GuessNoise(evidence_, pose_, noise_.keypoint_px2);
      FindConsensus(evidence_, pose_, noise_, states_, weights_);
    }
    for (int i = 0; i < kMaxRounds; ++i) {
      const double decrement = Step();
      if (decrement > kFarStep) Step();
      const JointNoise before = noise_;
      Reweigh();
      if (decrement < kSettledStep && IsSettled(before, noise_)) break;
    }
    Step();
    if (ReferencesDisagree()) {
      AdmitReferenceErrors();
      for (int i = 0; i < kReferenceRounds; ++i) {
        Step();
        Reweigh();
      }
      Step();
    }
    return {.pose = pose_,
            .noise = noise_,
            .covariance = Covariance(),
            .references_disagree = WithReferences()};
  }

 private:
  // What is needed to move a keypoint's point after a step of the views.
  struct Back {
    bool used = false;
    Matrix4d covariance;  // of the point and its common error, the views held
    Vector4d gradient;
    Matrix4Xd views;  // d gradient / d unknowns of its views
    std::vector<int> columns;
    // Where the query alone has unknowns: the point's, its common error eliminated.
    Matrix3d point_covariance, of_query;
    Vector3d point_slope, prior, by_common;
    double common_hessian, common_slope;

    // Of the point and its common error.
    Matrix4d Covariance() const {
      Matrix4d both;
      const Vector3d cross = point_covariance * by_common / common_hessian;
      both << point_covariance, cross, cross.transpose(),
          (1 + by_common.dot(cross)) / common_hessian;
      return both;
    }
  };

  static constexpr int kQueryColumns = 7;

  bool WithReferences() const { return num_columns_ > kQueryColumns; }

  QueryTerm LookFromQuery(size_t index, const Vector3d& centre) const {
    const KeypointParts& keypoint = evidence_.keypoints[index];
    const KeypointState& state = states_[index];
    QueryTerm term;
    term.seen =
        ResidualOf(keypoint.image_from_cam, pose_.rotation * state.point + pose_.translation);
    if (!term.seen.in_front) return term;
    term.weight = state.query_right / noise_.keypoint_px2;
    term.jacobian.noalias() = term.seen.jacobian * pose_.rotation;
    const Vector3d offset = state.point - centre;
    const double squared = offset.squaredNorm();
    term.log_gradient = offset / squared;
    term.distance_error = 0.5 * std::log(squared) - noise_.log_distance_mean;
    term.prior_information = 1 / noise_.log_distance_variance;
    return term;
  }

  SightingTerm LookFromReference(int i, const KeypointState& state) const {
    const Sighting& sighting = evidence_.sightings[i];
    const ReferenceError& error = references_[sighting.reference];
    SightingTerm term;
    const Vector3d offset = error.Displaced(state.point) - sighting.centre;
    term.seen = ResidualOf(sighting.image_from_ray, offset);
    if (!term.seen.in_front) return term;
    term.pixel_variance = noise_.keypoint_px2 + sighting.extra_variance_px2;
    const double weight = weights_.sighting[i];
    if (weight >= kLeastWeight) term.weight = weight / term.pixel_variance;
    if (sighting.HasDepth()) {
      const double squared = offset.squaredNorm();
      term.log_gradient = offset / squared;
      term.depth_variance = noise_.depth + sighting.depth_variance;
      term.depth_error =
          0.5 * std::log(squared) - sighting.log_distance - state.common - error.log_factor;
      if (term.weight > 0 && weights_.depth[i] >= kLeastWeight) {
        term.depth_weight = weight * weights_.depth[i] / term.depth_variance;
      }
    }
    return term;
  }

  // The loose points are seen like by one more reference.
  size_t LooseView() const { return evidence_.num_references(); }

  Quadratic LooseCost(const KeypointParts& keypoint, const Vector3d& point) const {
    Quadratic q;
    const Vector3d displaced = references_[LooseView()].Displaced(point);
    for (int i = keypoint.first_loose; i < keypoint.end_loose; ++i) {
      if (weights_.loose[i] < kLeastWeight) continue;
      const LoosePoint& loose = evidence_.loose[i];
      const double w = weights_.loose[i] / (noise_.loose + loose.variance);
      q.hessian.diagonal().head<3>().array() += w;
      q.gradient.head<3>() += w * (displaced - loose.point);
    }
    return q;
  }

  Quadratic CommonPrior(const KeypointState& state) const {
    Quadratic q;
    q.hessian(3, 3) = 1 / noise_.common_depth;
    q.gradient[3] = state.common / noise_.common_depth;
    return q;
  }

  double TotalWeight(const KeypointParts& keypoint) const {
    double total = 0;
    for (int i = keypoint.first_sighting; i < keypoint.end_sighting; ++i) {
      total += weights_.sighting[i];
    }
    for (int i = keypoint.first_loose; i < keypoint.end_loose; ++i) total += weights_.loose[i];
    return total;
  }

  // Whether some keypoint has evidence that may contradict itself.
  bool HasAmbiguousKeypoints() const {
    return std::any_of(evidence_.keypoints.begin(), evidence_.keypoints.end(),
                       [&](const KeypointParts& keypoint) {
                         const auto sightings = evidence_.SightingsOf(keypoint);
                         return sightings.size() + evidence_.LooseOf(keypoint).size() > 1 ||
                                (sightings.size() == 1 && sightings[0].HasDepth());
                       });
  }

  Vector3d Centre() const { return -pose_.rotation.transpose() * pose_.translation; }

  // One Gauss-Newton step of all unknowns; its squared length in standard deviations (Newton's
  // decrement), 0 where there is none to take.
  double Step() { return WithReferences() ? StepOfAllViews() : StepOfQuery(); }
  double StepOfAllViews();
  double StepOfQuery();  // the same where no reference has unknowns, in closed form
  void MoveQuery(const Eigen::Ref<const VectorXd>& step);
  void MovePoint(const Vector4d& move, const Vector3d& query_centre, KeypointState& state) const;
  // The probability of each piece of evidence, by what all others of its keypoint predict, and the
  // noise that the residuals show.
  void Reweigh();

  // Whether the residuals of whole references have a direction, by the score test: chi-squared
  // with seven degrees of freedom each, if they are independent.
  bool ReferencesDisagree() const;
  void AdmitReferenceErrors();
  void UpdateReferenceVariances(const MatrixXd& covariance);

  std::optional<Matrix6d> Covariance() const;
  // By how much the pose's covariance (the first columns of the inverse Hessian) understates how far
  // the parts of the image pull the pose apart, at least 1: errors that the model does not know, of
  // the lens for instance, are common to neighbours.
  double Inflation(const MatrixXd& pose_columns) const;

  const KeypointEvidence& evidence_;
  double prior_variance_px2_;
  SolverPose pose_;
  JointNoise noise_;
  std::vector<KeypointState> states_;
  EvidenceWeights weights_;
  std::vector<ReferenceError> references_;
  std::vector<int> column_;  // of each reference's first unknown; -1: it has none
  int num_columns_ = kQueryColumns;
  std::vector<Back> backs_;
  MatrixXd hessian_;         // of the last step, the points eliminated
  MatrixXd part_gradients_;  // of the last step, one column for each part of the query's image
};

double JointRefinement::StepOfAllViews() {
  const Vector3d centre = Centre();
  hessian_.setZero(num_columns_, num_columns_);
  part_gradients_.setZero(num_columns_, kPartsOfImage);
  VectorXd prior_gradient = VectorXd::Zero(num_columns_);
  std::vector<SightingTerm> terms;
  std::vector<int> indices;
  std::vector<std::pair<int, Quadratic>> views;
  for (size_t index = 0; index < states_.size(); ++index) {
    const KeypointParts& keypoint = evidence_.keypoints[index];
    const KeypointState& state = states_[index];
    Back& back = backs_[index];
    back.used = false;
    if (TotalWeight(keypoint) < kLeastWeight) continue;
    const QueryTerm query = LookFromQuery(index, centre);
    if (!query.seen.in_front) continue;

    // The point and its common error; the prior's mean is the query's unknown, not theirs.
    Quadratic point = CommonPrior(state);
    const Quadratic loose = LooseCost(keypoint, state.point);
    point.Add(loose);
    const Quadratic query_cost = query.Cost();
    point.hessian.topLeftCorner<3, 3>() += query_cost.hessian.topLeftCorner<3, 3>();
    point.gradient.head<3>() += query_cost.gradient.head<3>();
    terms.clear();
    indices.clear();
    for (int i = keypoint.first_sighting; i < keypoint.end_sighting; ++i) {
      if (weights_.sighting[i] < kLeastWeight) continue;
      terms.push_back(LookFromReference(i, state));
      indices.push_back(i);
    }

    // Each view's cost, by its column; sightings of one reference are one view.
    views.clear();
    views.emplace_back(0, query_cost);
    for (size_t t = 0; t < terms.size(); ++t) {
      if (terms[t].weight == 0) continue;
      const Quadratic cost = terms[t].Cost();
      point.Add(cost);
      const int column = column_[evidence_.sightings[indices[t]].reference];
      if (column < 0) continue;
      const auto same = std::find_if(views.begin(), views.end(),
                                     [&](const auto& view) { return view.first == column; });
      if (same == views.end()) {
        views.emplace_back(column, cost);
      } else {
        same->second.Add(cost);
      }
    }
    if (column_[LooseView()] >= 0 && keypoint.end_loose > keypoint.first_loose) {
      views.emplace_back(column_[LooseView()], loose);
    }
    // The lower triangle is filled.
    std::sort(views.begin(), views.end(),
              [](const auto& one, const auto& other) { return one.first < other.first; });

    back.covariance = point.hessian.inverse();
    if (!back.covariance.allFinite()) continue;
    const Matrix36d displacement = DisplacementJacobian(state.point);
    auto gradient = part_gradients_.col(keypoint.part_of_image);
    back.views.resize(4, 7 * static_cast<int>(views.size()));
    back.columns.clear();
    for (const auto& [column, cost] : views) {
      Matrix47d columns;
      columns.leftCols<6>().noalias() = cost.hessian.leftCols<3>().lazyProduct(displacement);
      columns.col(6) = cost.hessian.col(3);
      hessian_.block<6, 7>(column, column).noalias() +=
          displacement.transpose().lazyProduct(columns.topRows<3>());
      hessian_.block<1, 7>(column + 6, column) += columns.row(3);
      gradient.segment<6>(column).noalias() += displacement.transpose() * cost.gradient.head<3>();
      gradient[column + 6] += cost.gradient[3];
      // The query's fourth unknown is the prior's mean, not the point's error.
      if (column == 0) columns.row(3).setZero();
      back.views.middleCols<7>(7 * static_cast<int>(back.columns.size())) = columns;
      back.columns.push_back(column);
    }

    // Eliminates the point.
    const Vector4d solved_gradient = back.covariance * point.gradient;
    for (size_t i = 0; i < back.columns.size(); ++i) {
      const auto part = back.views.middleCols<7>(7 * static_cast<int>(i));
      const Matrix47d solved = back.covariance * part;
      gradient.segment<7>(back.columns[i]).noalias() -= part.transpose() * solved_gradient;
      for (size_t j = 0; j <= i; ++j) {
        hessian_.block<7, 7>(back.columns[i], back.columns[j]).noalias() -=
            solved.transpose().lazyProduct(back.views.middleCols<7>(7 * static_cast<int>(j)));
      }
    }
    back.used = true;
    back.gradient = point.gradient;
  }

  for (size_t r = 0; r < references_.size(); ++r) {
    if (column_[r] < 0) continue;
    // The centre c is displaced by turn x c + shift.
    Eigen::Matrix<double, 7, 7> to_prior = Eigen::Matrix<double, 7, 7>::Identity();
    to_prior.block<3, 6>(3, 0) = DisplacementJacobian(evidence_.centres[r]);
    Vector7d value, information;
    const ReferenceError& error = references_[r];
    value << error.turn, error.Displaced(evidence_.centres[r]) - evidence_.centres[r],
        error.log_factor;
    information << Vector3d::Constant(1 / noise_.reference_rotation),
        Vector3d::Constant(1 / noise_.reference_centre), 1 / noise_.reference_factor;
    hessian_.block<7, 7>(column_[r], column_[r]) +=
        to_prior.transpose() * information.asDiagonal() * to_prior;
    prior_gradient.segment<7>(column_[r]) += to_prior.transpose() * information.cwiseProduct(value);
  }
  hessian_ = MatrixXd(hessian_.selfadjointView<Eigen::Lower>());
  const VectorXd gradient = part_gradients_.rowwise().sum() + prior_gradient;

  MatrixXd damped = hessian_;
  damped.diagonal().head<7>().array() += 1e-12 * damped.diagonal().head<7>().maxCoeff();
  const Eigen::LDLT<MatrixXd> factors(damped);
  const VectorXd step = factors.solve(-gradient);
  if (!IsModest(step)) return 0;

  MoveQuery(step);
  for (size_t r = 0; r < references_.size(); ++r) {
    if (column_[r] < 0) continue;
    references_[r].turn += step.segment<3>(column_[r]);
    references_[r].shift += step.segment<3>(column_[r] + 3);
    references_[r].log_factor += step[column_[r] + 6];
  }
  UpdateReferenceVariances(factors.solve(MatrixXd::Identity(num_columns_, num_columns_)));

  const Vector3d new_centre = Centre();
  for (size_t index = 0; index < states_.size(); ++index) {
    const Back& back = backs_[index];
    if (!back.used) continue;
    KeypointState& state = states_[index];
    Vector4d pull = back.gradient;
    for (size_t a = 0; a < back.columns.size(); ++a) {
      pull.noalias() +=
          back.views.middleCols<7>(7 * static_cast<int>(a)) * step.segment<7>(back.columns[a]);
    }
    MovePoint(-back.covariance * pull, new_centre, state);
  }
  return -gradient.dot(step);
}

void JointRefinement::MoveQuery(const Eigen::Ref<const VectorXd>& step) {
  pose_.translation += pose_.rotation * step.segment<3>(3);
  const Matrix3d turn = RotationFromVector(step.head<3>()).toRotationMatrix();
  pose_.rotation = Eigen::Quaterniond(pose_.rotation * turn).normalized().toRotationMatrix();
  noise_.log_distance_mean += step[6];
}

void JointRefinement::MovePoint(const Vector4d& move, const Vector3d& query_centre,
                                KeypointState& state) const {
  // Not beyond what the linearization tells.
  const double limit = 0.5 * (state.point - query_centre).norm();
  const double length = move.head<3>().norm();
  if (!std::isfinite(length + move[3])) return;
  const double share = length > limit ? limit / length : 1;
  state.point += share * move.head<3>();
  state.common += share * move[3];
}

double JointRefinement::StepOfQuery() {
  const Vector3d centre = Centre();
  Eigen::Matrix<double, 7, 7> hessian = Eigen::Matrix<double, 7, 7>::Zero();
  part_gradients_.setZero(7, kPartsOfImage);
  const double common_information = 1 / noise_.common_depth;
  for (size_t index = 0; index < states_.size(); ++index) {
    const KeypointParts& keypoint = evidence_.keypoints[index];
    const KeypointState& state = states_[index];
    Back& back = backs_[index];
    back.used = false;
    if (TotalWeight(keypoint) < kLeastWeight) continue;
    const QueryTerm query = LookFromQuery(index, centre);
    if (!query.seen.in_front) continue;

    // What the references know of the point; its common error is eliminated first.
    const Quadratic loose = LooseCost(keypoint, state.point);
    Matrix3d known = loose.hessian.topLeftCorner<3, 3>();
    Vector3d slope = loose.gradient.head<3>();
    Vector3d by_common = Vector3d::Zero();
    double common_hessian = common_information;
    double common_slope = common_information * state.common;
    for (int i = keypoint.first_sighting; i < keypoint.end_sighting; ++i) {
      if (weights_.sighting[i] < kLeastWeight) continue;
      const SightingTerm term = LookFromReference(i, state);
      if (term.weight == 0) continue;
      known.noalias() += term.weight * term.seen.jacobian.transpose() * term.seen.jacobian;
      slope.noalias() += term.weight * term.seen.jacobian.transpose() * term.seen.error_px;
      if (term.depth_weight == 0) continue;
      const Vector3d weighted = term.depth_weight * term.log_gradient;
      known.noalias() += weighted * term.log_gradient.transpose();
      slope += term.depth_error * weighted;
      by_common += weighted;
      common_hessian += term.depth_weight;
      common_slope -= term.depth_weight * term.depth_error;
    }
    known.noalias() -= by_common * by_common.transpose() / common_hessian;
    slope += common_slope / common_hessian * by_common;

    const Matrix3d of_query = query.Hessian();
    const Vector3d query_slope = query.Gradient();
    const Matrix3d covariance = (known + of_query).inverse();
    const Matrix3d share = of_query * covariance;
    // What is left for the pose, and for the mean distance.
    const Matrix3d reduced = of_query - share * of_query;
    const Vector3d pull = query_slope - share * (slope + query_slope);
    const Vector3d prior = -query.prior_information * query.log_gradient;
    const Vector3d by_mean = prior - share * prior;
    Matrix3d cross;
    const Vector3d& p = state.point;
    cross << 0, -p.z(), p.y(), p.z(), 0, -p.x(), -p.y(), p.x(), 0;
    const Matrix3d turned = cross * reduced;
    if (!std::isfinite(reduced.sum() + pull.sum())) continue;
    hessian.topLeftCorner<3, 3>().noalias() -= turned * cross;
    hessian.block<3, 3>(3, 0) += turned.transpose();
    hessian.block<3, 3>(3, 3) += reduced;
    hessian.block<1, 3>(6, 0).noalias() += (cross * by_mean).transpose();
    hessian.block<1, 3>(6, 3) += by_mean.transpose();
    hessian(6, 6) += query.prior_information - prior.dot(covariance * prior);
    auto gradient = part_gradients_.col(keypoint.part_of_image);
    gradient.head<3>().noalias() += cross * pull;
    gradient.segment<3>(3) += pull;
    gradient[6] += -query.prior_information * query.distance_error -
                   prior.dot(covariance * (slope + query_slope));

    back.used = true;
    back.point_covariance = covariance;
    back.point_slope = slope + query_slope;
    back.of_query = of_query;
    back.prior = prior;
    back.by_common = by_common;
    back.common_hessian = common_hessian;
    back.common_slope = common_slope;
  }
  hessian = Eigen::Matrix<double, 7, 7>(hessian.selfadjointView<Eigen::Lower>());
  hessian_ = hessian;
  const Vector7d gradient = part_gradients_.rowwise().sum();
  hessian.diagonal().array() += 1e-12 * hessian.diagonal().maxCoeff();
  const Vector7d step = hessian.ldlt().solve(-gradient);
  if (!IsModest(step)) return 0;
  MoveQuery(step);
  const Vector3d new_centre = Centre();
  for (size_t index = 0; index < states_.size(); ++index) {
    const Back& back = backs_[index];
    if (!back.used) continue;
    KeypointState& state = states_[index];
    const Vector3d displaced = step.head<3>().cross(state.point) + step.segment<3>(3);
    const Vector3d pull = back.point_slope + back.of_query * displaced + step[6] * back.prior;
    Vector4d move;
    move.head<3>() = -(back.point_covariance * pull);
    move[3] = (back.by_common.dot(move.head<3>()) - back.common_slope) / back.common_hessian;
    MovePoint(move, new_centre, state);
  }
  return -gradient.dot(step);
}

// The leave-one-out prediction of residuals `e` with variances `variance`, of which a part
// `information` is among the evidence that gave them; `spread` is the evidence's uncertainty in
// them.
template <int N>
struct Prediction {
  Eigen::Matrix<double, N, 1> error;
  Eigen::Matrix<double, N, N> covariance;

  Prediction(const Eigen::Matrix<double, N, 1>& e, const Eigen::Matrix<double, N, 1>& variance,
             const Eigen::Matrix<double, N, 1>& information,
             const Eigen::Matrix<double, N, N>& spread) {
    const Eigen::Matrix<double, N, N> rest =
        Eigen::Matrix<double, N, N>::Identity() - spread * information.asDiagonal();
    const Eigen::Matrix<double, N, N> without = rest.inverse();
    error = without * e;
    covariance = without * spread;
    covariance.diagonal() += variance;
  }
};

double Density(const Vector2d& error, const Matrix2d& covariance) {
  const double determinant = covariance.determinant();
  if (!(determinant > 0)) return 0;
  const double density = std::exp(-0.5 * error.dot(covariance.inverse() * error)) /
                         (2 * std::numbers::pi * std::sqrt(determinant));
  return std::isfinite(density) ? density : 0;
}

void JointRefinement::Reweigh() {
  const Vector3d centre = Centre();
  const double wrong = (1 - noise_.right) / evidence_.query_area_px2;
  struct Sum {
    double squares = 0, count = 0;
  };
  Sum pixels, depths, commons, loose;
  Sum right, depth_right, loose_right;
  std::vector<SightingTerm> terms;
  for (size_t index = 0; index < states_.size(); ++index) {
    const KeypointParts& keypoint = evidence_.keypoints[index];
    KeypointState& state = states_[index];
    const QueryTerm query = LookFromQuery(index, centre);
    right.count += keypoint.end_sighting - keypoint.first_sighting;
    loose_right.count += keypoint.end_loose - keypoint.first_loose;
    if (!query.seen.in_front) {
      for (int i = keypoint.first_sighting; i < keypoint.end_sighting; ++i)
        weights_.sighting[i] = 0;
      for (int i = keypoint.first_loose; i < keypoint.end_loose; ++i) weights_.loose[i] = 0;
      continue;
    }
    const double total = TotalWeight(keypoint);
    Quadratic others = CommonPrior(state);
    others.Add(LooseCost(keypoint, state.point));
    // The prior of the distance helps to predict the query, too.
    const double prior = 1 / noise_.log_distance_variance;
    const Vector3d offset = state.point - centre;
    const Vector3d d = offset / offset.squaredNorm();
    others.hessian.topLeftCorner<3, 3>().noalias() += prior * d * d.transpose();
    others.gradient.head<3>() += prior * (std::log(offset.norm()) - noise_.log_distance_mean) * d;
    int num_right = 0;
    terms.clear();
    for (int i = keypoint.first_sighting; i < keypoint.end_sighting; ++i) {
      terms.push_back(LookFromReference(i, state));
      num_right += weights_.sighting[i] > 0.5 ? 1 : 0;
      if (terms.back().weight > 0) others.Add(terms.back().Cost());
    }
    for (int i = keypoint.first_loose; i < keypoint.end_loose; ++i) {
      num_right += weights_.loose[i] > 0.5 ? 1 : 0;
    }
    Quadratic all = others;
    all.hessian.topLeftCorner<3, 3>().noalias() +=
        query.weight * query.jacobian.transpose() * query.jacobian;
    const Matrix4d covariance = all.hessian.inverse();
    if (!covariance.allFinite()) continue;
    bool far = query.seen.error_px.squaredNorm() > kFarSquared * noise_.keypoint_px2;
    for (const SightingTerm& term : terms) {
      far = far || (term.weight > 0 &&
                    term.seen.error_px.squaredNorm() > kFarSquared * term.pixel_variance);
    }
    // What has not found its place yet says nothing of the noise.
    const double trust = far ? 0 : std::min(1.0, total) * state.query_right;

    // The query's pixel.
    if (total > 0.1) {
      const Matrix2d spread =
          query.jacobian * covariance.topLeftCorner<3, 3>() * query.jacobian.transpose();
      const Prediction<2> predicted(query.seen.error_px, Vector2d::Constant(noise_.keypoint_px2),
                                    Vector2d::Constant(query.weight), spread);
      const double chance = kQueryWrong / evidence_.query_area_px2;
      const double density = (1 - kQueryWrong) * Density(predicted.error, predicted.covariance);
      pixels.squares += trust * state.query_right * query.seen.error_px.squaredNorm();
      pixels.count += trust * (2 * state.query_right - query.weight * spread.trace());
      // A single match does not tell whose pixel is wrong: that is its own weight.
      state.query_right = num_right >= 2 ? density / (density + chance) : 1;
    }
    const bool query_far =
        num_right <= 1 && query.seen.error_px.squaredNorm() > kFarSquared * noise_.keypoint_px2;

    double depth_weight = 0;
    for (int i = keypoint.first_sighting; i < keypoint.end_sighting; ++i) {
      const SightingTerm& term = terms[static_cast<size_t>(i - keypoint.first_sighting)];
      double& weight = weights_.sighting[i];
      double& of_depth = weights_.depth[i];
      if (!term.seen.in_front) {
        weight = 0;
        continue;
      }
      const bool has_depth = evidence_.sightings[i].HasDepth();
      const Matrix24d pixel_by_point =
          (Matrix24d() << term.seen.jacobian, Vector2d::Zero()).finished();
      Vector4d depth_by_point;
      depth_by_point << term.log_gradient, -1;
      const Matrix24d half = pixel_by_point * covariance;
      Matrix3d spread;
      spread.topLeftCorner<2, 2>().noalias() = half * pixel_by_point.transpose();
      spread.topRightCorner<2, 1>().noalias() = half * depth_by_point;
      spread.bottomLeftCorner<1, 2>() = spread.topRightCorner<2, 1>().transpose();
      spread(2, 2) = depth_by_point.dot(covariance * depth_by_point);

      // The noise, with the weights that gave the points.
      pixels.squares += trust * weight * term.seen.error_px.squaredNorm() * noise_.keypoint_px2 /
                        term.pixel_variance;
      pixels.count += trust * (2 * weight - term.weight * spread.topLeftCorner<2, 2>().trace());
      if (term.depth_weight > 0) {
        const double w = weight * of_depth;
        depths.squares +=
            trust * w * term.depth_error * term.depth_error * noise_.depth / term.depth_variance;
        depths.count += trust * (w - term.depth_weight * spread(2, 2));
        depth_weight += w;
      }

      double deep = 0;
      double shallow = 0;
      if (has_depth) {
        const Vector3d e(term.seen.error_px.x(), term.seen.error_px.y(), term.depth_error);
        const Prediction<3> predicted(
            e, Vector3d(term.pixel_variance, term.pixel_variance, term.depth_variance),
            Vector3d(term.weight, term.weight, term.depth_weight), spread);
        const Vector2d error = predicted.error.head<2>();
        const Matrix2d pixel = predicted.covariance.topLeftCorner<2, 2>();
        const double right_pixel = noise_.right * Density(error, pixel);
        // The depth, given the pixel.
        const Vector2d gain = pixel.inverse() * predicted.covariance.topRightCorner<2, 1>();
        const double depth_error = predicted.error[2] - gain.dot(error);
        const double depth_variance =
            predicted.covariance(2, 2) - gain.dot(predicted.covariance.topRightCorner<2, 1>());
        const double off = evidence_.sightings[i].log_distance - noise_.log_distance_mean;
        const double any = Normal1D(off * off, 2 * noise_.log_distance_variance) + kLeastDensity;
        deep = right_pixel * noise_.depth_right *
               Normal1D(depth_error * depth_error, std::max(depth_variance, term.depth_variance)) /
               any;
        shallow = right_pixel * (1 - noise_.depth_right);
      } else {
        const Prediction<2> predicted(term.seen.error_px, Vector2d::Constant(term.pixel_variance),
                                      Vector2d::Constant(term.weight),
                                      Matrix2d(spread.topLeftCorner<2, 2>()));
        shallow = noise_.right * Density(predicted.error, predicted.covariance);
      }
      if (query_far || !std::isfinite(deep + shallow) ||
          term.seen.error_px.squaredNorm() > kFarSquared * term.pixel_variance) {
        deep = shallow = 0;
      }
      weight = (deep + shallow) / (deep + shallow + wrong);
      of_depth = deep > 0 ? deep / (deep + shallow) : 0;
      right.squares += weight;
      if (has_depth) {
        depth_right.squares += weight * of_depth;
        depth_right.count += weight;
      }
    }
    if (depth_weight > 0) {
      commons.squares += trust * state.common * state.common;
      commons.count += trust * (1 - covariance(3, 3) / noise_.common_depth);
    }

    for (int i = keypoint.first_loose; i < keypoint.end_loose; ++i) {
      const LoosePoint& point = evidence_.loose[i];
      double& weight = weights_.loose[i];
      const double variance = noise_.loose + point.variance;
      const double used = weight >= kLeastWeight ? weight / variance : 0;
      const Vector3d e = references_[LooseView()].Displaced(state.point) - point.point;
      const Matrix3d spread = covariance.topLeftCorner<3, 3>();
      const double share = noise_.loose / variance;
      loose.squares += trust * weight * share * e.squaredNorm();
      loose.count += trust * (3 * weight - used * spread.trace());
      const PixelResidual seen =
          ResidualOf(keypoint.image_from_cam, pose_.rotation * point.point + pose_.translation);
      if (!seen.in_front) {
        weight = 0;
        continue;
      }
      const Prediction<3> predicted(e, Vector3d::Constant(variance), Vector3d::Constant(used),
                                    spread);
      const double determinant = predicted.covariance.determinant();
      const double density =
          determinant > 0 ? std::exp(-0.5 * predicted.error.dot(predicted.covariance.inverse() *
                                                                predicted.error)) /
                                std::sqrt(std::pow(2 * std::numbers::pi, 3) * determinant)
                          : 0;
      // A wrong one is anywhere in the image, at any distance of the scene.
      const double distance = (point.point - centre).norm();
      const double off = std::log(distance) - noise_.log_distance_mean;
      const double px2 = 0.5 * seen.jacobian.squaredNorm();
      const double any = (Normal1D(off * off, 2 * noise_.log_distance_variance) + kLeastDensity) /
                         distance * px2 / evidence_.query_area_px2;
      const double p = std::isfinite(density) ? noise_.loose_right * density : 0;
      weight = p / (p + (1 - noise_.loose_right) * any);
      loose_right.squares += weight;
    }
  }

  // The pose's own unknowns take from what the pixels show.
  constexpr double kPriorPixels = 4;
  noise_.keypoint_px2 = (pixels.squares + kPriorPixels * prior_variance_px2_) /
                        (std::max(pixels.count - 6, 0.0) + kPriorPixels);
  if (depths.count > 1) noise_.depth = std::clamp(depths.squares / depths.count, 1e-10, 1.0);
  if (commons.count > 1) {
    noise_.common_depth = std::clamp(commons.squares / commons.count, 1e-10, 1.0);
  }
  if (loose.count > 1) {
    const double extent = std::exp(2 * noise_.log_distance_mean);
    noise_.loose = std::clamp(loose.squares / loose.count, 1e-12 * extent, extent);
  }
  const auto share = [](const Sum& sum, double prior) {
    return std::clamp((sum.squares + prior) / (sum.count + 2 * prior), 0.01, 0.99);
  };
  noise_.right = share(right, 2);
  noise_.depth_right = share(depth_right, 1);
  noise_.loose_right = share(loose_right, 1);
}

bool JointRefinement::ReferencesDisagree() const {
  std::vector<Eigen::Matrix<double, 7, 7>> information(references_.size(),
                                                       Eigen::Matrix<double, 7, 7>::Zero());
  std::vector<Vector7d> score(references_.size(), Vector7d::Zero());
  std::vector<int> residuals(references_.size(), 0);
  for (size_t index = 0; index < states_.size(); ++index) {
    const KeypointParts& keypoint = evidence_.keypoints[index];
    if (!backs_[index].used) continue;
    const Matrix4d covariance = backs_[index].Covariance();
    Eigen::Matrix<double, 4, 7> by_view = Eigen::Matrix<double, 4, 7>::Zero();
    by_view.topLeftCorner<3, 6>() = DisplacementJacobian(states_[index].point);
    by_view(3, 6) = 1;
    const auto add = [&](size_t view, const Quadratic& cost) {
      const Matrix4d reduced = cost.hessian - cost.hessian * covariance * cost.hessian;
      information[view].noalias() += by_view.transpose() * reduced * by_view;
      score[view].noalias() += by_view.transpose() * cost.gradient;
      residuals[view] += 3;
    };
    for (int i = keypoint.first_sighting; i < keypoint.end_sighting; ++i) {
      if (weights_.sighting[i] < 0.5) continue;
      const SightingTerm term = LookFromReference(i, states_[index]);
      if (term.weight > 0) {
        add(static_cast<size_t>(evidence_.sightings[i].reference), term.Cost());
      }
    }
    if (keypoint.end_loose > keypoint.first_loose) {
      add(LooseView(), LooseCost(keypoint, states_[index].point));
    }
  }
  double statistic = 0;
  int degrees = 0;
  for (size_t r = 0; r < references_.size(); ++r) {
    const double trace = information[r].trace();
    if (!(trace > 0)) continue;
    information[r].diagonal().array() += 1e-9 * trace;
    statistic += score[r].dot(information[r].ldlt().solve(score[r]));
    degrees += std::min(residuals[r], r == LooseView() ? 6 : 7);
  }
  // One case in a thousand, by the normal approximation.
  return degrees > 0 && statistic > degrees + 3.1 * std::sqrt(2.0 * degrees);
}

void JointRefinement::AdmitReferenceErrors() {
  std::vector<double> support(references_.size(), 0);
  for (size_t i = 0; i < evidence_.sightings.size(); ++i) {
    support[evidence_.sightings[i].reference] += weights_.sighting[i];
  }
  for (const double weight : weights_.loose) support[LooseView()] += weight;
  for (size_t r = 0; r < references_.size(); ++r) {
    if (support[r] < 1) continue;
    column_[r] = num_columns_;
    num_columns_ += 7;
  }
  // To begin with, as large as what single matches show.
  const double angle2 = noise_.keypoint_px2 / (evidence_.focal_px * evidence_.focal_px);
  noise_.reference_rotation = 0.25 * angle2;
  noise_.reference_centre = 0.25 * angle2 * std::exp(2 * noise_.log_distance_mean);
  noise_.reference_factor = noise_.depth + noise_.common_depth;
}

void JointRefinement::UpdateReferenceVariances(const MatrixXd& covariance) {
  struct Sum {
    double squares = 0, count = 0;
    double Variance(double prior) const {
      return std::max((squares + prior) / (std::max(count, 0.0) + 1), 1e-14);
    }
  };
  Sum rotation, centre, factor;
  for (size_t r = 0; r < references_.size(); ++r) {
    if (column_[r] < 0) continue;
    const ReferenceError& error = references_[r];
    const Matrix36d at_centre = DisplacementJacobian(evidence_.centres[r]);
    const Matrix6d pose = covariance.block<6, 6>(column_[r], column_[r]);
    rotation.squares += error.turn.squaredNorm();
    rotation.count += 3 - pose.topLeftCorner<3, 3>().trace() / noise_.reference_rotation;
    centre.squares += (error.Displaced(evidence_.centres[r]) - evidence_.centres[r]).squaredNorm();
    centre.count +=
        3 - (at_centre * pose * at_centre.transpose()).trace() / noise_.reference_centre;
    factor.squares += error.log_factor * error.log_factor;
    factor.count += 1 - covariance(column_[r] + 6, column_[r] + 6) / noise_.reference_factor;
  }
  // As if one more reference had errors of a tenth of a keypoint's, or of a depth's.
  const double angle2 = 0.01 * noise_.keypoint_px2 / (evidence_.focal_px * evidence_.focal_px);
  noise_.reference_rotation = rotation.Variance(angle2);
  noise_.reference_centre = centre.Variance(angle2 * std::exp(2 * noise_.log_distance_mean));
  noise_.reference_factor = factor.Variance(noise_.depth + noise_.common_depth);
}

std::optional<Matrix6d> JointRefinement::Covariance() const {
  if (hessian_.rows() == 0) return std::nullopt;
  const Eigen::LDLT<MatrixXd> factors(hessian_);
  if (!factors.isPositive() || !(factors.rcond() > 1e-16)) return std::nullopt;
  const MatrixXd inverse =
      factors.solve(MatrixXd::Identity(num_columns_, num_columns_).leftCols(6));
  // From a turn about the local origin and a shift before the pose to (w, v) after it.
  Matrix6d to_cam = Matrix6d::Zero();
  Matrix3d cross;
  const Vector3d& t = pose_.translation;
  cross << 0, -t.z(), t.y(), t.z(), 0, -t.x(), -t.y(), t.x(), 0;
  to_cam.topLeftCorner<3, 3>() = pose_.rotation;
  to_cam.bottomRightCorner<3, 3>() = pose_.rotation;
  to_cam.bottomLeftCorner<3, 3>() = cross * pose_.rotation;
  const Matrix6d covariance =
      Inflation(inverse) * to_cam * inverse.topRows<6>() * to_cam.transpose();
  if (!covariance.allFinite()) return std::nullopt;
  return Matrix6d(0.5 * (covariance + covariance.transpose()));
}

double JointRefinement::Inflation(const MatrixXd& pose_columns) const {
  // Each part's step, if the others were settled: a sandwich estimator with clusters.
  const MatrixXd steps = pose_columns.transpose() * part_gradients_;
  const Matrix6d covariance = pose_columns.topRows<6>();
  const Eigen::LDLT<Matrix6d> factors(covariance);
  double squares = 0;
  int parts = 0;
  for (int part = 0; part < kPartsOfImage; ++part) {
    if (part_gradients_.col(part).isZero(0)) continue;
    squares += steps.col(part).dot(factors.solve(steps.col(part)));
    ++parts;
  }
  // Few parts tell nothing of six unknowns.
  if (parts <= 6) return 1;
  const double inflation = squares / 6 * parts / (parts - 1);
  return std::isfinite(inflation) ? std::max(1.0, inflation) : 1;
}

}  // namespace

JointResult RefineJointly(const KeypointEvidence& evidence, const SolverPose& start,
                          double keypoint_variance_px2, double prior_variance_px2) {
  return JointRefinement(evidence, start, keypoint_variance_px2, prior_variance_px2).Run();
}

}  // namespace raylift
