#include "raylift/lifting/depth_registration.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace raylift {
namespace {

constexpr double kMaxJump = 0.05;

// A sample of the sensor's map in the photograph.
struct Corner {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double z = 0;  // 0: none
};

using Triangle = std::array<const Corner*, 3>;

std::vector<Corner> CornersInImage(const DepthMap& map, const DepthSensor& sensor,
                                   const Camera& image) {
  const Camera camera = sensor.camera.Scaled(map.width_px, map.height_px);
  std::vector<Corner> corners(map.z.size());
  for (int y = 0; y < map.height_px; ++y) {
    for (int x = 0; x < map.width_px; ++x) {
      const double z = static_cast<double>(map.At(x, y));
      const auto ray = z > 0 ? camera.RayInCam({x + 0.5, y + 0.5}) : std::nullopt;
      if (!ray || !(ray->z() > 0)) continue;
      const Eigen::Vector3d point = sensor.image_from_sensor * (*ray * (z / ray->z())).eval();
      const auto pixel = image.ImgFromCam(point);
      if (!pixel || !(point.z() > 0)) continue;
      corners[static_cast<size_t>(y) * static_cast<size_t>(map.width_px) + static_cast<size_t>(x)] =
          {*pixel, point.z()};
    }
  }
  return corners;
}

bool IsSurface(const Triangle& triangle) {
  double nearest = triangle[0]->z, farthest = nearest;
  for (const Corner* corner : triangle) {
    nearest = std::min(nearest, corner->z);
    farthest = std::max(farthest, corner->z);
  }
  return nearest > 0 && farthest <= nearest * (1 + kMaxJump);
}

double Cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

// 1/z is affine in the pixel.
void Draw(const Triangle& triangle, DepthMap& map) {
  const Eigen::Vector2d &a = triangle[0]->pixel, &b = triangle[1]->pixel, &c = triangle[2]->pixel;
  const double area = Cross(b - a, c - a);
  if (area == 0) return;
  const Eigen::Vector2d low = a.cwiseMin(b).cwiseMin(c), high = a.cwiseMax(b).cwiseMax(c);
  const int x0 = static_cast<int>(std::ceil(std::max(low.x() - 0.5, 0.0)));
  const int y0 = static_cast<int>(std::ceil(std::max(low.y() - 0.5, 0.0)));
  const int x1 = static_cast<int>(std::floor(std::min(high.x() - 0.5, map.width_px - 1.0)));
  const int y1 = static_cast<int>(std::floor(std::min(high.y() - 0.5, map.height_px - 1.0)));
  for (int y = y0; y <= y1; ++y) {
    for (int x = x0; x <= x1; ++x) {
      constexpr double kOnEdge = -1e-9;
      const Eigen::Vector2d center(x + 0.5, y + 0.5);
      const double weight_b = Cross(center - a, c - a) / area;
      const double weight_c = Cross(b - a, center - a) / area;
      const double weight_a = 1 - weight_b - weight_c;
      if (weight_a < kOnEdge || weight_b < kOnEdge || weight_c < kOnEdge) continue;
      const double inverse_z =
          weight_a / triangle[0]->z + weight_b / triangle[1]->z + weight_c / triangle[2]->z;
      float& z = map.z[static_cast<size_t>(y) * static_cast<size_t>(map.width_px) +
                       static_cast<size_t>(x)];
      const auto here = static_cast<float>(1 / inverse_z);
      if (z == 0 || here < z) z = here;
    }
  }
}

}  // namespace

DepthMap RegisterDepth(const DepthMap& map, const DepthSensor& sensor, const Camera& image) {
  const std::vector<Corner> corners = CornersInImage(map, sensor, image);
  DepthMap registered{image.width_px(), image.height_px(), {}};
  registered.z.resize(static_cast<size_t>(image.width_px()) *
                      static_cast<size_t>(image.height_px()));
  for (int y = 0; y + 1 < map.height_px; ++y) {
    for (int x = 0; x + 1 < map.width_px; ++x) {
      const Corner* top = &corners[static_cast<size_t>(y) * static_cast<size_t>(map.width_px) +
                                   static_cast<size_t>(x)];
      const Corner* bottom = top + map.width_px;
      for (const Triangle& triangle :
           {Triangle{top, top + 1, bottom}, Triangle{top + 1, bottom + 1, bottom}}) {
        if (IsSurface(triangle)) Draw(triangle, registered);
      }
    }
  }
  return registered;
}

}  // namespace raylift
