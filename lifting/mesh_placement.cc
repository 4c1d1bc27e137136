#include "lifting/mesh_placement.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "base/constants.h"
#include <Eigen/LU>
#include <Eigen/SVD>
#include <fmt/format.h>

#include "raylift/base/text.h"
#include "raylift/geometry/geodesy.h"

namespace raylift {
namespace {

constexpr std::string_view kAxisNames = "xyz";

// Describes a rotation that is not one of axes by its angle.
double AngleDeg(const Eigen::Matrix3d& rotation) {
  return kDegPerRad * std::acos(std::clamp((rotation.trace() - 1) / 2, -1.0, 1.0));
}

std::string MatrixKey(const MeshPlacement& placement) {
  std::vector<std::string> numbers;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      numbers.push_back(fmt::format("{:.9g}", placement.scale * placement.axes(row, column)));
    }
    numbers.push_back(fmt::format("{:.9g}", placement.shift[row]));
  }
  return fmt::format("matrix={}", fmt::join(numbers, "/"));
}

// Values are rounded to 9 digits, as the keys have them.
constexpr double kRounding = 1e-9;

double NearestInteger(double value, double tolerance) {
  const double integer = std::round(value) + 0.0;  // no minus zero
  return std::abs(value - integer) <= tolerance ? integer : value;
}

}  // namespace

MeshPlacement operator*(const MeshPlacement& left, const MeshPlacement& right) {
  const Eigen::Vector3d carried = left.scale * (left.axes * right.shift);
  MeshPlacement product{.scale = left.scale * right.scale,
                        .axes = left.axes * right.axes,
                        .shift = carried + left.shift};
  if (std::abs(product.scale - 1) <= kRounding) product.scale = 1;
  const double shift_rounding = kRounding * (carried.norm() + left.shift.norm());
  for (int row = 0; row < 3; ++row) {
    if (std::abs(product.shift[row]) <= shift_rounding) product.shift[row] = 0;
    for (int column = 0; column < 3; ++column) {
      product.axes(row, column) = NearestInteger(product.axes(row, column), kRounding);
    }
  }
  return product;
}

MeshPlacement Inverse(const MeshPlacement& placement) {
  MeshPlacement inverse{.scale = 1 / placement.scale, .axes = placement.axes.transpose()};
  inverse.shift = -inverse.scale * (inverse.axes * placement.shift);
  return inverse;
}

bool MeshPlacement::IsIdentity() const {
  return scale == 1 && axes == Eigen::Matrix3d::Identity() && shift == Eigen::Vector3d::Zero();
}

std::optional<Eigen::Matrix3d> AxesFromName(std::string_view name) {
  const auto parts = SplitBy(name, '/');
  if (parts.size() != 3) return std::nullopt;
  Eigen::Matrix3d axes = Eigen::Matrix3d::Zero();
  for (int row = 0; row < 3; ++row) {
    std::string_view part = parts[static_cast<size_t>(row)];
    const double sign = part.starts_with('-') ? -1 : 1;
    if (part.starts_with('-') || part.starts_with('+')) part.remove_prefix(1);
    const size_t column = part.size() == 1 ? kAxisNames.find(part[0]) : std::string_view::npos;
    if (column == std::string_view::npos) return std::nullopt;
    axes(row, static_cast<Eigen::Index>(column)) = sign;
  }
  if (std::abs(axes.determinant()) != 1) return std::nullopt;
  return axes;
}

std::optional<std::string> NameOfAxes(const Eigen::Matrix3d& axes) {
  std::string name;
  for (int row = 0; row < 3; ++row) {
    std::string part;
    for (int column = 0; column < 3; ++column) {
      const double value = axes(row, column);
      if (value == 0) continue;
      if (std::abs(value) != 1 || !part.empty()) return std::nullopt;
      part = (value < 0 ? "-" : "") + std::string(1, kAxisNames[static_cast<size_t>(column)]);
    }
    if (part.empty()) return std::nullopt;
    name += (row > 0 ? "/" : "") + part;
  }
  return name;
}

std::optional<MeshPlacement> PlacementFromMatrix(std::span<const double> row_major) {
  constexpr std::array<double, 4> kLastRow = {0, 0, 0, 1};
  const bool whole = row_major.size() == 16;
  if (!whole && row_major.size() != 12) return std::nullopt;
  if (whole && !std::equal(kLastRow.begin(), kLastRow.end(), row_major.begin() + 12)) {
    return std::nullopt;
  }
  Eigen::Matrix3d linear;
  MeshPlacement placement;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      linear(row, column) = row_major[static_cast<size_t>(4 * row + column)];
    }
    placement.shift[row] = row_major[static_cast<size_t>(4 * row + 3)];
  }
  placement.scale = std::cbrt(std::abs(linear.determinant()));
  if (!linear.allFinite() || !placement.shift.allFinite() || !(placement.scale > 0)) {
    return std::nullopt;
  }
  placement.axes = linear / placement.scale;
  constexpr double kTolerance = 1e-4;  // numbers are written with few digits
  const Eigen::Matrix3d square = placement.axes * placement.axes.transpose();
  if (!square.isIdentity(kTolerance)) return std::nullopt;
  // Axes by name are exact.
  if (NameOfAxes(placement.axes)) return placement;
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(placement.axes,
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  placement.axes = svd.matrixU() * svd.matrixV().transpose();
  return placement;
}

std::string Describe(const MeshPlacement& placement) {
  std::vector<std::string> parts;
  if (placement.scale != 1) parts.push_back(fmt::format("times {:.6g}", placement.scale));
  if (placement.axes != Eigen::Matrix3d::Identity()) {
    const auto name = NameOfAxes(placement.axes);
    std::string text = placement.IsMirror() ? "mirrored" : "turned";
    text += name ? fmt::format(" (its {} are x/y/z)", *name)
                 : fmt::format(" {} {:.2f} deg",
                               placement.IsMirror() ? "through a point and turned by" : "by",
                               AngleDeg(placement.IsMirror() ? -placement.axes : placement.axes));
    parts.push_back(std::move(text));
  }
  if (placement.shift != Eigen::Vector3d::Zero()) {
    parts.push_back(fmt::format("shifted by ({:.6g}, {:.6g}, {:.6g})", placement.shift.x(),
                                placement.shift.y(), placement.shift.z()));
  }
  return parts.empty() ? "the mesh as it is" : fmt::format("the mesh {}", fmt::join(parts, ", "));
}

std::string KeysOf(const MeshPlacement& placement) {
  std::vector<std::string> keys;
  if (placement.scale != 1) keys.push_back(fmt::format("scale={:.9g}", placement.scale));
  if (placement.axes != Eigen::Matrix3d::Identity()) {
    const auto name = NameOfAxes(placement.axes);
    if (!name) return MatrixKey(placement);
    keys.push_back("axes=" + *name);
  }
  if (placement.shift != Eigen::Vector3d::Zero()) {
    const Eigen::Vector3d& shift = placement.shift;
    keys.push_back(fmt::format("shift={:.9g}/{:.9g}/{:.9g}", shift.x(), shift.y(), shift.z()));
  }
  return fmt::format("{}", fmt::join(keys, ","));
}

namespace {

// Returns the system of coordinates that were placed so; empty where it has no name.
std::string Placed(const std::string& crs, const MeshPlacement& placement) {
  if (crs.empty() || placement.scale != 1 || !placement.axes.isIdentity(0)) return {};
  const WorldFrame frame = WorldFrame::Parse(crs);
  const Eigen::Vector3d origin = frame.origin - placement.shift;
  return fmt::format("{}@{},{},{}", frame.crs.definition(), origin.x(), origin.y(), origin.z());
}

}  // namespace

TriangleMesh Placed(TriangleMesh mesh, const MeshPlacement& placement) {
  if (placement.IsIdentity()) return mesh;
  mesh.crs = Placed(mesh.crs, placement);
  mesh.origin_in_world = placement * mesh.origin_in_world;
  const Eigen::Matrix3d linear = placement.scale * placement.axes;
  for (Eigen::Vector3f& vertex : mesh.vertices) {
    vertex = (linear * vertex.cast<double>()).cast<float>();
  }
  if (placement.IsMirror()) {
    for (auto& triangle : mesh.triangles) std::swap(triangle[1], triangle[2]);
  }
  return mesh;
}

PointCloud Placed(PointCloud cloud, const MeshPlacement& placement) {
  if (placement.IsIdentity()) return cloud;
  for (Eigen::Vector3d& point : cloud.points_in_world) point = placement * point;
  const Eigen::Matrix3f axes = placement.axes.cast<float>();
  for (Eigen::Vector3f& normal : cloud.normals) normal = axes * normal;
  return cloud;
}

Splats Placed(Splats splats, const MeshPlacement& placement) {
  if (placement.IsIdentity()) return splats;
  splats.origin_in_world = placement * splats.origin_in_world;
  const Eigen::Matrix3d linear = placement.scale * placement.axes;
  for (Eigen::Vector3f& mean : splats.means) mean = (linear * mean.cast<double>()).cast<float>();
  // An ellipsoid is its own image in a point, so that a mirror turns it as its negative does.
  const Eigen::Quaterniond turn(
      Eigen::Matrix3d(placement.IsMirror() ? -placement.axes : placement.axes));
  for (Eigen::Quaternionf& rotation : splats.rotations) {
    rotation = (turn * rotation.cast<double>()).normalized().cast<float>();
  }
  for (Eigen::Vector3f& scale : splats.scales) scale *= static_cast<float>(placement.scale);
  splats.harmonics_from_world = splats.harmonics_from_world * placement.axes.transpose();
  return splats;
}

}  // namespace raylift
