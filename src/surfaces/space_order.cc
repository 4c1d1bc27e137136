#include "surfaces/space_order.h"

#include <algorithm>
#include <array>
#include <numeric>
#include <utility>

#include <Eigen/Geometry>

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

// Spreads the 21 bits of `value` to every third bit of the result.
uint64_t Spread(uint64_t value) {
  value &= 0x1fffff;
  value = (value | value << 32) & 0x1f00000000ffff;
  value = (value | value << 16) & 0x1f0000ff0000ff;
  value = (value | value << 8) & 0x100f00f00f00f00f;
  value = (value | value << 4) & 0x10c30c30c30c30c3;
  return (value | value << 2) & 0x1249249249249249;
}

using Key = std::pair<uint64_t, uint32_t>;  // a place on the curve, and the point's index

// Sorts by the places, which have so many `bits`, digit by digit from the last one on, so that keys
// of one place stay in their order.
void SortByPlace(std::vector<Key>& keys, unsigned bits) {
  constexpr unsigned kDigitBits = 11;
  constexpr uint64_t kDigits = uint64_t{1} << kDigitBits;
  std::vector<Key> sorted(keys.size());
  for (unsigned shift = 0; shift < bits; shift += kDigitBits) {
    if (CallWatch* const watch = CallWatch::Current()) watch->Check();
    const auto digit = [&](const Key& key) { return key.first >> shift & (kDigits - 1); };
    std::array<size_t, kDigits + 1> begins{};
    for (const Key& key : keys) ++begins[digit(key) + 1];
    std::partial_sum(begins.begin(), begins.end(), begins.begin());
    for (const Key& key : keys) sorted[begins[digit(key)]++] = key;
    keys.swap(sorted);
  }
}

}  // namespace

std::vector<uint32_t> OrderInSpace(const std::vector<Eigen::Vector3f>& points, unsigned bits) {
  Eigen::AlignedBox3f box;
  for (const Eigen::Vector3f& point : points) box.extend(point);
  const float cell =
      std::max(box.sizes().maxCoeff(), 1e-30f) / static_cast<float>((1u << bits) - 1);
  std::vector<Key> keys(points.size());
  for (uint32_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3f at = (points[i] - box.min()) / cell;
    const auto along = [&](int axis) { return Spread(static_cast<uint64_t>(at[axis])); };
    keys[i] = {along(0) | along(1) << 1 | along(2) << 2, i};
  }
  SortByPlace(keys, 3 * bits);
  std::vector<uint32_t> order(points.size());
  std::transform(keys.begin(), keys.end(), order.begin(),
                 [](const auto& key) { return key.second; });
  return order;
}

}  // namespace raylift
