#include "support/splat_files.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

#include <fmt/format.h>

namespace raylift {
namespace {

void Append(double value, std::string& bytes) {
  const auto number = static_cast<float>(value);
  bytes.append(reinterpret_cast<const char*>(&number), sizeof(number));
}

std::string Header(size_t count, size_t rest, SplatLayout layout) {
  std::vector<std::string> names = {"x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"};
  for (size_t i = 0; i < rest; ++i) names.push_back(fmt::format("f_rest_{}", i));
  names.emplace_back("opacity");
  for (int i = 0; i < (layout == SplatLayout::kDiscs ? 2 : 3); ++i) {
    names.push_back(fmt::format("scale_{}", i));
  }
  for (int i = 0; i < 4; ++i) names.push_back(fmt::format("rot_{}", i));
  std::string header =
      fmt::format("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", count);
  for (const std::string& name : names) header += "property float " + name + "\n";
  return header + "end_header\n";
}

// Bilinear between texels; 1 is full intensity.
Eigen::Vector3d TexelAt(const Image& image, const Eigen::Vector2d& uv) {
  const double x = uv.x() * image.width_px - 0.5;
  const double y = (1 - uv.y()) * image.height_px - 0.5;
  const double x0 = std::floor(x), y0 = std::floor(y);
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (int i = 0; i < 4; ++i) {
    const int right = i % 2, down = i / 2;
    const double weight = (right == 1 ? x - x0 : 1 - x + x0) * (down == 1 ? y - y0 : 1 - y + y0);
    const int column = std::clamp(static_cast<int>(x0) + right, 0, image.width_px - 1);
    const int row = std::clamp(static_cast<int>(y0) + down, 0, image.height_px - 1);
    const uint8_t* const rgb = image.Pixel(column, row);
    sum += weight / 255 * Eigen::Vector3d(rgb[0], rgb[1], rgb[2]);
  }
  return sum;
}

class DiscLayer {
 public:
  DiscLayer(const TriangleMesh& mesh, double spacing) : mesh_(mesh), spacing_(spacing) {}

  void Cover(size_t triangle, std::vector<TestSplat>& discs) const {
    const auto& corners = mesh_.triangles[triangle];
    const Eigen::Vector3d a = mesh_.VertexInWorld(corners[0]);
    const Eigen::Vector3d ab = mesh_.VertexInWorld(corners[1]) - a;
    const Eigen::Vector3d ac = mesh_.VertexInWorld(corners[2]) - a;
    const Eigen::Vector3d normal = ab.cross(ac).normalized();
    const double step = std::min(spacing_, 0.5 * std::sqrt(0.5 * ab.cross(ac).norm()));
    // The lattices of triangles in one plane are one.
    int axis = 0;
    normal.cwiseAbs().minCoeff(&axis);
    Eigen::Matrix3d frame;
    frame.col(0) = normal.cross(Eigen::Vector3d::Unit(axis)).normalized();
    frame.col(1) = normal.cross(frame.col(0));
    frame.col(2) = normal;
    TestSplat disc;
    disc.rotation = Eigen::Quaterniond(frame);
    // On a square lattice, gaps between discs of this size let 0.1 % of the light through.
    disc.scale = Eigen::Vector3d(0.6, 0.6, 1e-3) * step;
    const Eigen::Matrix2d edges = (Eigen::Matrix2d() << ab.dot(frame.col(0)), ac.dot(frame.col(0)),
                                   ab.dot(frame.col(1)), ac.dot(frame.col(1)))
                                      .finished();
    const Eigen::Matrix2d to_uv = edges.inverse();
    const Eigen::Vector2d origin(a.dot(frame.col(0)), a.dot(frame.col(1)));
    const auto add = [&](const Eigen::Vector2d& uv) {
      disc.mean = a + uv.x() * ab + uv.y() * ac;
      disc.harmonics[0] = HarmonicOf(ColorAt(triangle, uv));
      discs.push_back(disc);
    };
    const size_t before = discs.size();
    const Eigen::Array2d low = origin.array() + edges.rowwise().minCoeff().array().min(0.0);
    const Eigen::Array2d high = origin.array() + edges.rowwise().maxCoeff().array().max(0.0);
    for (double x = step * std::ceil(low.x() / step); x <= high.x(); x += step) {
      for (double y = step * std::ceil(low.y() / step); y <= high.y(); y += step) {
        const Eigen::Vector2d uv = to_uv * (Eigen::Vector2d(x, y) - origin);
        if (uv.x() >= 0 && uv.y() >= 0 && uv.sum() < 1) add(uv);
      }
    }
    if (discs.size() == before) add(Eigen::Vector2d::Constant(1.0 / 3));
  }

 private:
  Eigen::Vector3d ColorAt(size_t triangle, const Eigen::Vector2d& uv) const {
    const std::array<double, 3> weights = {1 - uv.sum(), uv.x(), uv.y()};
    const int32_t texture =
        mesh_.triangle_textures.empty() ? -1 : mesh_.triangle_textures[triangle];
    Eigen::Vector2d at = Eigen::Vector2d::Zero();
    Eigen::Vector3d color = Eigen::Vector3d::Zero();
    for (size_t i = 0; i < 3; ++i) {
      const uint32_t corner = mesh_.triangles[triangle][i];
      if (texture >= 0) {
        at += weights[i] * mesh_.texture_coordinates[corner].cast<double>();
      } else if (!mesh_.vertex_colors_rgb.empty()) {
        const auto& rgb = mesh_.vertex_colors_rgb[corner];
        color += weights[i] / 255 * Eigen::Vector3d(rgb[0], rgb[1], rgb[2]);
      }
    }
    return texture >= 0 ? TexelAt(mesh_.textures[static_cast<size_t>(texture)], at) : color;
  }

  const TriangleMesh& mesh_;
  double spacing_;
};

}  // namespace

Eigen::Vector3f HarmonicOf(const Eigen::Vector3d& rgb) {
  return ((rgb.array() - 0.5) * (2 * std::sqrt(std::numbers::pi))).matrix().cast<float>();
}

std::string SplatPly(std::span<const TestSplat> splats, SplatLayout layout) {
  const size_t coefficients = splats.empty() ? 1 : splats[0].harmonics.size();
  std::string bytes = Header(splats.size(), 3 * (coefficients - 1), layout);
  for (const TestSplat& splat : splats) {
    for (const double value : splat.mean) Append(value, bytes);
    for (int i = 0; i < 3; ++i) Append(0, bytes);
    for (const float value : splat.harmonics[0]) Append(double{value}, bytes);
    for (int channel = 0; channel < 3; ++channel) {
      for (size_t i = 1; i < coefficients; ++i) Append(double{splat.harmonics[i][channel]}, bytes);
    }
    Append(std::log(splat.opacity / (1 - splat.opacity)), bytes);
    for (int i = 0; i < (layout == SplatLayout::kDiscs ? 2 : 3); ++i) {
      Append(std::log(splat.scale[i]), bytes);
    }
    const Eigen::Quaterniond& q = splat.rotation;
    for (const double value : {q.w(), q.x(), q.y(), q.z()}) Append(value, bytes);
  }
  return bytes;
}

std::vector<TestSplat> DiscsOn(const TriangleMesh& mesh, double spacing) {
  std::vector<TestSplat> discs;
  const DiscLayer layer(mesh, spacing);
  for (size_t i = 0; i < mesh.triangles.size(); ++i) layer.Cover(i, discs);
  return discs;
}

}  // namespace raylift
