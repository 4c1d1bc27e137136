#include "city.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "base/rng.h"

namespace raylift {
namespace {

constexpr int kHousesPerSide = 10;
constexpr double kSide = 200;      // of the city
constexpr double kPitch = 20;      // from house to house
constexpr double kFootprint = 12;  // of a house

// In [0, 1), the same for the same cell.
double Noise(uint32_t a, uint32_t b, uint32_t c) {
  uint32_t h = a * 0x9E3779B1u ^ b * 0x85EBCA77u ^ c * 0xC2B2AE3Du;
  h = (h ^ h >> 15) * 0x2C1B3C6Du;
  h = (h ^ h >> 12) * 0x297A2D39u;
  return (h ^ h >> 15) * 0x1p-32;
}

double Ground(double x, double y) {
  return 0.8 * std::sin(x * 0.035) * std::cos(y * 0.041) + 0.05 * std::sin(x * 0.9 + y * 0.7);
}

double HouseHeight(int i, int j) {
  return 6 + 20 * Noise(static_cast<uint32_t>(i), static_cast<uint32_t>(j), 77);
}

// How deep a wall's window is at this place.
double Recess(double along, double up) {
  const double a = std::fmod(along, 3);
  const double b = std::fmod(up, 3);
  return a > 1 && a < 2.2 && b > 1 && b < 2.5 ? 0.15 : 0;
}

class CityBuilder {
 public:
  explicit CityBuilder(size_t num_triangles) {
    double area = kSide * kSide;
    for (int i = 0; i < kHousesPerSide * kHousesPerSide; ++i) {
      area += 4 * kFootprint * HouseHeight(i / kHousesPerSide, i % kHousesPerSide) +
              kFootprint * kFootprint;
    }
    cell_ = std::sqrt(2 * area / static_cast<double>(num_triangles));
  }

  TriangleMesh Build() {
    AddGrid(kSide, kSide, [](double u, double v, double noise) {
      return Eigen::Vector3d(u, v, Ground(u, v) + noise);
    });
    for (int i = 0; i < kHousesPerSide; ++i) {
      for (int j = 0; j < kHousesPerSide; ++j) AddHouse(i, j);
    }
    mesh_.vertices.reserve(mesh_.vertices.size() + 1);
    return std::move(mesh_);
  }

 private:
  using Surface = std::function<Eigen::Vector3d(double u, double v, double noise)>;

  void AddGrid(double size_u, double size_v, const Surface& surface) {
    const int nu = std::max(1, static_cast<int>(std::lround(size_u / cell_)));
    const int nv = std::max(1, static_cast<int>(std::lround(size_v / cell_)));
    const auto base = static_cast<uint32_t>(mesh_.vertices.size());
    ++num_grids_;
    for (int b = 0; b <= nv; ++b) {
      for (int a = 0; a <= nu; ++a) {
        const double noise =
            0.04 * (Noise(static_cast<uint32_t>(a), static_cast<uint32_t>(b), num_grids_) - 0.5);
        mesh_.vertices.push_back(surface(size_u * a / nu, size_v * b / nv, noise).cast<float>());
      }
    }
    for (int b = 0; b < nv; ++b) {
      for (int a = 0; a < nu; ++a) {
        const uint32_t i = base + static_cast<uint32_t>(b * (nu + 1) + a);
        const auto row = static_cast<uint32_t>(nu + 1);
        mesh_.triangles.push_back({i, i + 1, i + row + 1});
        mesh_.triangles.push_back({i, i + row + 1, i + row});
      }
    }
  }

  void AddHouse(int i, int j) {
    const double x = i * kPitch + 4;
    const double y = j * kPitch + 4;
    const double height = HouseHeight(i, j);
    for (int wall = 0; wall < 4; ++wall) {
      AddGrid(kFootprint, height + 2, [=](double u, double v, double noise) {
        const double out = noise - Recess(u, v) + 0.03 * std::sin(u * 2.1 + v * 1.3);
        const double z = v - 2;
        switch (wall) {
          case 0:
            return Eigen::Vector3d(x + u, y - out, z);
          case 1:
            return Eigen::Vector3d(x + kFootprint + out, y + u, z);
          case 2:
            return Eigen::Vector3d(x + kFootprint - u, y + kFootprint + out, z);
          default:
            return Eigen::Vector3d(x - out, y + kFootprint - u, z);
        }
      });
    }
    AddGrid(kFootprint, kFootprint, [=](double u, double v, double noise) {
      return Eigen::Vector3d(x + u, y + v,
                             height + noise + 0.3 * std::sin(u * 0.5) * std::sin(v * 0.5));
    });
  }

  double cell_;
  uint32_t num_grids_ = 0;
  TriangleMesh mesh_;
};

Rigid3 Look(const Eigen::Vector3d& center, double yaw, double pitch) {
  const Eigen::Vector3d forward(std::cos(yaw) * std::cos(pitch), std::sin(yaw) * std::cos(pitch),
                                std::sin(pitch));
  const Eigen::Vector3d right(std::sin(yaw), -std::cos(yaw), 0);
  Eigen::Matrix3d cam_from_world;
  cam_from_world << right.transpose(), forward.cross(right).transpose(), forward.transpose();
  const Eigen::Quaterniond rotation(cam_from_world);
  return {rotation, -(rotation * center)};
}

}  // namespace

TriangleMesh MakeCity(size_t num_triangles) { return CityBuilder(num_triangles).Build(); }

Camera CityCamera() {
  const double params[] = {1440, 1440, 960, 540};
  return {CameraModel::kPinhole, 1920, 1080, params};
}

std::vector<Rigid3> CityViews(int count) {
  Rng rng(1);
  std::vector<Rigid3> views;
  for (int i = 0; i < count; ++i) {
    const double x = (1 + rng.UniformIndex(8)) * kPitch + 2 * rng.Uniform();
    const double y = (1 + rng.UniformIndex(8)) * kPitch + 2 * rng.Uniform();
    const double yaw = 2 * std::numbers::pi * rng.Uniform();
    const bool above = i % 4 == 3;
    const double pitch = above ? -0.5 : 0.12 * rng.Uniform();
    views.push_back(Look({x, y, above ? 40 : Ground(x, y) + 1.7}, yaw, pitch));
  }
  return views;
}

}  // namespace raylift
