#include "mesh_builder.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/Geometry>

namespace raylift::demo {

namespace {

constexpr double kMillimetersPerMetre = 1000;
constexpr double kTextureSteps = 10000;

}  // namespace

Frame UprightFrame(const Eigen::Vector3d& origin, double heading_deg) {
  const double a = heading_deg * std::numbers::pi / 180;
  return {origin, {std::cos(a), std::sin(a), 0}, {-std::sin(a), std::cos(a), 0}, {0, 0, 1}};
}

Material Material::Part(double s0, double t0, double s1, double t1) const {
  return {texture, At(s0, t0), At(s1, t1),
          size_m.cwiseProduct(Eigen::Vector2d(s1 - s0, t1 - t0).cwiseAbs())};
}

Material Material::Piece(double width_m, double height_m, Rng& rng) const {
  const double s = std::min(1.0, width_m / size_m.x());
  const double t = std::min(1.0, height_m / size_m.y());
  const double s0 = rng.Uniform(0, 1 - s);
  const double t0 = rng.Uniform(0, 1 - t);
  return Part(s0, t0, s0 + s, t0 + t);
}

std::pair<uint32_t, uint32_t> MeshBuilder::AddCorner(const Corner& corner) {
  const std::array<int64_t, 3> p{std::llround(corner.position.x() * kMillimetersPerMetre),
                                 std::llround(corner.position.y() * kMillimetersPerMetre),
                                 std::llround(corner.position.z() * kMillimetersPerMetre)};
  const auto [p_entry, p_is_new] =
      position_index_.try_emplace(p, static_cast<uint32_t>(positions_.size()));
  if (p_is_new) {
    positions_.emplace_back(p[0] / kMillimetersPerMetre, p[1] / kMillimetersPerMetre,
                            p[2] / kMillimetersPerMetre);
  }
  const std::array<int64_t, 2> t{std::llround(corner.uv.x() * kTextureSteps),
                                 std::llround(corner.uv.y() * kTextureSteps)};
  const auto [t_entry, t_is_new] =
      texture_coordinate_index_.try_emplace(t, static_cast<uint32_t>(texture_coordinates_.size()));
  if (t_is_new) {
    texture_coordinates_.emplace_back(t[0] / kTextureSteps, t[1] / kTextureSteps);
  }
  return {p_entry->second, t_entry->second};
}

void MeshBuilder::Polygon(std::span<const Corner> corners, int texture) {
  Face face{{}, texture};
  for (const Corner& corner : corners) {
    const auto added = AddCorner(corner);
    // Neighbors that round to the same point would make a triangle without area.
    const bool is_new =
        std::none_of(face.corners.begin(), face.corners.end(),
                     [&](const auto& earlier) { return earlier.first == added.first; });
    if (is_new) face.corners.push_back(added);
  }
  if (face.corners.size() >= 3) faces_.push_back(std::move(face));
}

void MeshBuilder::Quad(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                       const Eigen::Vector3d& d, const Material& material) {
  const std::array<Corner, 4> corners{{{a, material.At(0, 0)},
                                       {b, material.At(1, 0)},
                                       {c, material.At(1, 1)},
                                       {d, material.At(0, 1)}}};
  Polygon(corners, material.texture);
}

void MeshBuilder::Box(const Frame& frame, const Eigen::Vector3d& low, const Eigen::Vector3d& high,
                      const Material& material, Rng& rng, LowFace low_face) {
  // A face of corner p, sides along the axes i and j (i x j points outwards).
  const auto face = [&](Eigen::Vector3d p, int i, int j) {
    const double direction_i = p[i] == low[i] ? 1 : -1;
    const Eigen::Vector3d side_i = direction_i * (high[i] - low[i]) * Eigen::Vector3d::Unit(i);
    const Eigen::Vector3d side_j = (high[j] - low[j]) * Eigen::Vector3d::Unit(j);
    const auto at = [&](const Eigen::Vector3d& q) { return frame.At(q.x(), q.y(), q.z()); };
    Quad(at(p), at(p + side_i), at(p + side_i + side_j), at(p + side_j),
         material.Piece(side_i.norm(), side_j.norm(), rng));
  };
  face({low.x(), low.y(), low.z()}, 0, 2);    // front, -y
  face({high.x(), high.y(), low.z()}, 0, 2);  // +y
  face({low.x(), high.y(), low.z()}, 1, 2);   // -x: side i runs down the y axis
  face({high.x(), low.y(), low.z()}, 1, 2);   // +x
  face({low.x(), low.y(), high.z()}, 0, 1);   // +z
  if (low_face == LowFace::kVisible) face({high.x(), low.y(), low.z()}, 0, 1);  // -z
}

void MeshBuilder::Turned(const Frame& frame, std::span<const Eigen::Vector2d> profile, int segments,
                         const Material& material) {
  double length = 0;
  for (size_t i = 1; i < profile.size(); ++i) length += (profile[i] - profile[i - 1]).norm();
  double below = 0;
  for (size_t i = 1; i < profile.size(); ++i) {
    const Eigen::Vector2d& low = profile[i - 1];
    const Eigen::Vector2d& high = profile[i];
    const double above = below + (high - low).norm();
    for (int k = 0; k < segments; ++k) {
      const double s0 = static_cast<double>(k) / segments;
      const double s1 = static_cast<double>(k + 1) / segments;
      const auto corner = [&](const Eigen::Vector2d& p, double s, double t) {
        const double angle = 2 * std::numbers::pi * s;
        return Corner{frame.At(p.x() * std::cos(angle), p.x() * std::sin(angle), p.y()),
                      material.At(s, t / length)};
      };
      const std::array<Corner, 4> corners{corner(low, s0, below), corner(low, s1, below),
                                          corner(high, s1, above), corner(high, s0, above)};
      Polygon(corners, material.texture);
    }
    below = above;
  }
}

void MeshBuilder::Tube(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double radius,
                       int segments, const Material& material) {
  const Eigen::Vector3d axis = to - from;
  const Eigen::Vector3d z = axis.normalized();
  const Eigen::Vector3d x = z.unitOrthogonal();
  const std::array<Eigen::Vector2d, 2> profile{Eigen::Vector2d{radius, 0},
                                               Eigen::Vector2d{radius, axis.norm()}};
  Turned({from, x, z.cross(x), z}, profile, segments, material);
}

void MeshBuilder::Append(const MeshBuilder& other) {
  for (const Face& face : other.faces_) {
    std::vector<Corner> corners;
    for (const auto& [position, uv] : face.corners) {
      corners.push_back({other.positions_[position], other.texture_coordinates_[uv]});
    }
    Polygon(corners, face.texture);
  }
}

TriangleMesh MeshBuilder::ToTriangleMesh(std::vector<Image> textures) const {
  TriangleMesh mesh;
  mesh.textures = std::move(textures);
  std::map<std::pair<uint32_t, uint32_t>, uint32_t> vertex_index;
  const auto vertex = [&](const std::pair<uint32_t, uint32_t>& corner) {
    const auto [entry, is_new] =
        vertex_index.try_emplace(corner, static_cast<uint32_t>(mesh.vertices.size()));
    if (is_new) {
      mesh.vertices.push_back(positions_[corner.first].cast<float>());
      mesh.texture_coordinates.push_back(texture_coordinates_[corner.second].cast<float>());
    }
    return entry->second;
  };
  for (const Face& face : faces_) {
    for (size_t i = 2; i < face.corners.size(); ++i) {
      mesh.triangles.push_back(
          {vertex(face.corners[0]), vertex(face.corners[i - 1]), vertex(face.corners[i])});
      mesh.triangle_textures.push_back(face.texture);
    }
  }
  return mesh;
}

}  // namespace raylift::demo
