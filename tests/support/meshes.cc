#include "support/meshes.h"

#include <array>
#include <cmath>
#include <numbers>

#include <Eigen/Geometry>

namespace raylift {

TriangleMesh MeshOfShape(const std::vector<Eigen::Vector3d>& positions,
                         std::vector<std::array<uint32_t, 3>> triangles) {
  TriangleMesh mesh;
  for (const Eigen::Vector3d& position : positions) {
    mesh.origin_in_world += position / static_cast<double>(positions.size());
  }
  mesh.origin_in_world = mesh.origin_in_world.array().round();
  for (const Eigen::Vector3d& position : positions) {
    mesh.vertices.push_back((position - mesh.origin_in_world).cast<float>());
  }
  mesh.triangles = std::move(triangles);
  return mesh;
}

TriangleMesh MakePlane(const Rigid3& world_from_plane, double half, int cells) {
  std::vector<Eigen::Vector3d> positions;
  std::vector<std::array<uint32_t, 3>> triangles;
  const auto index = [cells](int x, int y) { return static_cast<uint32_t>(y * (cells + 1) + x); };
  for (int y = 0; y <= cells; ++y) {
    for (int x = 0; x <= cells; ++x) {
      positions.push_back(world_from_plane * Eigen::Vector3d(half * (2.0 * x / cells - 1),
                                                             half * (2.0 * y / cells - 1), 0));
      if (x < cells && y < cells) {
        triangles.push_back({index(x, y), index(x, y + 1), index(x + 1, y)});
        triangles.push_back({index(x + 1, y), index(x, y + 1), index(x + 1, y + 1)});
      }
    }
  }
  return MeshOfShape(positions, std::move(triangles));
}

TriangleMesh MakeBox(const Eigen::Vector3d& center, const Eigen::Vector3d& half_size) {
  std::vector<Eigen::Vector3d> positions;
  for (int i = 0; i < 8; ++i) {
    const Eigen::Vector3d corner((i & 1) != 0 ? 1 : -1, (i & 2) != 0 ? 1 : -1,
                                 (i & 4) != 0 ? 1 : -1);
    positions.push_back(center + corner.cwiseProduct(half_size));
  }
  return MeshOfShape(positions, {{0, 2, 1},
                                 {1, 2, 3},
                                 {4, 5, 6},
                                 {5, 7, 6},
                                 {0, 1, 4},
                                 {1, 5, 4},
                                 {2, 6, 3},
                                 {3, 6, 7},
                                 {0, 4, 2},
                                 {2, 4, 6},
                                 {1, 3, 5},
                                 {3, 7, 5}});
}

TriangleMesh MakeSphere(const Eigen::Vector3d& center, double radius, int rings, int segments) {
  std::vector<Eigen::Vector3d> positions = {center + Eigen::Vector3d(0, 0, radius)};
  for (int ring = 1; ring < rings; ++ring) {
    const double polar = std::numbers::pi * ring / rings;
    for (int segment = 0; segment < segments; ++segment) {
      const double azimuth = 2 * std::numbers::pi * segment / segments;
      positions.push_back(center + radius * Eigen::Vector3d(std::sin(polar) * std::cos(azimuth),
                                                            std::sin(polar) * std::sin(azimuth),
                                                            std::cos(polar)));
    }
  }
  positions.push_back(center - Eigen::Vector3d(0, 0, radius));
  const auto last = static_cast<uint32_t>(positions.size() - 1);
  const auto index = [&](int ring, int segment) {
    return static_cast<uint32_t>(1 + (ring - 1) * segments + segment % segments);
  };
  std::vector<std::array<uint32_t, 3>> triangles;
  for (int segment = 0; segment < segments; ++segment) {
    triangles.push_back({0, index(1, segment), index(1, segment + 1)});
    for (int ring = 1; ring + 1 < rings; ++ring) {
      const uint32_t a = index(ring, segment);
      const uint32_t b = index(ring, segment + 1);
      const uint32_t c = index(ring + 1, segment);
      const uint32_t d = index(ring + 1, segment + 1);
      triangles.push_back({a, c, b});
      triangles.push_back({b, c, d});
    }
    triangles.push_back({last, index(rings - 1, segment + 1), index(rings - 1, segment)});
  }
  return MeshOfShape(positions, std::move(triangles));
}

std::vector<Camera> CamerasOfEveryModel() {
  std::vector<Camera> cameras;
  for (const CameraModelInfo& info : AllCameraModels()) {
    if (info.model == CameraModel::kEquirectangular) continue;
    std::vector<double> params(static_cast<size_t>(info.num_params), 0.01);
    params[0] = 55;
    size_t next = 1;
    if (info.num_focal_lengths == 2) params[next++] = 56.5;
    params[next++] = 31.3;
    params[next++] = 24.6;
    if (info.model == CameraModel::kFov) params[next] = 0.5;
    if (info.model == CameraModel::kEucm) params[next] = 0.6, params[next + 1] = 1.1;
    cameras.emplace_back(info.model, 64, 48, params);
  }
  return cameras;
}

Rigid3 LookAt(const Eigen::Vector3d& center, const Eigen::Vector3d& target) {
  const Eigen::Vector3d z = (target - center).normalized();
  const Eigen::Vector3d down =
      std::abs(z.y()) < 0.9 ? Eigen::Vector3d(0, 1, 0) : Eigen::Vector3d(0, 0, 1);
  const Eigen::Vector3d x = down.cross(z).normalized();
  Eigen::Matrix3d world_from_cam;
  world_from_cam << x, z.cross(x), z;
  const Eigen::Quaterniond rotation = Eigen::Quaterniond(world_from_cam).conjugate();
  return {rotation, -(rotation * center)};
}

Camera CenteredPinhole(int width_px, int height_px, double focal_px) {
  const double params[] = {focal_px, focal_px, 0.5 * width_px, 0.5 * height_px};
  return Camera(CameraModel::kPinhole, width_px, height_px, params);
}

std::vector<Eigen::Vector2d> RandomPixels(const Camera& camera, int count, Rng& rng) {
  std::vector<Eigen::Vector2d> pixels;
  for (int i = 0; i < count; ++i) {
    pixels.emplace_back(rng.Uniform(0, camera.width_px()), rng.Uniform(0, camera.height_px()));
  }
  return pixels;
}

}  // namespace raylift
