// Tiles and tilesets for tests, written byte by byte.

#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include <Eigen/Geometry>

namespace raylift {

// Triangles whose coordinates are floats, z up.
struct TilePatch {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<std::array<uint32_t, 3>> triangles;
};

// Hills of 40 x 40 m in a grid of half a meter around a point; float holds all coordinates.
TilePatch HillPatch(const Eigen::Vector2d& center);

// Binary glTF of it, y up. `node` has members of its node, `root` of the document (", ..." each).
std::string TileGlb(const TilePatch& patch, const std::string& node = "",
                    const std::string& root = "");
// glTF with a table of features, which has `center` as RTC_CENTER unless that is zero.
std::string B3dm(const std::string& glb, const Eigen::Vector3d& center = Eigen::Vector3d::Zero());
// The common header of tiles and what follows.
std::string Tile(const std::string& kind, const std::string& rest);
std::string Cmpt(const std::vector<std::string>& tiles);

// A matrix as JSON, column by column, all digits.
std::string ColumnsOf(const Eigen::Affine3d& transform);

}  // namespace raylift
