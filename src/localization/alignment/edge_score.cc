#include "localization/alignment/edge_score.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "geometry/pose_step.h"
#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

// The odds that a piece of an edge is shown, where nothing else is known.
constexpr double kEvenOdds = 0.5;

// Shares of edges that are shown, among which the likeliest one is looked for.
constexpr int kNumShares = 4;
using ShareScores = Eigen::Array<double, kNumShares, 1>;
constexpr size_t kNumKinds = 3;

ShareScores ScoresOf(const SceneEdge& edge, double evidence) {
  static const ShareScores kShares(0.05, 0.2, 0.5, 0.8);
  return edge.length_px * (1 + kShares * evidence).log();
}

size_t CellOf(const Camera& camera, const Eigen::Vector2d& pixel) {
  const auto part = [](double at, int size) {
    return std::clamp(static_cast<int>(at / size * kCellsPerSide), 0, kCellsPerSide - 1);
  };
  return static_cast<size_t>(part(pixel.y(), camera.height_px()) * kCellsPerSide +
                             part(pixel.x(), camera.width_px()));
}

// Adds the prior to the normal equations of the step (w, v).
void AddPrior(const PosePrior& prior, const Rigid3& pose, Matrix6d& normal, Vector6d& gradient) {
  const double sigma_rad = prior.sigma_deg * std::numbers::pi / 180;
  const double of_turn = 1 / (sigma_rad * sigma_rad);
  const Vector6d step = StepBetween(prior.cam_from_world, pose);
  const Eigen::Matrix3d rotation = pose.rotation.toRotationMatrix();
  const Eigen::Vector3d of_shift = prior.sigma_position.cwiseAbs2().cwiseInverse();
  const Eigen::Vector3d shift = pose.OriginInSource() - prior.cam_from_world.OriginInSource();
  normal.topLeftCorner<3, 3>().diagonal().array() += of_turn;
  normal.bottomRightCorner<3, 3>() += rotation * of_shift.asDiagonal() * rotation.transpose();
  gradient.head<3>() += of_turn * step.head<3>();
  gradient.tail<3>() -= rotation * of_shift.cwiseProduct(shift);
}

// The distance between an edge of the scene and one of the photograph.
struct Residual {
  double distance_px;
  Vector6d slope;  // d distance / d (w, v)
  double length_px;
  double chance_rate;
};

std::vector<Residual> ResidualsAt(const EdgeImage& image, std::span<const SceneEdge> edges,
                                  const Rigid3& pose, double reach_px) {
  std::vector<Residual> residuals;
  const EdgeViewer viewer(image.camera(), pose);
  for (const SceneEdge& edge : edges) {
    const auto seen = viewer.See(edge);
    if (!seen || !image.camera().Contains(seen->pixel)) continue;
    const auto near = image.NearestAlong(seen->pixel, seen->normal, reach_px);
    if (!near) continue;
    Residual residual;
    residual.distance_px = seen->normal.dot(seen->pixel - near->position_px.cast<double>());
    const Eigen::RowVector3d of_point = seen->normal.transpose() * seen->pixel_from_cam;
    residual.slope.head<3>() = (of_point * -Skew(seen->point_in_cam)).transpose();
    residual.slope.tail<3>() = of_point.transpose();
    residual.length_px = edge.length_px;
    residual.chance_rate = image.ChanceRate(seen->pixel, seen->normal);
    residuals.push_back(residual);
  }
  return residuals;
}

// Returns the probability that a distance is not by chance, among those that are found.
double Weight(const Residual& residual, double sigma_px) {
  const double z = residual.distance_px / sigma_px;
  const double density =
      std::exp(-0.5 * z * z) / (sigma_px * std::sqrt(2 * std::numbers::pi)) * kEvenOdds;
  return density / (density + (1 - kEvenOdds) * residual.chance_rate);
}

// Returns the standard deviation of those distances.
double SpreadOf(std::span<const Residual> residuals, double sigma_px) {
  double squares = 0;
  double weights = 0;
  for (const Residual& residual : residuals) {
    const double weight = residual.length_px * Weight(residual, sigma_px);
    squares += weight * residual.distance_px * residual.distance_px;
    weights += weight;
  }
  return weights > 0 ? std::sqrt(squares / weights) : sigma_px;
}

struct Equations {
  Matrix6d normal = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
};

// Returns the normal equations, in which each weighted piece counts by its length in units of a
// pixel.
Equations EquationsOf(std::span<const Residual> residuals, double sigma_px) {
  Equations equations;
  const double precision = 1 / (sigma_px * sigma_px);
  for (const Residual& residual : residuals) {
    const double weight = precision * residual.length_px * Weight(residual, sigma_px);
    equations.normal += weight * residual.slope * residual.slope.transpose();
    equations.gradient += weight * residual.distance_px * residual.slope;
  }
  return equations;
}

// Returns the covariance that independent pixels would give.
std::optional<Matrix6d> CovarianceOf(const Equations& equations, const PosePrior& prior,
                                     const Rigid3& pose) {
  Matrix6d normal = equations.normal;
  Vector6d unused = Vector6d::Zero();
  AddPrior(prior, pose, normal, unused);
  const Eigen::LDLT<Matrix6d> solver(normal);
  const Matrix6d covariance = solver.solve(Matrix6d::Identity());
  if (!covariance.allFinite() || !(covariance.diagonal().minCoeff() > 0)) return std::nullopt;
  return covariance;
}

}  // namespace

std::optional<SeenEdge> EdgeViewer::See(const SceneEdge& edge) const {
  SeenEdge seen;
  seen.point_in_cam = rotation_ * edge.point_in_world + translation_;
  const auto projected = camera_.ImgFromCamWithJacobian(seen.point_in_cam);
  if (!projected) return std::nullopt;
  const Eigen::Vector2d along = projected->jacobian * (rotation_ * edge.tangent_in_world);
  if (!(along.squaredNorm() > 0)) return std::nullopt;
  seen.pixel = projected->pixel;
  seen.normal = Eigen::Vector2d(-along.y(), along.x()).normalized();
  seen.pixel_from_cam = projected->jacobian;
  return seen;
}

double EdgeScore(const EdgeImage& image, std::span<const SceneEdge> edges,
                 const Rigid3& cam_from_world) {
  const EdgeViewer viewer(image.camera(), cam_from_world);
  std::array<ShareScores, kNumKinds> by_kind;
  by_kind.fill(ShareScores::Zero());
  for (const SceneEdge& edge : edges) {
    if (const auto seen = viewer.See(edge)) {
      by_kind[static_cast<size_t>(edge.kind)] +=
          ScoresOf(edge, image.Evidence(seen->pixel, seen->normal));
    }
  }
  double score = 0;
  for (const ShareScores& scores : by_kind) score += scores.maxCoeff();
  return score;
}

CellScores EdgeScoreByCell(const EdgeImage& image, std::span<const SceneEdge> edges,
                           const Rigid3& cam_from_world) {
  const EdgeViewer viewer(image.camera(), cam_from_world);
  using ScoresOfCells = Eigen::Array<double, kNumCells, kNumShares>;
  std::array<ScoresOfCells, kNumKinds> by_kind;
  by_kind.fill(ScoresOfCells::Zero());
  for (const SceneEdge& edge : edges) {
    const auto seen = viewer.See(edge);
    if (seen && image.camera().Contains(seen->pixel)) {
      by_kind[static_cast<size_t>(edge.kind)].row(
          static_cast<Eigen::Index>(CellOf(image.camera(), seen->pixel))) +=
          ScoresOf(edge, image.Evidence(seen->pixel, seen->normal)).transpose();
    }
  }
  CellScores scores = CellScores::Zero();
  for (const ScoresOfCells& of_kind : by_kind) {
    Eigen::Index likeliest = 0;
    of_kind.colwise().sum().maxCoeff(&likeliest);
    scores += of_kind.col(likeliest);
  }
  return scores;
}

double LogPrior(const PosePrior& prior, const Rigid3& cam_from_world) {
  const double turn =
      AngleBetweenDeg(prior.cam_from_world.rotation, cam_from_world.rotation) / prior.sigma_deg;
  const Eigen::Vector3d shift =
      (prior.cam_from_world.OriginInSource() - cam_from_world.OriginInSource())
          .cwiseQuotient(prior.sigma_position);
  return -0.5 * (turn * turn + shift.squaredNorm());
}

std::optional<EdgeFit> FitEdges(const EdgeImage& image, std::span<const SceneEdge> edges,
                                const PosePrior& prior, const Rigid3& start, double reach_px) {
  constexpr int kMaxIterations = 12;
  constexpr double kLeastSigmaPx = 0.3;  // rounding of the picture that the edges were seen in
  EdgeFit fit{.cam_from_world = start, .covariance = Matrix6d::Zero()};
  double sigma_px = std::max(kLeastSigmaPx, reach_px / 3);
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    const auto residuals = ResidualsAt(image, edges, fit.cam_from_world, reach_px);
    if (residuals.size() < 6) return std::nullopt;
    sigma_px = std::clamp(SpreadOf(residuals, sigma_px), kLeastSigmaPx, sigma_px);
    Equations equations = EquationsOf(residuals, sigma_px);
    AddPrior(prior, fit.cam_from_world, equations.normal, equations.gradient);
    equations.normal.diagonal() *= 1 + 1e-3;
    const Vector6d step = -equations.normal.ldlt().solve(equations.gradient);
    if (!step.allFinite()) return std::nullopt;
    fit.cam_from_world = Moved(fit.cam_from_world, step);
  }
  const auto residuals = ResidualsAt(image, edges, fit.cam_from_world, reach_px);
  const auto covariance = CovarianceOf(EquationsOf(residuals, sigma_px), prior, fit.cam_from_world);
  if (!covariance) return std::nullopt;
  fit.covariance = *covariance;
  return fit;
}

void AddCovarianceByResampling(const EdgeImage& image, std::span<const SceneEdge> edges,
                               const PosePrior& prior, double reach_px, Rng& rng, EdgeFit& fit) {
  constexpr int kReplicates = 24;
  constexpr int kBlocksPerSide = kCellsPerSide / 2;
  const EdgeViewer viewer(image.camera(), fit.cam_from_world);
  std::vector<size_t> blocks;
  for (const SceneEdge& edge : edges) {
    const auto seen = viewer.See(edge);
    const size_t cell = seen ? CellOf(image.camera(), seen->pixel) : 0;
    blocks.push_back(cell / (2 * kCellsPerSide) * kBlocksPerSide + cell % kCellsPerSide / 2);
  }
  Matrix6d scatter = Matrix6d::Zero();
  int count = 0;
  std::vector<SceneEdge> resampled(edges.begin(), edges.end());
  for (int i = 0; i < kReplicates; ++i) {
    std::array<double, kBlocksPerSide * kBlocksPerSide> weights;
    for (double& weight : weights) weight = -std::log(1 - rng.Uniform());
    for (size_t k = 0; k < edges.size(); ++k) {
      resampled[k].length_px = edges[k].length_px * weights[blocks[k]];
    }
    auto other = FitEdges(image, resampled, prior, fit.cam_from_world, 2 * reach_px);
    if (other) other = FitEdges(image, resampled, prior, other->cam_from_world, reach_px);
    if (!other) continue;
    const Vector6d step = StepBetween(fit.cam_from_world, other->cam_from_world);
    scatter += step * step.transpose();
    ++count;
  }
  // The inverse of a covariance of so few samples is too large by this (Hotelling).
  constexpr int kParameters = 6;
  if (count > kParameters + 1) fit.covariance += scatter / (count - kParameters - 1);
}

double ChanceOf(const CellScores& scores) {
  const double squares = scores.square().sum();
  if (!(squares > 0)) return 0.5;
  return 0.5 * std::erfc(scores.sum() / std::sqrt(2 * squares));
}

double LeastScore(const CellScores& cells) {
  return cells.sum() - 2 * std::sqrt(cells.square().sum());
}

double ChanceOfScore(double score, std::span<const double> by_chance, double times) {
  // The number of the best scores that tell how fast higher ones become rarer.
  constexpr size_t kMost = 10;
  if (by_chance.size() < 3) return 1;
  const size_t num_above = std::min(kMost, by_chance.size() - 1);
  const auto count = static_cast<double>(num_above);
  const double threshold = by_chance[num_above];
  double mean = 0;
  for (const double above : by_chance.first(num_above)) mean += (above - threshold) / count;
  if (!(mean > 0) || score < threshold) return 1;
  const auto is_as_good = [score](double other) { return other >= score; };
  const auto as_good =
      static_cast<double>(std::count_if(by_chance.begin(), by_chance.end(), is_as_good));
  const double expected = count * std::pow(1 + (score - threshold) / (count * mean), -count);
  return -std::expm1(-times * std::max(as_good, expected));
}

double LeastProbabilityOfChance(double p) {
  if (!(p < 1 / std::numbers::e)) return 1;
  if (!(p > 0)) return 0;
  const double odds = -std::numbers::e * p * std::log(p);
  return odds / (1 + odds);
}

}  // namespace raylift
