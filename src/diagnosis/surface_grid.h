// Shifts that bring points near to a surface, by counting in a grid: where a scene model may lie.

#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Core>

namespace raylift {

// Returns the quantile of the points' coordinates, along each axis by itself.
Eigen::Vector3d Quantile(std::span<const Eigen::Vector3d> points, double share);

// A grid of the cells of space on a surface or beside it.
class SurfaceGrid {
 public:
  explicit SurfaceGrid(std::span<const Eigen::Vector3d> points);

  double cell() const { return cell_; }
  const Eigen::Vector3d& low() const { return low_; }
  const Eigen::Vector3d& high() const { return high_; }
  // Returns whether all points lie near the surface wherever it is shifted to. A box-shaped room's
  // walls take half of the cells.
  bool IsFull() const;

  Eigen::Vector3i CellOf(const Eigen::Vector3d& point) const {
    constexpr double kFar = 1e6;
    return ((point - low_) / cell_).array().floor().max(-kFar).min(kFar).cast<int>() + kMargin;
  }
  // Returns kOn on the surface, 3 beside it, 0 elsewhere.
  int At(const Eigen::Vector3i& c) const {
    if ((c.array() < 0).any() || (c.array() >= size_.array()).any()) return 0;
    return near_[IndexOf(c)];
  }

  static constexpr int kOn = 5;

 private:
  static constexpr int kCells = 40;
  static constexpr int kMargin = 2;

  size_t IndexOf(const Eigen::Vector3i& c) const {
    return static_cast<size_t>((c.z() * size_.y() + c.y()) * size_.x() + c.x());
  }
  void Mark(const Eigen::Vector3i& center);

  Eigen::Vector3d low_, high_;
  double cell_ = 1;
  Eigen::Vector3i size_;
  std::vector<uint8_t> near_;
  size_t inner_ = 0;  // cells without the margin
};

// A shift of the points, and the sum of the grid at all of them.
struct ScoredShift {
  Eigen::Vector3d shift;
  int score;
};

// Returns the shifts with the best scores, at most `count` and each two cells apart, best first.
std::vector<ScoredShift> BestShifts(const SurfaceGrid& grid,
                                    std::span<const Eigen::Vector3d> points, size_t count);

}  // namespace raylift
