// How a scene's input is read: what the numbers of the depth maps and of the poses are taken to
// mean. The doctor compares readings, and says by which options one is chosen.

#pragma once

#include <optional>
#include <string>
#include <vector>

#include "raylift/geometry/rigid3.h"
#include "raylift/lifting/depth_convention.h"

namespace raylift {

struct InputReading {
  DepthKind kind = DepthKind::kZ;
  MapOrientation orientation = MapOrientation::kAsStored;
  double first_sample_px = 0.5;  // see DepthSamplingOptions
  double scale = 1;              // see DepthConvention
  PoseConvention poses = PoseConvention::kCamFromWorld;

  bool operator==(const InputReading&) const = default;
};

// The orientation that has the effect of both; none where it has no name.
std::optional<MapOrientation> Combined(MapOrientation a, MapOrientation b);

// In how many respects two readings differ.
int NumDifferences(const InputReading& a, const InputReading& b);

// What differs from `as_read`, in words ("ray length, not z; depth x 0.001").
std::string DescribeDifference(const InputReading& as_read, const InputReading& other);

// The options that change `as_read` into the other: keys of --geometry depth:..., options of the
// program.
struct RepairOptions {
  std::vector<std::string> geometry_keys;  // "kind=ray"
  std::vector<std::string> options;        // "--model-poses opengl"
  // Keys of --geometry that it has and the others stand in place of, or nothing does.
  std::vector<std::string> replaced_keys = {};
};
RepairOptions FindRepair(const InputReading& as_read, const InputReading& other);

// "in --geometry: kind=ray,scale=0.001; --model-poses opengl"
std::string ToString(const RepairOptions& repair);

}  // namespace raylift
