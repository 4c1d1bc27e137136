#include "mapping/distance_grid.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include <openvdb/openvdb.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

using Eigen::Vector3d;
using Tree = openvdb::FloatTree;
using Leaf = Tree::LeafNodeType;
using Coord = openvdb::Coord;

constexpr int kSide = Leaf::DIM;
constexpr size_t kBlocksPerItem = 64;
// The memory of a block: distances and weights.
constexpr size_t kBlockBytes = 2 * (sizeof(Leaf) + Leaf::SIZE * sizeof(float));
// The farthest behind a slanted surface, along the ray, that a view still measures, in truncations.
constexpr double kMostReach = 1.5;
// The largest difference, in voxels, between neighboring points of a surface: they differ by no
// more than their distance, and noise; where they differ by more, the surface that was seen ends.
constexpr float kMostStep = 2.5F;

// Lists the blocks along the rays of a view.
class BlockList {
 public:
  BlockList(const ViewPlanes& seen, const DistanceGridOptions& options)
      : seen_(seen), options_(options), world_from_cam_(seen.view.cam_from_world.Inverse()) {
    const int width = seen.view.camera.width_px();
    for (size_t i = 0; i < seen.planes.size() && !IsFull(); ++i) {
      if (seen.planes[i].weight == 0) continue;
      const auto pixel = static_cast<int>(i);
      AddAlong({pixel % width + 0.5, pixel / width + 0.5}, seen.planes[i]);
    }
    LeaveOutDuplicates();
  }

  // Returns the blocks in order; not all of them where they are more than there may be.
  const std::vector<Coord>& blocks() const { return blocks_; }

 private:
  bool IsFull() const { return num_different_ > options_.max_bytes / kBlockBytes; }

  void LeaveOutDuplicates() {
    std::sort(blocks_.begin(), blocks_.end());
    blocks_.erase(std::unique(blocks_.begin(), blocks_.end()), blocks_.end());
    num_different_ = blocks_.size();
  }

  void AddAlong(const Eigen::Vector2d& pixel, const PixelPlane& plane) {
    const Camera& camera = seen_.view.camera;
    const auto ray = camera.RayInCam(pixel);
    if (!ray) return;
    const double ray_t = plane.depth / camera.DepthOf(*ray);
    const double cosine = std::abs(plane.normal_in_cam.cast<double>().dot(*ray));
    const double reach = options_.truncation / std::max(cosine, 1 / kMostReach);
    const Vector3d direction = world_from_cam_.rotation * *ray;
    const Vector3d origin = world_from_cam_.translation - options_.origin_in_world;
    const int steps =
        std::max(1, static_cast<int>(std::ceil(reach / (kSide / 4 * options_.voxel))));
    for (int step = -steps; step <= steps; ++step) {
      const Vector3d at = origin + (ray_t + reach * step / steps) * direction;
      AddBlock(at / (kSide * options_.voxel));
    }
  }

  void AddBlock(const Vector3d& place) {
    if (!(place.cwiseAbs().maxCoeff() < std::numeric_limits<int>::max() / kSide - 1)) return;
    const Vector3d corner = place.array().floor();
    const Coord block(static_cast<int>(corner.x()) * kSide, static_cast<int>(corner.y()) * kSide,
                      static_cast<int>(corner.z()) * kSide);
    if (!blocks_.empty() && blocks_.back() == block) return;
    blocks_.push_back(block);
    constexpr size_t kLeast = 4096;
    if (blocks_.size() > 2 * std::max(num_different_, kLeast)) LeaveOutDuplicates();
  }

  const ViewPlanes& seen_;
  const DistanceGridOptions& options_;
  Rigid3 world_from_cam_;
  std::vector<Coord> blocks_;
  size_t num_different_ = 0;  // of those before duplicates were left out last
};

// Computes the distances of the grid's points from a view's surface, in voxels.
class ViewDistances {
 public:
  ViewDistances(const ViewPlanes& seen, const DistanceGridOptions& options)
      : seen_(seen),
        camera_(seen.view.camera),
        voxel_(options.voxel),
        truncation_(static_cast<float>(options.truncation / options.voxel)),
        most_depth_behind_(kMostReach * options.truncation) {
    const Eigen::Matrix3d rotation = seen.view.cam_from_world.rotation.toRotationMatrix();
    steps_ = voxel_ * rotation;
    grid_origin_in_cam_ = seen.view.cam_from_world * options.origin_in_world;
  }

  // Adds to the sums of a block whose first point is `corner`.
  void AddTo(const Coord& corner, float* distance_sums, float* weights) const {
    const Vector3d first = InCam(corner);
    if (IsOutside(first + steps_ * Vector3d::Constant(0.5 * (kSide - 1)))) return;
    size_t i = 0;
    for (int x = 0; x < kSide; ++x) {
      for (int y = 0; y < kSide; ++y) {
        for (int z = 0; z < kSide; ++z, ++i) {
          AddPoint(first + steps_ * Vector3d(x, y, z), distance_sums[i], weights[i]);
        }
      }
    }
  }

 private:
  Vector3d InCam(const Coord& corner) const {
    return grid_origin_in_cam_ + steps_ * Vector3d(corner.x(), corner.y(), corner.z());
  }

  // Returns whether a block about this point cannot be seen.
  bool IsOutside(const Vector3d& center) const {
    const double radius = 0.87 * kSide * voxel_;
    const double depth = camera_.DepthOf(center);
    if (depth - radius > seen_.max_depth + most_depth_behind_ || depth + radius <= 0) return true;
    if (depth < 2 * radius) return false;
    const auto pixel = camera_.ImgFromCam(center);
    if (!pixel || camera_.is_panorama()) return false;
    // Twice as far as it may reach, as lenses stretch what is off their axes.
    const double margin = 2 * radius / (depth - radius) * camera_.MeanFocalPx();
    return pixel->x() < -margin || pixel->x() > camera_.width_px() + margin ||
           pixel->y() < -margin || pixel->y() > camera_.height_px() + margin;
  }

  void AddPoint(const Vector3d& point, float& distance_sum, float& weight_sum) const {
    const auto pixel = camera_.ImgFromCam(point);
    if (!pixel || !(pixel->x() >= 0 && pixel->x() < camera_.width_px() && pixel->y() >= 0 &&
                    pixel->y() < camera_.height_px())) {
      return;
    }
    const auto x = static_cast<int>(pixel->x()), y = static_cast<int>(pixel->y());
    const PixelPlane& plane = seen_.planes[static_cast<size_t>(y) * camera_.width_px() + x];
    if (plane.weight == 0) return;
    const float distance =
        (plane.normal_in_cam.dot(point.cast<float>()) - plane.offset) / static_cast<float>(voxel_);
    if (distance < -truncation_ ||
        camera_.DepthOf(point) > static_cast<double>(plane.depth) + most_depth_behind_) {
      return;
    }
    // The farther behind the surface, the less is known of what is there.
    const float weight =
        distance >= -1 ? plane.weight : plane.weight * (truncation_ + distance) / (truncation_ - 1);
    distance_sum += weight * std::min(distance, truncation_);
    weight_sum += weight;
  }

  const ViewPlanes& seen_;
  const Camera& camera_;
  double voxel_;
  float truncation_;
  double most_depth_behind_;
  Eigen::Matrix3d steps_;  // from point to point along the grid's axes, in the camera's frame
  Vector3d grid_origin_in_cam_;
};

// The point in which the surface crosses an edge of the grid, between two points that were seen.
struct Crossing {
  Coord from;
  int axis;     // along which the edge goes on
  float share;  // of the edge
  bool is_free_before;
};

// Adds the crossings of the edges that begin at a point.
template <typename Accessor>
void AddCrossings(const Coord& at, float distance, const Accessor& distances,
                  const Accessor& weights, std::vector<Crossing>& crossings) {
  for (int axis = 0; axis < 3; ++axis) {
    Coord next = at;
    next[axis] += 1;
    const float other = distances.getValue(next);
    const bool crosses = (distance < 0) != (other < 0) && std::abs(other - distance) <= kMostStep;
    if (!crosses || !(weights.getValue(next) > 0)) continue;
    // Not at its very ends, where the vertices of several cells would be one.
    const float share = std::clamp(distance / (distance - other), 0.02F, 0.98F);
    crossings.push_back({at, axis, share, distance >= 0});
  }
}

// Extracts the surface: a vertex in each cell that the surface crosses, at the mean of its
// crossings of the cell's edges, and two triangles around each of these edges, as Gibson's surface
// nets (1998).
class SurfaceNet {
 public:
  explicit SurfaceNet(const DistanceGridOptions& options)
      : options_(options), index_of_cell_(-1), cells_(index_of_cell_) {}

  void Add(const Crossing& crossing) {
    Vector3d point(crossing.from.x(), crossing.from.y(), crossing.from.z());
    point[crossing.axis] += static_cast<double>(crossing.share);
    std::array<uint32_t, 4> around{};
    // Counterclockwise, as seen from where the edge ends.
    constexpr std::array<std::array<int, 2>, 4> kBefore = {{{0, 0}, {1, 0}, {1, 1}, {0, 1}}};
    for (size_t i = 0; i < around.size(); ++i) {
      Coord cell = crossing.from;
      cell[(crossing.axis + 1) % 3] -= kBefore[i][0];
      cell[(crossing.axis + 2) % 3] -= kBefore[i][1];
      around[i] = VertexOf(cell);
      sums_[around[i]] += point;
      ++counts_[around[i]];
    }
    if (crossing.is_free_before) std::swap(around[1], around[3]);
    quads_.push_back(around);
  }

  // Returns the surface; of each quad the shorter diagonal is an edge.
  ZeroSurface ToSurface() const {
    ZeroSurface surface;
    surface.vertices.reserve(sums_.size());
    for (size_t i = 0; i < sums_.size(); ++i) {
      surface.vertices.emplace_back(options_.origin_in_world +
                                    options_.voxel / counts_[i] * sums_[i]);
    }
    surface.triangles.reserve(2 * quads_.size());
    for (const auto& q : quads_) {
      const auto length = [&](size_t a, size_t b) {
        return (surface.vertices[q[a]] - surface.vertices[q[b]]).squaredNorm();
      };
      const size_t first = length(0, 2) <= length(1, 3) ? 0 : 1;
      surface.triangles.push_back({q[first], q[first + 1], q[first + 2]});
      surface.triangles.push_back({q[first], q[first + 2], q[(first + 3) % 4]});
    }
    return surface;
  }

 private:
  uint32_t VertexOf(const Coord& cell) {
    const int known = cells_.getValue(cell);
    if (known >= 0) return static_cast<uint32_t>(known);
    cells_.setValue(cell, static_cast<int>(sums_.size()));
    sums_.emplace_back(Vector3d::Zero());
    counts_.push_back(0);
    return static_cast<uint32_t>(sums_.size() - 1);
  }

  const DistanceGridOptions& options_;
  openvdb::Int32Tree index_of_cell_;
  openvdb::tree::ValueAccessor<openvdb::Int32Tree> cells_;
  std::vector<Vector3d> sums_;  // in voxels
  std::vector<int> counts_;
  std::vector<std::array<uint32_t, 4>> quads_;
};

}  // namespace

bool CanFuse() { return true; }

struct DistanceGrid::Impl {
  explicit Impl(const DistanceGridOptions& all_options)
      : options(all_options),
        distances(static_cast<float>(options.truncation / options.voxel)),
        weights(0.0F) {}

  // Lists the blocks of both trees, in their order.
  void ListBlocks() {
    if (!blocks.empty()) return;
    std::vector<Leaf*> of_weights;
    distances.getNodes(blocks);
    weights.getNodes(of_weights);
    RAYLIFT_CHECK_EQ(blocks.size(), of_weights.size());
    weight_blocks = std::move(of_weights);
  }

  template <typename Body>
  void ForBlocks(const Body& body) {
    ListBlocks();
    ParallelForParts(blocks.size(), kBlocksPerItem, options.threads, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) body(i);
    });
  }

  // Makes distances of the sums.
  void Divide() {
    ForBlocks([this](size_t block) {
      float* sums = blocks[block]->buffer().data();
      const float* by = weight_blocks[block]->buffer().data();
      for (size_t i = 0; i < Leaf::SIZE; ++i) {
        sums[i] = by[i] > 0 ? sums[i] / by[i] : distances.background();
      }
    });
  }

  // Returns the crossings of each block, in the order of the blocks.
  std::vector<std::vector<Crossing>> Crossings() {
    std::vector<std::vector<Crossing>> crossings(blocks.size());
    ForBlocks([&](size_t block) {
      const openvdb::tree::ValueAccessor<const Tree> distance(distances), weight(weights);
      const float* seen = weight_blocks[block]->buffer().data();
      for (openvdb::Index i = 0; i < Leaf::SIZE; ++i) {
        if (!(seen[i] > 0)) continue;
        AddCrossings(blocks[block]->offsetToGlobalCoord(i), blocks[block]->getValue(i), distance,
                     weight, crossings[block]);
      }
    });
    return crossings;
  }

  DistanceGridOptions options;
  Tree distances;  // at first sums of distances times weights, in voxels
  Tree weights;
  size_t num_blocks = 0;
  std::vector<Leaf*> blocks, weight_blocks;
};

DistanceGrid::DistanceGrid(const DistanceGridOptions& options)
    : impl_(std::make_unique<Impl>(options)) {}

DistanceGrid::~DistanceGrid() = default;

void DistanceGrid::MakeBlocks(std::span<const ViewPlanes> views) {
  RAYLIFT_CHECK(impl_->blocks.empty());
  std::vector<std::optional<BlockList>> lists(views.size());
  ParallelFor(views.size(), impl_->options.threads,
              [&](size_t i) { lists[i].emplace(views[i], impl_->options); });
  for (const auto& list : lists) {
    for (const Coord& corner : list->blocks()) {
      if (impl_->distances.probeLeaf(corner) != nullptr) continue;
      for (Tree* tree : {&impl_->distances, &impl_->weights}) {
        Leaf* leaf = tree->touchLeaf(corner);
        leaf->fill(0.0F, true);
      }
      ++impl_->num_blocks;
      if (MemoryBytes() > impl_->options.max_bytes) return;
    }
  }
}

void DistanceGrid::Add(const ViewPlanes& view) {
  const ViewDistances said(view, impl_->options);
  impl_->ForBlocks([&](size_t i) {
    said.AddTo(impl_->blocks[i]->origin(), impl_->blocks[i]->buffer().data(),
               impl_->weight_blocks[i]->buffer().data());
  });
}

ZeroSurface DistanceGrid::Surface() {
  impl_->Divide();
  SurfaceNet net(impl_->options);
  for (const auto& of_block : impl_->Crossings()) {
    for (const Crossing& crossing : of_block) net.Add(crossing);
  }
  return net.ToSurface();
}

size_t DistanceGrid::MemoryBytes() const { return impl_->num_blocks * kBlockBytes; }

}  // namespace raylift
