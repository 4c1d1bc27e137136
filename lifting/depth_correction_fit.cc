#include "lifting/depth_correction_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "base/statistics.h"
#include <ceres/ceres.h>

#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

constexpr int kGridColumns = 5;
constexpr int kGridRows = 4;

// The residual is the vector from a keypoint's match to its projection, as a function of a map's
// log factors and, if there is one more parameter, its shift.
class ProjectedDepthCost final : public ceres::CostFunction {
 public:
  ProjectedDepthCost(const DepthObservation& observation, const std::array<GridWeight, 4>& weights,
                     size_t num_nodes, bool has_shift)
      : observation_(observation), weights_(weights), num_nodes_(num_nodes), has_shift_(has_shift) {
    set_num_residuals(2);
    mutable_parameter_block_sizes()->push_back(static_cast<int>(num_nodes + (has_shift ? 1 : 0)));
  }

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    double log_factor = 0;
    for (const auto& [node, weight] : weights_) log_factor += weight * parameters[0][node];
    const double scaled_z = observation_.z * std::exp(log_factor);
    const double z = scaled_z + (has_shift_ ? parameters[0][num_nodes_] : 0);
    const auto projection =
        observation_.other_camera->ImgFromCamWithJacobian(observation_.line_in_other.At(z));
    if (!projection) return false;
    Eigen::Map<Eigen::Vector2d> error(residuals);
    error = projection->pixel - observation_.other_px;
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      const Eigen::Vector2d along = projection->jacobian * observation_.line_in_other.direction;
      Eigen::Map<Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor>> jacobian(
          jacobians[0], 2, parameter_block_sizes()[0]);
      jacobian.setZero();
      for (const auto& [node, weight] : weights_) {
        jacobian.col(static_cast<Eigen::Index>(node)) += weight * scaled_z * along;
      }
      if (has_shift_) jacobian.rightCols(1) = along;
    }
    return true;
  }

 private:
  DepthObservation observation_;
  std::array<GridWeight, 4> weights_;
  size_t num_nodes_;
  bool has_shift_;
};

// A weighted sum of parameters that should be near a value.
class LinearPrior final : public ceres::CostFunction {
 public:
  LinearPrior(std::vector<GridWeight> terms, double sigma, int num_parameters, double value = 0)
      : terms_(std::move(terms)), sigma_(sigma), value_(value) {
    set_num_residuals(1);
    mutable_parameter_block_sizes()->push_back(num_parameters);
  }

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    residuals[0] = -value_ / sigma_;
    for (const auto& [index, weight] : terms_) {
      residuals[0] += weight * parameters[0][index] / sigma_;
    }
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      std::fill_n(jacobians[0], parameter_block_sizes()[0], 0.0);
      for (const auto& [index, weight] : terms_) jacobians[0][index] += weight / sigma_;
    }
    return true;
  }

 private:
  std::vector<GridWeight> terms_;
  double sigma_;
  double value_;
};

// Ties neighboring nodes to each other, as monocular depth drifts by a few percent over a fifth of
// the image: where there are no matches, they follow each other.
void AddSmoothness(const DepthCorrection& correction, double* parameters, ceres::Problem& problem) {
  constexpr double kSigma = 0.05;
  const auto columns = static_cast<size_t>(correction.columns);
  const auto rows = static_cast<size_t>(correction.rows);
  const int size = static_cast<int>(correction.log_factors.size());
  const auto add = [&](size_t a, size_t b) {
    problem.AddResidualBlock(new LinearPrior({{a, 1.0}, {b, -1.0}}, kSigma, size), nullptr,
                             parameters);
  };
  for (size_t y = 0; y < rows; ++y) {
    for (size_t x = 0; x < columns; ++x) {
      const size_t node = y * columns + x;
      if (x + 1 < columns) add(node, node + 1);
      if (y + 1 < rows) add(node, node + columns);
    }
  }
}

// Adds what is known of a map's factor before the fit. Cauchy's loss of width c,
//   c^2 / 2 ln(1 + d^2 / c^2),
// is c^2 / 3 times the negative logarithm of Cauchy's density in the plane, (1 + d^2 / c^2)^(-3/2):
// so much does a square of sigmas weigh. A shift s is a factor 1 + s / z of the depth z, which is
// `depth` here.
void AddKnownFactor(const KnownFactor& known, size_t num_nodes, double depth,
                    std::vector<double>& parameters, ceres::Problem& problem) {
  std::vector<GridWeight> factor;
  for (size_t i = 0; i < num_nodes; ++i) {
    factor.push_back({i, 1.0 / static_cast<double>(num_nodes)});
  }
  if (parameters.size() > num_nodes) factor.push_back({num_nodes, 1 / depth});
  const double weight = kLossWidthPx * std::sqrt(known.repeats / 3);
  problem.AddResidualBlock(new LinearPrior(std::move(factor), known.sigma / weight,
                                           static_cast<int>(parameters.size()), known.log_factor),
                           nullptr, parameters.data());
}

}  // namespace

std::vector<DepthObservation> ObserveDepth(const GeometrySource& source,
                                           std::span<const PosedImage> references,
                                           const PosedImage& map,
                                           const std::vector<HalfMatch>& matches,
                                           double max_epipolar_px) {
  std::vector<Eigen::Vector2d> pixels;
  pixels.reserve(matches.size());
  for (const HalfMatch& match : matches) pixels.push_back(match.pixel);
  const auto points = source.Lift(map, pixels);
  std::vector<DepthObservation> observations;
  for (size_t i = 0; i < matches.size(); ++i) {
    if (!points[i]) continue;
    const HalfMatch& match = matches[i];
    const PosedImage& other = references[static_cast<size_t>(match.other)];
    const auto line = LineInOther(map, match.pixel, other);
    const auto epipolar = SampsonError(map.camera, map.cam_from_world, match.pixel, other.camera,
                                       other.cam_from_world, match.other_px);
    if (!line || !epipolar || std::abs(epipolar->error_px) > max_epipolar_px) continue;
    observations.push_back({.pixel = match.pixel,
                            .z = points[i]->depth_z,
                            .other = match.other,
                            .epipolar_px = std::abs(epipolar->error_px),
                            .line_in_other = *line,
                            .other_camera = &other.camera,
                            .other_px = match.other_px});
  }
  return observations;
}

DepthCorrection FitCorrection(const std::vector<DepthObservation>& observations,
                              const Camera& camera, double log_factor,
                              const std::optional<KnownFactor>& known, AlignMode mode) {
  DepthCorrection correction;
  if (mode == AlignMode::kGrid) {
    correction.columns = kGridColumns;
    correction.rows = kGridRows;
  }
  const size_t num_nodes =
      static_cast<size_t>(correction.columns) * static_cast<size_t>(correction.rows);
  const bool has_shift = mode == AlignMode::kAffine;
  correction.log_factors.assign(num_nodes, log_factor);

  std::vector<double> parameters(num_nodes + (has_shift ? 1 : 0), 0);
  std::fill_n(parameters.begin(), num_nodes, log_factor);
  const DepthCorrection start = correction;
  ceres::Problem problem;
  std::vector<double> depths;
  for (const DepthObservation& o : observations) {
    const double z = start.Correct(o.z, camera, o.pixel);
    if (!o.other_camera->ImgFromCam(o.line_in_other.At(z))) continue;
    depths.push_back(z);
    problem.AddResidualBlock(
        new ProjectedDepthCost(o, GridWeights(correction.columns, correction.rows, camera, o.pixel),
                               num_nodes, has_shift),
        new ceres::CauchyLoss(kLossWidthPx), parameters.data());
  }
  if (depths.empty()) return correction;
  if (num_nodes > 1) AddSmoothness(correction, parameters.data(), problem);
  if (known) {
    AddKnownFactor(*known, num_nodes, UpperMedianOr(depths, 0), parameters, problem);
  }
  if (has_shift) {
    // Factor and shift are told apart by the range of depths alone; without one, no shift.
    constexpr double kShareOfDepth = 0.3;
    problem.AddResidualBlock(
        new LinearPrior({{num_nodes, 1.0}}, kShareOfDepth * UpperMedianOr(depths, 0),
                        static_cast<int>(parameters.size())),
        nullptr, parameters.data());
  }
  ceres::Solver::Options solver_options;
  solver_options.linear_solver_type = ceres::DENSE_QR;
  solver_options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver_options, &problem, &summary);
  if (summary.IsSolutionUsable()) {
    std::copy_n(parameters.begin(), num_nodes, correction.log_factors.begin());
    if (has_shift) correction.shift = parameters[num_nodes];
  }
  return correction;
}

}  // namespace raylift
