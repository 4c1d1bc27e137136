// A sparse grid of truncated signed distances, in blocks of 8 x 8 x 8 points, on OpenVDB.

#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "mapping/view_planes.h"
#include <Eigen/Core>

namespace raylift {

struct DistanceGridOptions {
  double voxel = 0;
  double truncation = 0;
  // The origin of the grid's coordinates, near the scene.
  Eigen::Vector3d origin_in_world = Eigen::Vector3d::Zero();
  int threads = 0;
  // No more blocks are made once one exceeds this.
  size_t max_bytes = std::numeric_limits<size_t>::max();
};

// Vertices in the world, and triangles that look at the side of positive distances.
struct ZeroSurface {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<std::array<uint32_t, 3>> triangles;
};

class DistanceGrid {
 public:
  explicit DistanceGrid(const DistanceGridOptions& options);
  ~DistanceGrid();

  // Makes the blocks about what these views see. All views are to be here before any is added.
  void MakeBlocks(std::span<const ViewPlanes> views);
  // Adds what a view says of all blocks.
  void Add(const ViewPlanes& view);
  // Returns the surface on which the distances are zero between points that were seen. The grid
  // cannot be used afterwards.
  ZeroSurface Surface();

  size_t MemoryBytes() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace raylift
