#include "raylift/evaluation/depth_edges.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "raylift/base/error.h"

namespace raylift {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// The lower envelope of the parabolas (x - q)^2 + values[q], at every x, in place.
void TransformLine(std::span<double> values, std::vector<size_t>& apexes,
                   std::vector<double>& starts, std::vector<double>& result) {
  apexes.clear();
  starts.clear();
  const auto height = [&](size_t q) { return values[q] + static_cast<double>(q * q); };
  for (size_t q = 0; q < values.size(); ++q) {
    if (values[q] == kInfinity) continue;
    double start = -kInfinity;
    while (!apexes.empty()) {
      const size_t p = apexes.back();
      start = (height(q) - height(p)) / (2 * static_cast<double>(q - p));
      if (start > starts.back()) break;
      apexes.pop_back();
      starts.pop_back();
      start = -kInfinity;
    }
    apexes.push_back(q);
    starts.push_back(start);
  }
  if (apexes.empty()) return;
  result.resize(values.size());
  size_t k = 0;
  for (size_t x = 0; x < values.size(); ++x) {
    while (k + 1 < starts.size() && starts[k + 1] <= static_cast<double>(x)) ++k;
    const double offset = static_cast<double>(x) - static_cast<double>(apexes[k]);
    result[x] = offset * offset + values[apexes[k]];
  }
  std::copy(result.begin(), result.end(), values.begin());
}

}  // namespace

std::vector<uint8_t> FindDepthEdges(const DepthMap& map, double min_jump) {
  std::vector<uint8_t> edges(map.z.size(), 0);
  const auto jumps_to = [&](int x, int y, float z) {
    if (x < 0 || y < 0 || x >= map.width_px || y >= map.height_px) return false;
    const float other = map.At(x, y);
    return other > 0 && static_cast<double>(other - z) > min_jump * static_cast<double>(z);
  };
  for (int y = 0; y < map.height_px; ++y) {
    for (int x = 0; x < map.width_px; ++x) {
      const float z = map.At(x, y);
      if (z > 0 && (jumps_to(x - 1, y, z) || jumps_to(x + 1, y, z) || jumps_to(x, y - 1, z) ||
                    jumps_to(x, y + 1, z))) {
        edges[static_cast<size_t>(y) * static_cast<size_t>(map.width_px) + static_cast<size_t>(x)] =
            1;
      }
    }
  }
  return edges;
}

std::vector<float> DistanceToSet(std::span<const uint8_t> mask, int width_px) {
  RAYLIFT_CHECK(width_px > 0);
  const auto width = static_cast<size_t>(width_px);
  const size_t height = mask.size() / width;
  RAYLIFT_CHECK_EQ(width * height, mask.size());
  std::vector<double> squared(mask.size());
  std::vector<size_t> apexes;
  std::vector<double> starts, result, column(height);
  for (size_t x = 0; x < width; ++x) {
    for (size_t y = 0; y < height; ++y) column[y] = mask[y * width + x] != 0 ? 0 : kInfinity;
    TransformLine(column, apexes, starts, result);
    for (size_t y = 0; y < height; ++y) squared[y * width + x] = column[y];
  }
  for (size_t y = 0; y < height; ++y) {
    TransformLine(std::span(squared).subspan(y * width, width), apexes, starts, result);
  }
  std::vector<float> distances(mask.size());
  std::transform(squared.begin(), squared.end(), distances.begin(),
                 [](double d) { return static_cast<float>(std::sqrt(d)); });
  return distances;
}

EdgeErrors ComputeEdgeErrors(std::span<const uint8_t> estimated, std::span<const uint8_t> truth,
                             int width_px, double max_px) {
  RAYLIFT_CHECK_EQ(estimated.size(), truth.size());
  const auto to_truth = DistanceToSet(truth, width_px);
  const auto to_estimated = DistanceToSet(estimated, width_px);
  EdgeErrors errors;
  size_t close = 0;
  double sum_accuracy = 0, sum_completeness = 0;
  for (size_t i = 0; i < truth.size(); ++i) {
    if (estimated[i] != 0) {
      ++errors.num_estimated;
      if (static_cast<double>(to_truth[i]) < max_px) {
        ++close;
        sum_accuracy += static_cast<double>(to_truth[i]);
      }
    }
    if (truth[i] != 0) {
      ++errors.num_true;
      sum_completeness += std::min(static_cast<double>(to_estimated[i]), max_px);
    }
  }
  if (close > 0) errors.accuracy_px = sum_accuracy / static_cast<double>(close);
  if (errors.num_true > 0) {
    errors.completeness_px = sum_completeness / static_cast<double>(errors.num_true);
  }
  if (errors.num_estimated > 0) {
    errors.spurious_percent = 100.0 * static_cast<double>(errors.num_estimated - close) /
                              static_cast<double>(errors.num_estimated);
  }
  return errors;
}

}  // namespace raylift
