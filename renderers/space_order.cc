#include "renderers/space_order.h"

#include <algorithm>
#include <utility>

#include <Eigen/Geometry>
#include <boost/sort/spreadsort/integer_sort.hpp>

namespace raylift {
namespace {

// Every third bit of the result is a bit of the 21 of `value`.
uint64_t Spread(uint64_t value) {
  value &= 0x1fffff;
  value = (value | value << 32) & 0x1f00000000ffff;
  value = (value | value << 16) & 0x1f0000ff0000ff;
  value = (value | value << 8) & 0x100f00f00f00f00f;
  value = (value | value << 4) & 0x10c30c30c30c30c3;
  return (value | value << 2) & 0x1249249249249249;
}

}  // namespace

std::vector<uint32_t> OrderInSpace(const std::vector<Eigen::Vector3f>& points) {
  Eigen::AlignedBox3f box;
  for (const Eigen::Vector3f& point : points) box.extend(point);
  const float cell = std::max(box.sizes().maxCoeff(), 1e-30f) / 0x1fffff;
  std::vector<std::pair<uint64_t, uint32_t>> keys(points.size());
  for (uint32_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3f at = (points[i] - box.min()) / cell;
    const auto bits = [&](int axis) { return Spread(static_cast<uint64_t>(at[axis])); };
    keys[i] = {bits(0) | bits(1) << 1 | bits(2) << 2, i};
  }
  boost::sort::spreadsort::integer_sort(
      keys.begin(), keys.end(), [](const auto& key, unsigned bits) { return key.first >> bits; });
  std::vector<uint32_t> order(points.size());
  std::transform(keys.begin(), keys.end(), order.begin(),
                 [](const auto& key) { return key.second; });
  return order;
}

}  // namespace raylift
