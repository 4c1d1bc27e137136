#include "noise.h"

#include <algorithm>
#include <cmath>

namespace raylift::demo {

double Hash(int x, int y, uint32_t seed) {
  uint32_t h = seed * 0x9E3779B9u ^ static_cast<uint32_t>(x) * 0x85EBCA6Bu ^
               static_cast<uint32_t>(y) * 0xC2B2AE35u;
  h = (h ^ (h >> 16)) * 0x7FEB352Du;
  h = (h ^ (h >> 15)) * 0x846CA68Bu;
  return (h ^ (h >> 16)) * 0x1p-32;
}

double Noise(double x, double y, uint32_t seed) {
  const double floor_x = std::floor(x), floor_y = std::floor(y);
  const int ix = static_cast<int>(floor_x), iy = static_cast<int>(floor_y);
  const auto smooth = [](double t) { return t * t * (3 - 2 * t); };
  const double s = smooth(x - floor_x), t = smooth(y - floor_y);
  const double low = std::lerp(Hash(ix, iy, seed), Hash(ix + 1, iy, seed), s);
  const double high = std::lerp(Hash(ix, iy + 1, seed), Hash(ix + 1, iy + 1, seed), s);
  return std::lerp(low, high, t);
}

double FractalNoise(double x, double y, int octaves, uint32_t seed) {
  double sum = 0, weight = 0, amplitude = 1;
  for (int i = 0; i < octaves; ++i) {
    sum += amplitude * Noise(x, y, seed + static_cast<uint32_t>(i));
    weight += amplitude;
    amplitude *= 0.5;
    x = 2 * x + 17.3;
    y = 2 * y + 5.7;
  }
  return sum / weight;
}

Cell CellNoise(double x, double y, uint32_t seed) {
  const int ix = static_cast<int>(std::floor(x)), iy = static_cast<int>(std::floor(y));
  double nearest = 1e9, second = 1e9;
  Cell cell{0, 0};
  for (int j = iy - 1; j <= iy + 1; ++j) {
    for (int i = ix - 1; i <= ix + 1; ++i) {
      const double distance = std::hypot(i + 0.15 + 0.7 * Hash(i, j, seed) - x,
                                         j + 0.15 + 0.7 * Hash(i, j, seed + 1) - y);
      if (distance < nearest) {
        second = nearest;
        nearest = distance;
        cell.id = Hash(i, j, seed + 2);
      } else {
        second = std::min(second, distance);
      }
    }
  }
  cell.edge_distance = second - nearest;
  return cell;
}

}  // namespace raylift::demo
