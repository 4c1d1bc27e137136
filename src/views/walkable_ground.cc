#include "walkable_ground.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <span>

#include "base/index_sets.h"
#include "base/statistics.h"
#include <Eigen/Geometry>

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr int kMaxCells = 256;        // along a side
constexpr double kOutliers = 0.002;   // share of the vertices beyond each side of the grid
constexpr double kMinUpCosine = 0.8;  // slopes to 37 degrees
constexpr int kMaxLayers = 32;        // floors above each other
constexpr double kNextLayer = 1e-4;   // of the height, to pass a surface

// The world turned so that z is up, and the part of it that the grid covers.
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

struct Place {
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

// The heights of upward faces with room above, from the top down.
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

std::vector<Place> FindPlaces(const RayCaster& mesh, const Grid& grid, double headroom,
                              const ViewSamplerOptions& options) {
  std::vector<std::vector<double>> heights(static_cast<size_t>(grid.columns * grid.rows));
  ParallelFor(static_cast<size_t>(grid.rows), options.threads, [&](size_t row) {
    for (int x = 0; x < grid.columns; ++x) {
      const int cell = static_cast<int>(row) * grid.columns + x;
      heights[static_cast<size_t>(cell)] =
          GroundHeights(mesh, grid, cell, headroom, options.any_side);
    }
  });
  std::vector<Place> places;
  for (size_t cell = 0; cell < heights.size(); ++cell) {
    for (const double height : heights[cell]) places.push_back({static_cast<int>(cell), height});
  }
  return places;
}

// The members of the largest set of places that follow each other without a high step. `places`
// are in the order of their cells.
std::vector<Place> LargestArea(const std::vector<Place>& places, const Grid& grid,
                               double max_step) {
  DisjointSets sets(places.size());
  const auto of_cell = [&places](int cell) {
    return std::equal_range(places.begin(), places.end(), Place{cell, 0},
                            [](const Place& a, const Place& b) { return a.cell < b.cell; });
  };
  for (size_t i = 0; i < places.size(); ++i) {
    const int cell = places[i].cell;
    for (const int next : {(cell + 1) % grid.columns == 0 ? -1 : cell + 1, cell + grid.columns}) {
      const auto [first, last] = of_cell(next);
      for (auto other = first; other != last; ++other) {
        if (std::abs(other->height - places[i].height) <= max_step) {
          sets.Join(i, static_cast<size_t>(other - places.begin()));
        }
      }
    }
  }
  const std::vector<int> numbers = sets.Numbers();
  std::map<int, int> sizes;
  for (const int number : numbers) ++sizes[number];
  const auto largest = std::max_element(
      sizes.begin(), sizes.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  std::vector<Place> area;
  for (size_t i = 0; i < places.size(); ++i) {
    if (numbers[i] == largest->first) area.push_back(places[i]);
  }
  return area;
}

}  // namespace

std::vector<Eigen::Vector3d> FindWalkableGround(const RayCaster& mesh,
                                                const ViewSamplerOptions& options,
                                                const InsideOptions& inside) {
  const Grid grid =
      MakeGrid(mesh.mesh(), options.up_in_world.normalized(), 0.5 * options.clearance);
  const std::vector<Place> places =
      FindPlaces(mesh, grid, inside.eye_height + options.clearance, options);
  std::vector<Eigen::Vector3d> points;
  if (places.empty()) return points;
  for (const Place& place : LargestArea(places, grid, inside.max_step)) {
    const Eigen::Vector3d top = grid.TopOf(place.cell);
    points.push_back(grid.world_from_level * Eigen::Vector3d(top.x(), top.y(), place.height));
  }
  return points;
}

}  // namespace raylift
