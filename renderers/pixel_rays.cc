#include "raylift/renderers/pixel_rays.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr int kSide = static_cast<int>(RayBlock::kSide);

// Returns the index of a pixel in its block.
size_t LaneOf(int x, int y) {
  return static_cast<size_t>(y % kSide) * RayBlock::kSide + static_cast<size_t>(x % kSide);
}

bool IsPinhole(CameraModel model) {
  return model == CameraModel::kSimplePinhole || model == CameraModel::kPinhole;
}

float Slope(int pixel, int size_px, double center_px, double focal_px) {
  return pixel < size_px ? static_cast<float>((pixel + 0.5 - center_px) / focal_px)
                         : std::numeric_limits<float>::quiet_NaN();
}

Eigen::Vector3f Change(const Eigen::Vector3f& here, const Eigen::Vector3f& before,
                       const Eigen::Vector3f& after) {
  if (!before.isZero() && !after.isZero()) return 0.5f * (after - before);
  if (!after.isZero()) return after - here;
  if (!before.isZero()) return here - before;
  return Eigen::Vector3f::Zero();
}

}  // namespace

PixelRays::PixelRays(const Camera& camera, int threads)
    : camera_(camera), blocks_per_row_((camera.width_px() + kSide - 1) / kSide) {
  if (IsPinhole(camera.model())) {
    MakeSlopes();
  } else {
    MakeBlocks(threads);
  }
}

int PixelRays::NumBlockRows() const { return (height_px() + kSide - 1) / kSide; }

void PixelRays::MakeSlopes() {
  const Eigen::Vector2d center = camera_.principal_point_px();
  column_slopes_.resize(static_cast<size_t>(blocks_per_row_));
  row_slopes_.resize(static_cast<size_t>(NumBlockRows()));
  for (int lane = 0; lane < kSide * kSide; ++lane) {
    const auto i = static_cast<size_t>(lane);
    for (int bx = 0; bx < blocks_per_row_; ++bx) {
      column_slopes_[static_cast<size_t>(bx)][i] =
          Slope(bx * kSide + lane % kSide, width_px(), center.x(), camera_.focal_x_px());
    }
    for (int by = 0; by < NumBlockRows(); ++by) {
      row_slopes_[static_cast<size_t>(by)][i] =
          Slope(by * kSide + lane / kSide, height_px(), center.y(), camera_.focal_y_px());
    }
  }
}

void PixelRays::MakeBlocks(int threads) {
  const int block_rows = NumBlockRows();
  blocks_.resize(static_cast<size_t>(blocks_per_row_) * static_cast<size_t>(block_rows));
  ParallelFor(static_cast<size_t>(block_rows), threads, [this](size_t row) {
    const int top = static_cast<int>(row) * kSide;
    for (int y = top; y < std::min(top + kSide, height_px()); ++y) {
      for (int x = 0; x < width_px(); ++x) {
        const auto ray = RayInCam(x, y);
        if (!ray) continue;
        RayBlock& block =
            blocks_[row * static_cast<size_t>(blocks_per_row_) + static_cast<size_t>(x / kSide)];
        const size_t i = LaneOf(x, y);
        block.x[i] = static_cast<float>(ray->x());
        block.y[i] = static_cast<float>(ray->y());
        block.z[i] = static_cast<float>(ray->z());
      }
    }
  });
}

std::optional<Eigen::Vector3d> PixelRays::RayInCam(int x, int y) const {
  if (!is_panorama()) return camera_.RayInCam({x + 0.5, y + 0.5});
  const double azimuth = 2 * std::numbers::pi * ((x + 0.5) / width_px() - 0.5);
  const double elevation = std::numbers::pi * (0.5 - (y + 0.5) / height_px());
  return Eigen::Vector3d(std::cos(elevation) * std::sin(azimuth), -std::sin(elevation),
                         std::cos(elevation) * std::cos(azimuth));
}

Eigen::Vector3f PixelRays::UnitRay(int x, int y) const {
  if (x < 0 || y < 0 || x >= width_px() || y >= height_px()) return Eigen::Vector3f::Zero();
  const size_t i = LaneOf(x, y);
  if (is_pinhole()) {
    return Eigen::Vector3f(ColumnSlopes(x / kSide)[i], RowSlopes(y / kSide)[i], 1).normalized();
  }
  const RayBlock& block = Block(x / kSide, y / kSide);
  return {block.x[i], block.y[i], block.z[i]};
}

PixelRays::Differential PixelRays::DifferentialAt(int x, int y) const {
  const Eigen::Vector3f center = UnitRay(x, y);
  if (is_pinhole()) {
    // The derivative of (slope x, slope y, 1) over its length, which is 1 / center.z.
    const auto moved = [&](int axis, double focal_px) -> Eigen::Vector3f {
      return center.z() / static_cast<float>(focal_px) *
             (Eigen::Vector3f::Unit(axis) - center[axis] * center);
    };
    return {moved(0, camera_.focal_x_px()), moved(1, camera_.focal_y_px())};
  }
  return {Change(center, UnitRay(x - 1, y), UnitRay(x + 1, y)),
          Change(center, UnitRay(x, y - 1), UnitRay(x, y + 1))};
}

}  // namespace raylift
