#include <cmath>
#include <utility>

#include "estimation/solvers/minimal_solvers.h"
#include <Eigen/Geometry>

namespace raylift {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

// Returns right-handed axes of two unit vectors: x between them, z across both. nullopt where they
// lie in one line.
std::optional<Matrix3d> AxesOf(const Vector3d& a, const Vector3d& b) {
  const Vector3d across = a.cross(b);
  const double sine = across.norm();
  if (!(sine > 1e-9)) return std::nullopt;
  Matrix3d axes;
  axes.col(0) = (a + b).normalized();
  axes.col(2) = across / sine;
  axes.col(1) = axes.col(2).cross(axes.col(0));
  return axes;
}

Matrix3d RotationToZ(const Vector3d& direction) {
  return Eigen::Quaterniond::FromTwoVectors(direction, Vector3d::UnitZ()).toRotationMatrix();
}

}  // namespace

std::optional<CamFromLocal> SolvePoseAtCenter(const std::array<Vector3d, 2>& rays,
                                              const std::array<Vector3d, 2>& points_in_world,
                                              const Vector3d& center_in_world) {
  const Vector3d first = (points_in_world[0] - center_in_world).normalized();
  const Vector3d second = (points_in_world[1] - center_in_world).normalized();
  const auto in_cam = AxesOf(rays[0], rays[1]);
  const auto in_world = AxesOf(first, second);
  if (!in_cam || !in_world) return std::nullopt;
  const Matrix3d rotation = *in_cam * in_world->transpose();
  return CamFromLocal{rotation, -(rotation * center_in_world)};
}

int SolveUprightPose(const std::array<Vector3d, 2>& centers, const std::array<Vector3d, 2>& rays,
                     const std::array<Vector3d, 2>& points_in_world, const Vector3d& down_in_cam,
                     const Vector3d& down_in_world, std::span<CamFromLocal, 2> poses) {
  constexpr double kLevel = 1e-9;
  // Between frames whose z axes are vertical the rotation is one about z.
  const Matrix3d level_from_cam = RotationToZ(down_in_cam);
  const Matrix3d level_from_world = RotationToZ(down_in_world);
  Vector3d a = level_from_cam * rays[0];
  Vector3d b = level_from_cam * rays[1];
  Vector3d difference = level_from_world * (points_in_world[0] - points_in_world[1]);
  Vector3d apart = level_from_cam * (centers[0] - centers[1]);
  Vector3d center = centers[0];
  Vector3d point = points_in_world[0];
  if (std::abs(a.z()) > std::abs(b.z())) {
    std::swap(a, b);
    difference = -difference;
    apart = -apart;
    center = centers[1];
    point = points_in_world[1];
  }
  const double level2 = difference.head<2>().squaredNorm();
  if (!(std::abs(b.z()) > kLevel) || !(level2 > kLevel * kLevel * difference.squaredNorm())) {
    return 0;
  }
  // The points' heights differ by x a_z - y b_z and by the cameras', with the depths x and y; the
  // level part of x a - y b + apart = x u + v is as long as the points' level difference, which
  // gives x.
  const double height = difference.z() - apart.z();
  const Vector2d u = a.head<2>() - b.head<2>() * (a.z() / b.z());
  const Vector2d v = b.head<2>() * (height / b.z()) + apart.head<2>();
  const double square = u.squaredNorm();
  const double half = u.dot(v);
  const double discriminant = half * half - square * (v.squaredNorm() - level2);
  if (!(square > kLevel * kLevel) || !(discriminant >= 0)) return 0;
  int count = 0;
  for (const double root : {-std::sqrt(discriminant), std::sqrt(discriminant)}) {
    const double x = (root - half) / square;
    const double y = (x * a.z() - height) / b.z();
    if (!(x > 0) || !(y > 0)) continue;
    const Vector2d turned = x * u + v;
    const Vector2d level = difference.head<2>();
    const double angle =
        std::atan2(level.x() * turned.y() - level.y() * turned.x(), level.dot(turned));
    const Matrix3d rotation = level_from_cam.transpose() *
                              Eigen::AngleAxisd(angle, Vector3d::UnitZ()).toRotationMatrix() *
                              level_from_world;
    const Vector3d translation = x * (level_from_cam.transpose() * a) + center - rotation * point;
    if (!rotation.allFinite() || !translation.allFinite()) continue;
    poses[static_cast<size_t>(count++)] = {rotation, translation};
    if (root == 0) break;
  }
  return count;
}

}  // namespace raylift
