#include "estimation/methods/assumed_lens.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "base/statistics.h"

#include "raylift/base/error.h"

namespace raylift {
namespace {

// These are standard deviations. The cameras that well-known data sets have calibrated (TUM RGB-D's
// first two, EuRoC's, KITTI's) have a principal point that is 1.3 % of the width from the middle,
// root mean square of both coordinates, and a radial term of .29. Those of phones are less
// distorted: kRadialSigma is between the two.
constexpr double kPrincipalPointSigma = 0.013;  // of the longer side
constexpr double kRadial2Sigma = 0.1;           // of the term of the fourth power: EuRoC's is .07

// These are the places in Camera::params() of RADIAL.
enum Param : size_t { kFocal, kCenterX, kCenterY, kRadial, kRadial2 };

constexpr int kRounds = 15;
constexpr size_t kLeastKeypoints = 11;  // as many as unknowns
// These are the median of a squared residual over its variance per coordinate, 2 log 2, and the
// degrees of freedom nu of Student's t, which gives a residual of zero the weight 1 + 2 / nu.
constexpr double kMedianOfSquare = 1.386;
constexpr double kDegrees = 4;

constexpr int kLensSize = 5;
using LensVector = Eigen::Matrix<double, kLensSize, 1>;
using UnknownVector = Eigen::Matrix<double, 6 + kLensSize, 1>;
using UnknownMatrix = Eigen::Matrix<double, 6 + kLensSize, 6 + kLensSize>;
using Jacobian = Eigen::Matrix<double, 2, 6 + kLensSize>;

// Returns a lens's parameters less the assumed one's, of the focal length the logarithms'
// difference.
LensVector OffsetOf(const Camera& camera, const Camera& assumed) {
  LensVector offset;
  for (int i = 0; i < kLensSize; ++i) offset[i] = camera.params()[i] - assumed.params()[i];
  offset[kFocal] = std::log(camera.params()[kFocal] / assumed.params()[kFocal]);
  return offset;
}

Camera WithParams(const Camera& camera, const std::vector<double>& params) {
  return {camera.model(), camera.width_px(), camera.height_px(), params};
}

Camera Moved(const Camera& camera, const LensVector& step) {
  std::vector<double> params(camera.params().begin(), camera.params().end());
  params[kFocal] *= std::exp(step[kFocal]);
  for (size_t i = kCenterX; i < kLensSize; ++i) params[i] += step[static_cast<int>(i)];
  return WithParams(camera, params);
}

struct Residual {
  Eigen::Vector2d px;
  Jacobian by_unknowns;  // of the pose's step (w, v) and the lens
};

std::optional<Residual> ResidualOf(const Camera& camera, const Rigid3& pose,
                                   const Match2D3D& match) {
  const Eigen::Vector3d point = pose * match.point_in_world;
  const auto seen = camera.ImgFromCamWithJacobian(point);
  if (!seen) return std::nullopt;
  Residual residual = {seen->pixel - match.query_px, Jacobian::Zero()};
  residual.by_unknowns.leftCols<3>() = -seen->jacobian * Skew(point);
  residual.by_unknowns.middleCols<3>(3) = seen->jacobian;
  const Eigen::Vector2d undistorted = point.hnormalized();
  residual.by_unknowns.col(6) = seen->pixel - camera.principal_point_px();
  residual.by_unknowns.middleCols<2>(7).setIdentity();
  const double radius2 = undistorted.squaredNorm();
  residual.by_unknowns.col(9) = camera.params()[kFocal] * radius2 * undistorted;
  residual.by_unknowns.col(10) = radius2 * residual.by_unknowns.col(9);
  return residual;
}

// A match near the pose, and its weight: one over the number of its keypoint's matches near it.
struct WeightedMatch {
  const Match2D3D* match;
  double weight;
};

// Returns the matches within the threshold; none if they are of too few keypoints.
std::vector<WeightedMatch> MatchesNear(const PoseProblem& problem, const Repeats& repeats,
                                       const Camera& camera, const Rigid3& pose,
                                       double threshold_px) {
  std::map<size_t, int> count_of;
  std::vector<WeightedMatch> near;
  const auto keypoint_of = [&](const Match2D3D& match) {
    return repeats.keypoints.of_2d3d[&match - problem.matches_2d3d.data()];
  };
  for (size_t i = 0; i < problem.matches_2d3d.size(); ++i) {
    if (repeats.of_2d3d[i] != i) continue;
    const Match2D3D& match = problem.matches_2d3d[i];
    const auto residual = ResidualOf(camera, pose, match);
    if (!residual || !(residual->px.norm() < threshold_px)) continue;
    near.push_back({&match, 1});
    ++count_of[keypoint_of(match)];
  }
  if (count_of.size() < kLeastKeypoints) return {};
  for (auto& [match, weight] : near) weight = 1.0 / count_of.at(keypoint_of(*match));
  return near;
}

// The normal equations of lens and pose, over the variance that the residuals show.
struct Equations {
  UnknownMatrix hessian = UnknownMatrix::Zero();
  UnknownVector gradient = UnknownVector::Zero();
};

Equations Linearize(const std::vector<WeightedMatch>& matches, const Camera& camera,
                    const Rigid3& pose) {
  std::vector<double> squares;
  std::vector<std::pair<Residual, double>> residuals;
  for (const auto& [match, weight] : matches) {
    const auto residual = ResidualOf(camera, pose, *match);
    if (!residual) continue;
    residuals.emplace_back(*residual, weight);
    squares.push_back(residual->px.squaredNorm());
  }
  Equations equations;
  const double variance = std::max(UpperMedianOr(squares, 1) / kMedianOfSquare, 1e-6);
  for (const auto& [residual, share] : residuals) {
    const double t = residual.px.squaredNorm() / (kDegrees * variance);
    const double weight = share * (1 + 2 / kDegrees) / (variance * (1 + t));
    equations.hessian += weight * residual.by_unknowns.transpose() * residual.by_unknowns;
    equations.gradient += weight * residual.by_unknowns.transpose() * residual.px;
  }
  return equations;
}

// Adds the pose's priors, whose steps are in local units, to equations in scene units.
void AddPosePriors(const NormalizedProblem& normalized, const Rigid3& pose, Equations& equations) {
  if (normalized.priors.empty()) return;
  Vector6d local_from_scene = Vector6d::Ones();
  local_from_scene.tail<3>() /= normalized.scale;
  const Eigen::LLT<UnknownMatrix> factors(equations.hessian);
  if (factors.info() != Eigen::Success) return;
  const UnknownMatrix covariance = factors.solve(UnknownMatrix::Identity());
  const Matrix6d of_pose = local_from_scene.asDiagonal() * covariance.topLeftCorner<6, 6>() *
                           local_from_scene.asDiagonal();
  NormalEquations local;
  normalized.priors.AddTo(normalized.ToLocal(pose), of_pose, local);
  equations.hessian.topLeftCorner<6, 6>() +=
      local_from_scene.asDiagonal() * local.hessian * local_from_scene.asDiagonal();
  equations.gradient.head<6>() += local_from_scene.cwiseProduct(local.gradient);
}

}  // namespace

bool LensIsAssumed(const Camera& camera, const PosePriors& priors) {
  return priors.focal_range > 1 && camera.model() == CameraModel::kSimplePinhole &&
         camera.params()[kCenterX] == 0.5 * camera.width_px() &&
         camera.params()[kCenterY] == 0.5 * camera.height_px();
}

Camera WithRadialTerms(const Camera& camera) {
  std::vector<double> params(camera.params().begin(), camera.params().end());
  params.insert(params.end(), 2, 0);
  return {CameraModel::kRadial, camera.width_px(), camera.height_px(), params};
}

Camera WithRadialMoved(const Camera& camera, double by) {
  return Moved(camera, by * LensVector::Unit(kRadial));
}

double RadialTerm(const Camera& camera) { return camera.params()[kRadial]; }

std::optional<AssumedLens> RefineAssumedLens(const PoseProblem& problem,
                                             const NormalizedProblem& normalized,
                                             const Camera& start, const Rigid3& cam_from_world,
                                             const Camera& assumed, double range,
                                             double threshold_px) {
  const double center_sigma =
      kPrincipalPointSigma * std::max(assumed.width_px(), assumed.height_px());
  LensVector sigma;
  sigma << std::log(range) / std::sqrt(3.0), center_sigma, center_sigma, kRadialSigma,
      kRadial2Sigma;
  const LensVector information = sigma.cwiseAbs2().cwiseInverse();
  std::optional<AssumedLens> refined;
  Camera camera = start;
  Rigid3 pose = cam_from_world;
  for (int round = 0; round < kRounds; ++round) {
    const std::vector<WeightedMatch> matches =
        MatchesNear(problem, normalized.repeats, camera, pose, threshold_px);
    if (matches.empty()) break;
    Equations equations = Linearize(matches, camera, pose);
    const LensVector offset = OffsetOf(camera, assumed);
    equations.hessian.diagonal().tail<kLensSize>() += information;
    equations.gradient.tail<kLensSize>() += information.cwiseProduct(offset);
    AddPosePriors(normalized, pose, equations);
    const Eigen::LDLT<UnknownMatrix> factors(equations.hessian);
    UnknownVector step = -factors.solve(equations.gradient);
    if (!step.allFinite() || std::abs(step[6]) > 1) break;
    const Eigen::Matrix<double, kLensSize, kLensSize> of_lens =
        factors.solve(UnknownMatrix::Identity()).bottomRightCorner<kLensSize, kLensSize>();
    const Eigen::Matrix<double, 6, kLensSize> pose_by_lens =
        equations.hessian.topLeftCorner<6, 6>().ldlt().solve(
            Eigen::Matrix<double, 6, kLensSize>(-equations.hessian.topRightCorner<6, kLensSize>()));
    refined = {camera, pose_by_lens * of_lens * pose_by_lens.transpose()};
    step[6] =
        std::clamp(offset[kFocal] + step[6], -std::log(range), std::log(range)) - offset[kFocal];
    camera = Moved(camera, step.tail<kLensSize>());
    const Eigen::Quaterniond turn = RotationFromVector(step.head<3>());
    pose = Rigid3{turn, step.segment<3>(3)} * pose;
  }
  return refined;
}

}  // namespace raylift
