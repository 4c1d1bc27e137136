#include "raylift/renderers/pixel_rays.h"

#include <cmath>
#include <numbers>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr int kSide = static_cast<int>(RayBlock::kSide);

}  // namespace

PixelRays::PixelRays(const Camera& camera, int threads)
    : PixelRays(camera, camera.width_px(), camera.height_px(), threads) {}

PixelRays PixelRays::Equirectangular(int width_px, int height_px, int threads) {
  RAYLIFT_CHECK(width_px > 0 && height_px > 0);
  return PixelRays(std::nullopt, width_px, height_px, threads);
}

PixelRays::PixelRays(std::optional<Camera> camera, int width_px, int height_px, int threads)
    : camera_(std::move(camera)),
      width_px_(width_px),
      height_px_(height_px),
      blocks_per_row_((width_px + kSide - 1) / kSide) {
  const int block_rows = (height_px + kSide - 1) / kSide;
  blocks_.resize(static_cast<size_t>(blocks_per_row_) * static_cast<size_t>(block_rows));
  ParallelFor(static_cast<size_t>(block_rows), threads, [this](size_t row) {
    const int top = static_cast<int>(row) * kSide;
    for (int y = top; y < std::min(top + kSide, height_px_); ++y) {
      for (int x = 0; x < width_px_; ++x) {
        const auto ray = RayInCam(x, y);
        if (!ray) continue;
        RayBlock& block =
            blocks_[row * static_cast<size_t>(blocks_per_row_) + static_cast<size_t>(x / kSide)];
        const auto i = static_cast<size_t>(y % kSide * kSide + x % kSide);
        block.x[i] = static_cast<float>(ray->x());
        block.y[i] = static_cast<float>(ray->y());
        block.z[i] = static_cast<float>(ray->z());
      }
    }
  });
}

std::optional<Eigen::Vector3d> PixelRays::RayInCam(int x, int y) const {
  if (camera_) {
    return camera_->RayInCam({x + 0.5, y + 0.5});
  }
  const double azimuth = 2 * std::numbers::pi * ((x + 0.5) / width_px_ - 0.5);
  const double elevation = std::numbers::pi * (0.5 - (y + 0.5) / height_px_);
  return Eigen::Vector3d(std::cos(elevation) * std::sin(azimuth), -std::sin(elevation),
                         std::cos(elevation) * std::cos(azimuth));
}

}  // namespace raylift
