#include "exposure_levels.h"

#include <cmath>

#include "base/statistics.h"
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>

namespace raylift {
namespace {

constexpr int kRounds = 5;
// Of a photograph's factors, beside the many points that tell them: they are 1 where none does.
constexpr double kPrior = 1e-3;

using Levels = Eigen::MatrixX3d;  // of the logarithms, added

double TotalWeight(std::span<const PointColor> point) {
  double total = 0;
  for (const PointColor& color : point) total += color.weight;
  return total;
}

Eigen::RowVector3d Mean(std::span<const PointColor> point, const Levels& levels) {
  Eigen::RowVector3d sum = Eigen::RowVector3d::Zero();
  for (const PointColor& color : point) {
    sum += color.weight * (color.log_rgb.transpose() + levels.row(color.photograph));
  }
  return sum / TotalWeight(point);
}

// Sets each weight by how far the color is from the others of its point.
void Reweigh(std::span<const std::vector<PointColor>> points, const Levels& levels,
             std::vector<std::vector<PointColor>>& weighed) {
  std::vector<double> distances;
  for (const auto& point : weighed) {
    const Eigen::RowVector3d mean = Mean(point, levels);
    for (const PointColor& color : point) {
      distances.push_back((color.log_rgb.transpose() + levels.row(color.photograph) - mean).norm());
    }
  }
  std::vector<double> sorted = distances;
  const double usual = sorted.empty() ? 0 : UpperMedianInPlace(std::span(sorted));
  if (!(usual > 0)) return;
  size_t next = 0;
  for (size_t p = 0; p < points.size(); ++p) {
    for (size_t i = 0; i < points[p].size(); ++i) {
      const double ratio = distances[next++] / usual;
      weighed[p][i].weight = points[p][i].weight / (1 + ratio * ratio);
    }
  }
}

Levels Solve(size_t count, std::span<const std::vector<PointColor>> points) {
  const auto n = static_cast<Eigen::Index>(count);
  std::vector<Eigen::Triplet<double>> entries;
  for (Eigen::Index i = 0; i < n; ++i) entries.emplace_back(i, i, kPrior);
  Levels right = Levels::Zero(n, 3);
  const Levels none = Levels::Zero(n, 3);
  for (const auto& point : points) {
    const double total = TotalWeight(point);
    const Eigen::RowVector3d mean = Mean(point, none);
    for (const PointColor& a : point) {
      const auto row = static_cast<Eigen::Index>(a.photograph);
      entries.emplace_back(row, row, a.weight);
      for (const PointColor& b : point) {
        entries.emplace_back(row, static_cast<Eigen::Index>(b.photograph),
                             -a.weight * b.weight / total);
      }
      right.row(row) -= a.weight * (a.log_rgb.transpose() - mean);
    }
  }
  Eigen::SparseMatrix<double> normal(n, n);
  normal.setFromTriplets(entries.begin(), entries.end());
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factors(normal);
  Levels levels = factors.solve(right);
  return levels.allFinite() ? levels : none;
}

}  // namespace

std::vector<Eigen::Vector3d> LevelExposures(size_t num_photographs,
                                            std::span<const std::vector<PointColor>> points) {
  std::vector<std::vector<PointColor>> weighed(points.begin(), points.end());
  Levels levels = Levels::Zero(static_cast<Eigen::Index>(num_photographs), 3);
  for (int round = 0; round < kRounds; ++round) {
    levels = Solve(num_photographs, weighed);
    Reweigh(points, levels, weighed);
  }
  if (num_photographs > 0) levels.rowwise() -= levels.colwise().mean().eval();
  std::vector<Eigen::Vector3d> factors;
  factors.reserve(num_photographs);
  for (Eigen::Index i = 0; i < levels.rows(); ++i) {
    factors.emplace_back(levels.row(i).array().exp().transpose());
  }
  return factors;
}

}  // namespace raylift
