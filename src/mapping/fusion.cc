#include "raylift/mapping/fusion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>

#include "base/index_sets.h"
#include "lifting/source_view.h"
#include "mapping/distance_grid.h"
#include "mapping/fields.h"
#include "mapping/view_planes.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

using Eigen::Vector3d;

// Surfaces are finer than the grid where they are smooth.
constexpr double kVoxelPixels = 2;
constexpr double kTruncationVoxels = 4;
constexpr double kTruncationSigmas = 3;
constexpr double kLeastTruncationVoxels = 2, kMostTruncationVoxels = 50;

double VoxelOf(const FusionOptions& options, const ViewScale& scale) {
  return options.voxel.value_or(std::max(kVoxelPixels * scale.pixel_width, scale.noise));
}

double TruncationOf(const FusionOptions& options, const ViewScale& scale, double voxel) {
  if (!options.truncation) {
    return std::clamp(kTruncationSigmas * scale.noise, kTruncationVoxels * voxel,
                      kMostTruncationVoxels * voxel);
  }
  const double truncation = *options.truncation;
  if (!(truncation >= kLeastTruncationVoxels * voxel &&
        truncation <= kMostTruncationVoxels * voxel)) {
    throw OptionError("truncation", fmt::format("{}", truncation),
                      fmt::format("must be {} to {} voxels of {:.3g}", kLeastTruncationVoxels,
                                  kMostTruncationVoxels, voxel));
  }
  return truncation;
}

// Returns an origin near the scene, on whole voxels of a grid about the world's origin, so that one
// more view does not move the grid's points elsewhere.
Vector3d OriginOf(std::span<const PosedImage> views, double voxel) {
  Vector3d mean = Vector3d::Zero();
  for (const PosedImage& view : views) mean += view.cam_from_world.OriginInSource();
  return (mean / (static_cast<double>(views.size()) * voxel)).array().round() * voxel;
}

// Takes the views in batches, each in parallel, as only a batch's pixels are in memory.
template <typename Take>
void ForBatches(const GeometrySource& source, std::span<const PosedImage> views,
                const ViewScale& scale, double voxel, const FusionOptions& options,
                const Take& take) {
  const auto batch = static_cast<size_t>(ResolveThreads(options.threads));
  for (size_t begin = 0; begin < views.size(); begin += batch) {
    std::vector<ViewPlanes> seen(std::min(batch, views.size() - begin));
    ParallelFor(seen.size(), options.threads, [&](size_t i) {
      seen[i] = LookForPlanes(source, views[begin + i], scale, voxel);
      if (options.on_view) options.on_view();
    });
    take(seen);
  }
}

void RequireRoom(const DistanceGrid& grid, double voxel, const FusionOptions& options) {
  if (grid.MemoryBytes() <= options.max_bytes) return;
  throw OptionError("voxel", fmt::format("{:.3g}", voxel),
                    fmt::format("the grid would take more than {:.1f} GB; {:.3g} takes a quarter",
                                static_cast<double>(options.max_bytes) / 1e9, 2 * voxel));
}

double AreaOf(const ZeroSurface& surface, const std::array<uint32_t, 3>& triangle) {
  const Vector3d& corner = surface.vertices[triangle[0]];
  return 0.5 * (surface.vertices[triangle[1]] - corner)
                   .cross(surface.vertices[triangle[2]] - corner)
                   .norm();
}

// Leaves out the triangles of connected pieces that are smaller than that.
void DropSmallPieces(double least_area, ZeroSurface& surface) {
  DisjointSets pieces(surface.vertices.size());
  for (const auto& [a, b, c] : surface.triangles) {
    pieces.Join(b, a);
    pieces.Join(c, a);
  }
  const std::vector<int> piece_of = pieces.Numbers();
  std::vector<double> areas(surface.vertices.size(), 0);
  const auto area_of = [&](const auto& triangle) -> double& {
    return areas[static_cast<size_t>(piece_of[triangle[0]])];
  };
  for (const auto& triangle : surface.triangles) area_of(triangle) += AreaOf(surface, triangle);
  std::erase_if(surface.triangles,
                [&](const auto& triangle) { return area_of(triangle) < least_area; });
}

}  // namespace

std::vector<Field> FieldsOf(FusionOptions& options) {
  return {
      {"voxel", options.voxel,
       "Distance between points of the grid, scene units (default: two pixels on\n"
       "the surface, or what the views disagree by where that is more)",
       kPositive},
      {"truncation", options.truncation,
       "Distances from the surface are cut off there, scene units (default: 4\n"
       "voxels, or 3 times what the views disagree by)",
       kPositive},
      {"min_piece", options.min_piece_voxels,
       "Leave out pieces of less surface than a square of so many voxels' side", kAtLeastZero},
  };
}

void RequireFusion() {
  if (CanFuse()) return;
  throw OptionError(
      "fusing needs OpenVDB 9, without which this program was built; on Debian 12 and "
      "Ubuntu 24.04 or later install libopenvdb-dev and libboost-dev, and build it again");
}

std::vector<PosedImage> ViewsToFuse(const NamedGeometry& geometry,
                                    std::span<const PosedImage> references, int max_side_px) {
  std::vector<PosedImage> views;
  for (const PosedImage& reference : references) {
    if (geometry.maps == nullptr) {
      views.push_back(ShrunkTo(reference, max_side_px));
    } else if (geometry.maps->convention().fit != MapFit::kWhole) {
      views.push_back(reference);  // which part it is goes by the image's size
    } else {
      const PlaneSize size = geometry.maps->size_px();
      views.push_back({reference.name, reference.camera.Scaled(size.width_px, size.height_px),
                       reference.cam_from_world});
    }
  }
  return views;
}

FusedMesh FuseViews(const GeometrySource& source, std::span<const PosedImage> views,
                    const FusionOptions& options) {
  RequireFusion();
  CheckRanges(ConstFieldsOf(options));
  FusedMesh fused;
  fused.scale = MeasureScale(source, views, options.threads);
  if (fused.scale.pixel_width == 0) {
    throw InputError(
        fmt::format("{}: none of the {} views sees a surface", source.Description(), views.size()));
  }
  fused.voxel = VoxelOf(options, fused.scale);
  fused.truncation = TruncationOf(options, fused.scale, fused.voxel);
  DistanceGrid grid({.voxel = fused.voxel,
                     .truncation = fused.truncation,
                     .origin_in_world = OriginOf(views, fused.voxel),
                     .threads = options.threads,
                     .max_bytes = options.max_bytes});
  const auto for_batches = [&](const auto& take) {
    ForBatches(source, views, fused.scale, fused.voxel, options, take);
  };
  for_batches([&](const std::vector<ViewPlanes>& seen) {
    grid.MakeBlocks(seen);
    RequireRoom(grid, fused.voxel, options);
  });
  for_batches([&](const std::vector<ViewPlanes>& seen) {
    for (const ViewPlanes& view : seen) grid.Add(view);
  });
  fused.grid_bytes = grid.MemoryBytes();
  ZeroSurface surface = grid.Surface();
  const double least_side = options.min_piece_voxels * fused.voxel;
  DropSmallPieces(least_side * least_side, surface);
  if (surface.triangles.empty()) {
    throw InputError(fmt::format("{}: the views leave no surface with a voxel of {:.3g}",
                                 source.Description(), fused.voxel));
  }
  fused.mesh = MakeMesh(std::move(surface.vertices), std::move(surface.triangles));
  return fused;
}

}  // namespace raylift
