// The maps of a frame that is being rendered, filled in blocks of 4 x 4 pixels.

#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "base/constants.h"
#include "renderers/block_kernels.h"

#include "raylift/renderers/frame_renderer.h"

namespace raylift {

inline constexpr int kBlockSide = static_cast<int>(RayBlock::kSide);

inline Eigen::Vector3f Lane(const RayBlock& rays, size_t i) {
  return {rays.x[i], rays.y[i], rays.z[i]};
}

// The part of a block that lies in the picture.
struct BlockArea {
  int x0, y0;  // the first pixel
  int width, height;

  // Calls body(lane, x, y) for each pixel.
  template <typename Body>
  void ForEachPixel(const Body& body) const {
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) body(static_cast<size_t>(y * kBlockSide + x), x0 + x, y0 + y);
    }
  }
};

class FrameMaps {
 public:
  // All arguments must outlive the maps.
  FrameMaps(const FrameOptions& options, const PixelRays& rays, const Rigid3& cam_from_world,
            Frame& frame)
      : options_(options),
        rays_(rays),
        center_in_world_(cam_from_world.OriginInSource()),
        world_from_cam_(cam_from_world.rotation.conjugate().toRotationMatrix()),
        frame_(frame) {
    frame_.points_origin.setZero();
    if (options.points_from_center && !InCamera()) frame_.points_origin = center_in_world_;
  }

  BlockArea AreaAt(int x0, int y0) const {
    return {x0, y0, std::min(kBlockSide, rays_.width_px() - x0),
            std::min(kBlockSide, rays_.height_px() - y0)};
  }

  // Fills the maps that need the hits alone.
  void StoreHits(const BlockArea& area, const RayBlock& rays_in_world, const HitBlock& hits) const {
    alignas(64) Values depth_storage;
    alignas(64) Values distance_storage;
    const float* const depth = Depths(area, hits, depth_storage);
    const float* const distance = Distances(area, hits, distance_storage);
    if (options_.depth) Store(depth, area, frame_.depth);
    if (options_.distance) Store(distance, area, frame_.distance);
    if (options_.points) StorePoints(area, rays_in_world, hits);
    if (options_.triangle) Store(hits.triangle.data(), area, frame_.triangle);
    if (options_.mask) {
      std::array<uint8_t, RayBlock::kSize> mask;
      std::transform(hits.triangle.begin(), hits.triangle.end(), mask.begin(), [](uint32_t id) {
        return id != HitBlock::kNoTriangle ? uint8_t{255} : uint8_t{0};
      });
      Store(mask.data(), area, frame_.mask.data);
    }
  }

  // Fills normals and incidence of a hit of a ray along `direction`.
  void StoreNormal(int x, int y, const RayHit& hit, const Eigen::Vector3d& direction) const {
    const size_t pixel = PixelIndex(x, y);
    const double along = hit.normal_in_world.dot(direction);
    if (options_.normals) {
      Eigen::Vector3d normal = along > 0 ? -hit.normal_in_world : hit.normal_in_world;
      if (InCamera()) normal = world_from_cam_.transpose() * normal;
      Eigen::Map<Eigen::Vector3f>(&frame_.normals[3 * pixel]) = normal.cast<float>();
    }
    if (options_.incidence) {
      const double sine = hit.normal_in_world.cross(direction).norm();
      frame_.incidence_deg[pixel] =
          static_cast<float>(std::atan2(sine, std::abs(along)) * kDegPerRad);
    }
  }

  void StoreNoNormal(int x, int y) const {
    const size_t pixel = PixelIndex(x, y);
    if (options_.normals) std::fill_n(&frame_.normals[3 * pixel], 3, 0.0f);
    if (options_.incidence) frame_.incidence_deg[pixel] = -1;
  }

  void StoreColor(int x, int y, const Eigen::Vector3f& rgb) const {
    const size_t pixel = PixelIndex(x, y);
    for (int c = 0; c < 3; ++c) {
      frame_.color.data[3 * pixel + static_cast<size_t>(c)] = NearestByte(rgb[c]);
    }
  }

  const Eigen::Vector3d& center_in_world() const { return center_in_world_; }
  const Eigen::Matrix3d& world_from_cam() const { return world_from_cam_; }

 private:
  using Values = std::array<float, RayBlock::kSize>;

  // Returns the depths. A pinhole's rays have z = 1, so that their ray_t is the depth. A panorama's
  // depth is the distance.
  const float* Depths(const BlockArea& area, const HitBlock& hits, Values& storage) const {
    if (!options_.depth || rays_.is_pinhole() || rays_.is_panorama()) return hits.ray_t.data();
    DepthOfBlock(hits, rays_.Block(area.x0 / kBlockSide, area.y0 / kBlockSide), storage.data());
    return storage.data();
  }

  const float* Distances(const BlockArea& area, const HitBlock& hits, Values& storage) const {
    if (!options_.distance || !rays_.is_pinhole()) return hits.ray_t.data();
    DistanceOfBlock(hits, rays_.ColumnSlopes(area.x0 / kBlockSide),
                    rays_.RowSlopes(area.y0 / kBlockSide), storage.data());
    return storage.data();
  }

  template <typename T>
  void Store(const T* values, const BlockArea& area, std::vector<T>& map) const {
    T* row = &map[PixelIndex(area.x0, area.y0)];
    const auto stride = static_cast<size_t>(rays_.width_px());
    if (area.width == kBlockSide && area.height == kBlockSide) {  // counts that the compiler knows
      for (int y = 0; y < kBlockSide; ++y)
        std::copy_n(values + y * kBlockSide, kBlockSide, row + static_cast<size_t>(y) * stride);
      return;
    }
    for (int y = 0; y < area.height; ++y)
      std::copy_n(values + y * kBlockSide, area.width, row + static_cast<size_t>(y) * stride);
  }

  void StorePoints(const BlockArea& area, const RayBlock& rays_in_world,
                   const HitBlock& hits) const {
    area.ForEachPixel([&](size_t i, int x, int y) {
      Eigen::Map<Eigen::Vector3f> point(&frame_.points[3 * PixelIndex(x, y)]);
      if (hits.triangle[i] == HitBlock::kNoTriangle) {
        point.setConstant(std::numeric_limits<float>::quiet_NaN());
        return;
      }
      const Eigen::Vector3d ray = Lane(rays_in_world, i).cast<double>() * double{hits.ray_t[i]};
      point = (InCamera() ? Eigen::Vector3d(world_from_cam_.transpose() * ray)
                          : Eigen::Vector3d(center_in_world_ - frame_.points_origin + ray))
                  .cast<float>();
    });
  }

  bool InCamera() const { return options_.normals_in == FrameOptions::NormalsIn::kCamera; }

  size_t PixelIndex(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(rays_.width_px()) + static_cast<size_t>(x);
  }

  const FrameOptions& options_;
  const PixelRays& rays_;
  Eigen::Vector3d center_in_world_;
  Eigen::Matrix3d world_from_cam_;
  Frame& frame_;
};

}  // namespace raylift
