#include "raylift/lifting/input_reading.h"

#include <algorithm>

#include <fmt/format.h>

namespace raylift {
namespace {

// The factor of depth that a change of scale means.
double DepthFactor(const InputReading& as_read, const InputReading& other) {
  return other.kind == DepthKind::kInverse ? as_read.scale / other.scale
                                           : other.scale / as_read.scale;
}

}  // namespace

std::optional<MapOrientation> Combined(MapOrientation a, MapOrientation b) {
  using enum MapOrientation;
  if (a == kAsStored) return b;
  if (b == kAsStored) return a;
  if (a == b) return kAsStored;
  if (a == kTransposed || b == kTransposed) return std::nullopt;
  // Of the two flips and the half turn, any two make the third.
  for (const MapOrientation third : {kFlippedX, kFlippedY}) {
    if (a != third && b != third) return third;
  }
  return kHalfTurn;
}

int NumDifferences(const InputReading& a, const InputReading& b) {
  return (a.kind != b.kind ? 1 : 0) + (a.orientation != b.orientation ? 1 : 0) +
         (a.first_sample_px != b.first_sample_px ? 1 : 0) + (a.scale != b.scale ? 1 : 0) +
         (a.poses != b.poses ? 1 : 0);
}

std::string DescribeDifference(const InputReading& as_read, const InputReading& other) {
  std::vector<std::string> parts;
  if (other.kind != as_read.kind) {
    parts.push_back(fmt::format("depth is {}, not {}", TitleOf(other.kind), TitleOf(as_read.kind)));
  }
  if (other.orientation != as_read.orientation) {
    const auto relative = Combined(as_read.orientation, other.orientation);
    parts.push_back(fmt::format("maps are {}", TitleOf(relative.value_or(other.orientation))));
  }
  if (other.first_sample_px != as_read.first_sample_px) {
    parts.push_back(fmt::format("maps are shifted by {:+} px",
                                other.first_sample_px - as_read.first_sample_px));
  }
  if (other.scale != as_read.scale) {
    parts.push_back(fmt::format("depth times {:.4g}", DepthFactor(as_read, other)));
  }
  if (other.poses != as_read.poses) {
    parts.push_back(fmt::format("poses are {}", TitleOf(other.poses)));
  }
  return parts.empty() ? "as read" : fmt::format("{}", fmt::join(parts, "; "));
}

RepairOptions FindRepair(const InputReading& as_read, const InputReading& other) {
  RepairOptions repair;
  std::vector<std::string>& keys = repair.geometry_keys;
  if (other.kind != as_read.kind) keys.push_back(fmt::format("kind={}", ToString(other.kind)));
  if (other.orientation != as_read.orientation) {
    keys.push_back(fmt::format("orientation={}", ToString(other.orientation)));
  }
  if (other.first_sample_px != as_read.first_sample_px) {
    keys.push_back(fmt::format("first_sample_px={}", other.first_sample_px));
  }
  if (other.scale != as_read.scale) keys.push_back(fmt::format("scale={:.4g}", other.scale));
  if (other.poses != as_read.poses) {
    repair.options.push_back(fmt::format("--model-poses {}", ToString(other.poses)));
  }
  return repair;
}

std::string ToString(const RepairOptions& repair) {
  std::string text;
  if (!repair.geometry_keys.empty()) {
    text = fmt::format("in --geometry: {}", fmt::join(repair.geometry_keys, ","));
  }
  if (!repair.replaced_keys.empty()) {
    const std::string replaced = fmt::format("{}", fmt::join(repair.replaced_keys, ","));
    text = text.empty() ? fmt::format("in --geometry: leave out {}", replaced)
                        : fmt::format("{} in place of {}", text, replaced);
  }
  for (const std::string& option : repair.options) {
    text += (text.empty() ? "" : "; ") + option;
  }
  return text;
}

}  // namespace raylift
