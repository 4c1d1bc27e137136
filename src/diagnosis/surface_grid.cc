#include "diagnosis/surface_grid.h"

#include <algorithm>

#include "base/statistics.h"

namespace raylift {

Eigen::Vector3d Quantile(std::span<const Eigen::Vector3d> points, double share) {
  Eigen::Vector3d quantile;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> values;
    for (const Eigen::Vector3d& point : points) values.push_back(point[axis]);
    quantile[axis] = QuantileInPlace(std::span(values), share);
  }
  return quantile;
}

SurfaceGrid::SurfaceGrid(std::span<const Eigen::Vector3d> points)
    : low_(Quantile(points, 0.005)), high_(Quantile(points, 0.995)) {
  cell_ = std::max((high_ - low_).maxCoeff() / kCells, 1e-12);
  for (int axis = 0; axis < 3; ++axis) {
    size_[axis] = static_cast<int>((high_[axis] - low_[axis]) / cell_) + 1 + 2 * kMargin;
  }
  near_.assign(static_cast<size_t>(size_.prod()), 0);
  inner_ = static_cast<size_t>((size_ - Eigen::Vector3i::Constant(2 * kMargin)).prod());
  for (const Eigen::Vector3d& point : points) Mark(CellOf(point));
}

bool SurfaceGrid::IsFull() const {
  const auto marked =
      near_.size() - static_cast<size_t>(std::count(near_.begin(), near_.end(), uint8_t{0}));
  return static_cast<double>(marked) > 0.9 * static_cast<double>(inner_);
}

void SurfaceGrid::Mark(const Eigen::Vector3i& center) {
  for (int i = 0; i < 27; ++i) {
    const Eigen::Vector3i c = center + Eigen::Vector3i(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1);
    if ((c.array() < 0).any() || (c.array() >= size_.array()).any()) continue;
    uint8_t& value = near_[IndexOf(c)];
    value = std::max<uint8_t>(value, i == 13 ? kOn : 3);
  }
}

std::vector<ScoredShift> BestShifts(const SurfaceGrid& grid,
                                    std::span<const Eigen::Vector3d> points, size_t count) {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& point : points) center += point / static_cast<double>(points.size());
  // Starts with the points' center at the lower corner of the mesh; then goes on by cells.
  const Eigen::Vector3d first = grid.low() - center;
  std::vector<Eigen::Vector3i> cells;
  for (const Eigen::Vector3d& point : points) cells.push_back(grid.CellOf(point + first));
  const Eigen::Vector3i steps =
      ((grid.high() - grid.low()) / grid.cell()).array().ceil().cast<int>();
  const auto few = std::max<size_t>(cells.size() / 4, 1);
  const int few_threshold = static_cast<int>(few) * SurfaceGrid::kOn * 2 / 5;
  std::vector<ScoredShift> best;
  const double apart = 2 * grid.cell();
  for (int z = 0; z <= steps.z(); ++z) {
    for (int y = 0; y <= steps.y(); ++y) {
      for (int x = 0; x <= steps.x(); ++x) {
        const Eigen::Vector3i step(x, y, z);
        int score = 0;
        for (size_t i = 0; i < few; ++i) score += grid.At(cells[i] + step);
        if (score < few_threshold) continue;
        for (size_t i = few; i < cells.size(); ++i) score += grid.At(cells[i] + step);
        if (best.size() == count && score <= best.back().score) continue;
        const ScoredShift found{first + grid.cell() * step.cast<double>(), score};
        const auto near = std::find_if(best.begin(), best.end(), [&](const ScoredShift& other) {
          return (other.shift - found.shift).norm() < apart;
        });
        if (near != best.end()) {
          if (near->score >= score) continue;
          *near = found;
        } else {
          if (best.size() == count) best.pop_back();
          best.push_back(found);
        }
        std::stable_sort(best.begin(), best.end(), [](const ScoredShift& a, const ScoredShift& b) {
          return a.score > b.score;
        });
      }
    }
  }
  return best;
}

}  // namespace raylift
