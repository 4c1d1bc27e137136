#include "views/space_probe.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>

#include "base/index_sets.h"
#include "base/statistics.h"
#include "lifting/source_view.h"
#include <Eigen/Geometry>

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr int kGridColumns = 24;  // rays through a picture
constexpr int kGridRows = 18;

constexpr int kMaxCells = 256;        // along a side
constexpr double kOutliers = 0.002;   // share of the vertices beyond each side of the grid
constexpr double kMinUpCosine = 0.8;  // slopes to 37 degrees
constexpr int kMaxLayers = 32;        // floors above each other
constexpr double kNextLayer = 1e-4;   // of the height, to pass a surface

// The grid: the world rotated so that z is up, and the part of it that the grid covers.
struct Grid {
  Eigen::Quaterniond world_from_level;
  Eigen::Vector3d low, high;  // in level coordinates
  double cell = 0;
  int columns = 0;
  int rows = 0;

  Eigen::Vector3d TopOf(int index) const {
    const int column = index % columns;
    const int row = index / columns;
    return {low.x() + (column + 0.5) * cell, low.y() + (row + 0.5) * cell, high.z()};
  }
};

struct GroundCell {
  int cell;
  double height;  // level z
};

Grid MakeGrid(const TriangleMesh& mesh, const Eigen::Vector3d& up, double min_cell) {
  Grid grid;
  grid.world_from_level = Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), up);
  const Eigen::Quaterniond level_from_world = grid.world_from_level.conjugate();
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> values;
    values.reserve(mesh.vertices.size());
    for (uint32_t i = 0; i < mesh.vertices.size(); ++i) {
      values.push_back((level_from_world * mesh.VertexInWorld(i))[axis]);
    }
    grid.low[axis] = QuantileInPlace(std::span(values), axis == 2 ? 0 : kOutliers);
    grid.high[axis] = QuantileInPlace(std::span(values), axis == 2 ? 1 : 1 - kOutliers);
  }
  const Eigen::Vector3d extent = grid.high - grid.low;
  grid.high.z() += 1e-3 * (extent.norm() + 1e-9);
  grid.cell = std::max({extent.x() / kMaxCells, extent.y() / kMaxCells, min_cell});
  grid.columns = std::max(1, static_cast<int>(extent.x() / grid.cell));
  grid.rows = std::max(1, static_cast<int>(extent.y() / grid.cell));
  return grid;
}

// Returns the heights of upward faces with room above, from the top down.
std::vector<double> GroundHeights(const RayCaster& mesh, const Grid& grid, int cell,
                                  double headroom, bool any_side) {
  const Eigen::Vector3d down = grid.world_from_level * Eigen::Vector3d(0, 0, -1);
  const Eigen::Vector3d top = grid.world_from_level * grid.TopOf(cell);
  const double range = grid.high.z() - grid.low.z();
  std::vector<double> heights;
  double ceiling = -std::numeric_limits<double>::infinity();  // ray_t of the surface above
  Ray ray{top, down};
  for (int layer = 0; layer < kMaxLayers; ++layer) {
    const auto hit = mesh.Cast(std::span(&ray, 1)).front();
    if (!hit) break;
    const double cosine = -hit->normal_in_world.dot(down);
    const bool is_up = any_side ? std::abs(cosine) > kMinUpCosine : cosine > kMinUpCosine;
    if (is_up && hit->ray_t - ceiling > headroom) heights.push_back(grid.high.z() - hit->ray_t);
    ceiling = hit->ray_t;
    ray.ray_t_near = hit->ray_t + kNextLayer * range;
  }
  return heights;
}

std::vector<GroundCell> FindGroundCells(const RayCaster& mesh, const Grid& grid, double headroom,
                                        const ViewSamplerOptions& options) {
  std::vector<std::vector<double>> heights(static_cast<size_t>(grid.columns * grid.rows));
  ParallelFor(static_cast<size_t>(grid.rows), options.threads, [&](size_t row) {
    for (int x = 0; x < grid.columns; ++x) {
      const int cell = static_cast<int>(row) * grid.columns + x;
      heights[static_cast<size_t>(cell)] =
          GroundHeights(mesh, grid, cell, headroom, options.any_side);
    }
  });
  std::vector<GroundCell> cells;
  for (size_t cell = 0; cell < heights.size(); ++cell) {
    for (const double height : heights[cell]) cells.push_back({static_cast<int>(cell), height});
  }
  return cells;
}

// Calls visit(i, other, is_diagonal) for each cell and each of the eight around it that one can
// step to. `cells` are in the order of the grid.
template <typename Visit>
void ForEachStep(const std::vector<GroundCell>& cells, const Grid& grid, double max_step,
                 const Visit& visit) {
  for (size_t i = 0; i < cells.size(); ++i) {
    for (int k = 0; k < 9; ++k) {
      const int right = k % 3 - 1;
      const int column = cells[i].cell % grid.columns + right;
      if (k == 4 || column < 0 || column >= grid.columns) continue;
      const int cell = cells[i].cell + (k / 3 - 1) * grid.columns + right;
      const auto [first, last] = std::equal_range(
          cells.begin(), cells.end(), GroundCell{cell, 0},
          [](const GroundCell& a, const GroundCell& b) { return a.cell < b.cell; });
      for (auto other = first; other != last; ++other) {
        if (std::abs(other->height - cells[i].height) > max_step) continue;
        visit(i, static_cast<size_t>(other - cells.begin()), k % 2 == 0);
      }
    }
  }
}

// Returns whether each cell belongs to the largest set of cells that follow each other, side by
// side, without a high step.
std::vector<bool> InLargestArea(const std::vector<GroundCell>& cells, const Grid& grid,
                                double max_step) {
  DisjointSets sets(cells.size());
  ForEachStep(cells, grid, max_step, [&sets](size_t i, size_t other, bool is_diagonal) {
    if (!is_diagonal) sets.Join(i, other);
  });
  return sets.InLargest();
}

// Returns evenly spread unit vectors (a spiral of Fibonacci).
std::vector<Eigen::Vector3d> SpreadDirections(int count) {
  const double golden_angle = std::numbers::pi * (3 - std::sqrt(5.0));
  std::vector<Eigen::Vector3d> directions;
  for (int i = 0; i < count; ++i) {
    const double z = 1 - (2 * i + 1.0) / count;
    const double radius = std::sqrt(1 - z * z);
    directions.emplace_back(radius * std::cos(golden_angle * i),
                            radius * std::sin(golden_angle * i), z);
  }
  return directions;
}

}  // namespace

Surroundings ProbeSurroundings(const RayCaster& mesh, const Eigen::Vector3d& center,
                               int directions) {
  const std::vector<Eigen::Vector3d> all = SpreadDirections(directions);
  std::vector<Ray> rays;
  rays.reserve(all.size());
  for (const Eigen::Vector3d& direction : all) rays.push_back({center, direction});
  const auto hits = mesh.Cast(rays);
  Surroundings around{std::numeric_limits<double>::infinity(), 1};
  int seen = 0;
  int front = 0;
  for (size_t i = 0; i < hits.size(); ++i) {
    if (!hits[i]) continue;
    ++seen;
    front += hits[i]->normal_in_world.dot(all[i]) < 0 ? 1 : 0;
    around.clearance = std::min(around.clearance, hits[i]->ray_t);
  }
  if (seen > 0) around.front_share = static_cast<double>(front) / seen;
  return around;
}

VisibleSurface MeasureView(const RayCaster& mesh, const Camera& camera,
                           const Rigid3& cam_from_world) {
  const Eigen::Vector3d center = cam_from_world.OriginInSource();
  std::vector<Ray> rays;
  for (const Eigen::Vector2d& pixel : PixelGrid(camera, kGridColumns, kGridRows)) {
    const auto ray = camera.RayInCam(pixel);
    if (ray) rays.push_back({center, cam_from_world.rotation.conjugate() * *ray});
  }
  if (rays.empty()) return {};
  const auto hits = mesh.Cast(rays);
  std::vector<double> ranges;
  int front = 0;
  for (size_t i = 0; i < hits.size(); ++i) {
    if (!hits[i]) continue;
    ranges.push_back(hits[i]->ray_t);
    front += hits[i]->normal_in_world.dot(rays[i].direction_in_world) < 0 ? 1 : 0;
  }
  if (ranges.empty()) return {};
  const auto seen = static_cast<double>(ranges.size());
  return {seen / static_cast<double>(rays.size()), front / seen,
          UpperMedianInPlace(std::span(ranges))};
}

bool IsClear(const RayCaster& mesh, const Eigen::Vector3d& center,
             const ViewSamplerOptions& options, int directions) {
  const Surroundings around = ProbeSurroundings(mesh, center, directions);
  return around.clearance >= options.clearance &&
         (options.any_side || around.front_share >= kMinFrontShare);
}

std::vector<EyePlace> FindEyePlaces(const RayCaster& mesh, const ViewSamplerOptions& options,
                                    const InsideOptions& inside) {
  const Eigen::Vector3d up = options.up_in_world.normalized();
  const Grid grid = MakeGrid(mesh.mesh(), up, 0.5 * options.clearance);
  const std::vector<GroundCell> cells =
      FindGroundCells(mesh, grid, inside.eye_height + options.clearance, options);
  if (cells.empty()) return {};
  const std::vector<bool> is_in_area = InLargestArea(cells, grid, inside.max_step);
  std::vector<Eigen::Vector3d> centers(cells.size());
  std::vector<char> is_place(cells.size());
  ParallelFor(cells.size(), options.threads, [&](size_t i) {
    if (!is_in_area[i]) return;
    const Eigen::Vector3d top = grid.TopOf(cells[i].cell);
    centers[i] = grid.world_from_level * Eigen::Vector3d(top.x(), top.y(), cells[i].height) +
                 inside.eye_height * up;
    is_place[i] = IsClear(mesh, centers[i], options, kFewDirections);
  });
  std::vector<size_t> place_of_cell(cells.size());
  std::vector<EyePlace> places;
  for (size_t i = 0; i < cells.size(); ++i) {
    place_of_cell[i] = places.size();
    if (is_place[i] != 0) places.push_back({centers[i], {}});
  }
  ForEachStep(cells, grid, inside.max_step, [&](size_t i, size_t other, bool /*is_diagonal*/) {
    if (is_place[i] == 0 || is_place[other] == 0) return;
    places[place_of_cell[i]].neighbors.push_back(place_of_cell[other]);
  });
  return places;
}

std::vector<size_t> FarthestFirst(const std::vector<Eigen::Vector3d>& points, size_t count,
                                  Rng& rng) {
  std::vector<size_t> order;
  std::vector<double> distance2(points.size(), std::numeric_limits<double>::infinity());
  size_t next = rng.UniformIndex(static_cast<uint32_t>(points.size()));
  while (order.size() < std::min(count, points.size())) {
    order.push_back(next);
    distance2[next] = -1;
    for (size_t i = 0; i < points.size(); ++i) {
      distance2[i] = std::min(distance2[i], (points[i] - points[order.back()]).squaredNorm());
    }
    next = static_cast<size_t>(std::max_element(distance2.begin(), distance2.end()) -
                               distance2.begin());
  }
  return order;
}

}  // namespace raylift
