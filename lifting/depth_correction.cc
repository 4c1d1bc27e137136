// A map's corrected depth.

#include <algorithm>
#include <cmath>
#include <utility>

#include "raylift/base/error.h"
#include "raylift/lifting/depth_alignment.h"

namespace raylift {
namespace {

// The cell and the place in it, of a coordinate in [0, extent] over nodes from end to end.
struct GridCoordinate {
  int cell;
  double fraction;
};

GridCoordinate LocateOnGrid(double coordinate, double extent, int nodes) {
  const double position = std::clamp(coordinate / extent, 0.0, 1.0) * (nodes - 1);
  const int cell = std::clamp(static_cast<int>(position), 0, std::max(nodes - 2, 0));
  return {cell, position - cell};
}

}  // namespace

std::array<GridWeight, 4> GridWeights(int columns, int rows, const Camera& camera,
                                      const Eigen::Vector2d& pixel) {
  const GridCoordinate x = LocateOnGrid(pixel.x(), camera.width_px(), columns);
  const GridCoordinate y = LocateOnGrid(pixel.y(), camera.height_px(), rows);
  const auto node = [&](int dx, int dy) {
    const int column = std::min(x.cell + dx, columns - 1);
    const int row = std::min(y.cell + dy, rows - 1);
    return static_cast<size_t>(row) * static_cast<size_t>(columns) + static_cast<size_t>(column);
  };
  return {{{node(0, 0), (1 - x.fraction) * (1 - y.fraction)},
           {node(1, 0), x.fraction * (1 - y.fraction)},
           {node(0, 1), (1 - x.fraction) * y.fraction},
           {node(1, 1), x.fraction * y.fraction}}};
}

double DepthCorrection::Correct(double z, const Camera& camera,
                                const Eigen::Vector2d& pixel) const {
  double log_factor = 0;
  for (const auto& [node, weight] : GridWeights(columns, rows, camera, pixel)) {
    log_factor += weight * log_factors[node];
  }
  return z * std::exp(log_factor) + shift;
}

AlignedSource::AlignedSource(std::shared_ptr<const GeometrySource> source,
                             std::map<std::string, DepthCorrection> correction_of_reference)
    : source_(std::move(source)), corrections_(std::move(correction_of_reference)) {
  RAYLIFT_CHECK(source_ != nullptr);
}

std::string AlignedSource::Description() const { return source_->Description() + ", aligned"; }

std::vector<std::optional<SurfacePoint>> AlignedSource::Lift(
    const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const {
  auto points = source_->Lift(reference, pixels);
  const auto correction = corrections_.find(reference.name);
  if (correction == corrections_.end()) return points;
  const Eigen::Vector3d center_in_world = reference.cam_from_world.OriginInSource();
  for (size_t i = 0; i < points.size(); ++i) {
    if (!points[i]) continue;
    SurfacePoint& point = *points[i];
    const double z = correction->second.Correct(point.depth_z, reference.camera, pixels[i]);
    if (!(z > 0)) {
      points[i].reset();
      continue;
    }
    const double factor = z / point.depth_z;
    point.point_in_world = center_in_world + factor * (point.point_in_world - center_in_world);
    point.depth_z = z;
  }
  return points;
}

}  // namespace raylift
