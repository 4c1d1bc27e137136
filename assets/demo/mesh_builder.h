// Builds the scene's mesh of textured quads and triangles: boxes, turned bodies, tubes, leaves.
// Corners are rounded to millimeters (and texture coordinates to 1e-4) as they are added, so that
// the mesh in memory is the mesh of the file.

#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include "base/rng.h"
#include <Eigen/Core>

#include "raylift/surfaces/triangle_mesh.h"

namespace raylift::demo {

// Right-handed axes at a place of the world.
struct Frame {
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  Eigen::Vector3d x = Eigen::Vector3d::UnitX();
  Eigen::Vector3d y = Eigen::Vector3d::UnitY();
  Eigen::Vector3d z = Eigen::Vector3d::UnitZ();

  Eigen::Vector3d At(double a, double b, double c) const { return origin + a * x + b * y + c * z; }
  // The same axes elsewhere.
  Frame Moved(double a, double b, double c) const { return {At(a, b, c), x, y, z}; }
};

// Upright, turned about the vertical.
Frame UprightFrame(const Eigen::Vector3d& origin, double heading_deg);

// A rectangle of a texture and the size in meters that it depicts.
struct Material {
  int texture = 0;
  Eigen::Vector2d uv_min{0, 0}, uv_max{1, 1};
  Eigen::Vector2d size_m{1, 1};

  Eigen::Vector2d At(double s, double t) const {
    return uv_min + Eigen::Vector2d(s, t).cwiseProduct(uv_max - uv_min);
  }
  Material Part(double s0, double t0, double s1, double t1) const;
  // A piece of the given size from a random place: keeps the pattern's scale. All of it along a
  // side that is too short.
  Material Piece(double width_m, double height_m, Rng& rng) const;
};

struct Corner {
  Eigen::Vector3d position;
  Eigen::Vector2d uv;
};

class MeshBuilder {
 public:
  struct Face {
    std::vector<std::pair<uint32_t, uint32_t>> corners;  // position, texture coordinate
    int texture;
  };

  // Three or four corners, counter-clockwise seen from the visible side.
  void Polygon(std::span<const Corner> corners, int texture);
  // The corners get the material's lower left, lower right, upper right and upper left.
  void Quad(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
            const Eigen::Vector3d& d, const Material& material);

  // The face at low z is left out where the box stands on the ground or is fixed to a wall.
  enum class LowFace { kVisible, kHidden };
  void Box(const Frame& frame, const Eigen::Vector3d& low, const Eigen::Vector3d& high,
           const Material& material, Rng& rng, LowFace low_face = LowFace::kVisible);

  // The body of a profile (radius, height) that runs upwards on its outer side, about the frame's
  // z.
  void Turned(const Frame& frame, std::span<const Eigen::Vector2d> profile, int segments,
              const Material& material);

  void Tube(const Eigen::Vector3d& from, const Eigen::Vector3d& to, double radius, int segments,
            const Material& material);

  void Append(const MeshBuilder& other);

  const std::vector<Eigen::Vector3d>& positions() const { return positions_; }
  const std::vector<Eigen::Vector2d>& texture_coordinates() const { return texture_coordinates_; }
  const std::vector<Face>& faces() const { return faces_; }

  TriangleMesh ToTriangleMesh(std::vector<Image> textures) const;

 private:
  std::pair<uint32_t, uint32_t> AddCorner(const Corner& corner);

  std::vector<Eigen::Vector3d> positions_;
  std::vector<Eigen::Vector2d> texture_coordinates_;
  std::vector<Face> faces_;
  std::map<std::array<int64_t, 3>, uint32_t> position_index_;
  std::map<std::array<int64_t, 2>, uint32_t> texture_coordinate_index_;
};

}  // namespace raylift::demo
