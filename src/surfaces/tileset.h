// Reads 3D Tiles, versions 1.0 and 1.1: finds the files that show a tileset, and the frames of
// their coordinates. A tileset is a tree of tiles in tileset.json, in further tilesets that its
// tiles name, or implicit, as bits of which tiles of a quadtree or octree there are.

#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "io/text/json_document.h"
#include "surfaces/raw_mesh.h"
#include <Eigen/Geometry>

namespace raylift {

// A file that a tile names.
struct TileContent {
  std::filesystem::path file;
  Eigen::Affine3d root_from_tile = Eigen::Affine3d::Identity();  // the root tileset's frame
  Eigen::Matrix3d z_up_from_gltf = Eigen::Matrix3d::Identity();
  std::filesystem::path folder = {};  // of the root, in which all lies that a tile names
};

// Returns the file that a tileset, a subtree or a tile names. Throws InputError with what is wrong
// with the name: it is on a network, not below the root's folder, or no file.
std::filesystem::path ResolveInTileset(const std::string& uri,
                                       const std::filesystem::path& named_in,
                                       const std::filesystem::path& folder);

struct Tileset {
  std::vector<TileContent> contents;  // in the order of the tree
  Eigen::Vector3d center;             // of the root's bounding volume, in the root's frame
};

// Returns the contents of the finest tiles, or of the coarsest whose geometric error is at most
// `max_error` where that is positive. Throws InputError naming the file and the JSON path where a
// tileset is none, includes itself, or names a file that is missing, below another folder than the
// root's, or on a network.
Tileset ListTiles(const std::filesystem::path& root_file, double max_error);

// Returns that center alone; nullopt where JSON is none of a tileset.
std::optional<Eigen::Vector3d> CenterOfTileset(const std::filesystem::path& root_file);

// The meshes of a tile's file, in the frame of the root.
struct TileMeshes {
  std::vector<RawMesh> meshes;
  size_t num_clouds = 0;  // pnts, which are not read
};
TileMeshes ReadTileContent(const TileContent& content);

// A part of an implicit tileset, with the availability of its tiles.

// Says which tiles there are, by one bit for each tile or one for all.
class Availability {
 public:
  explicit Availability(bool constant) : constant_(constant) {}
  explicit Availability(std::string bits) : bits_(std::move(bits)) {}
  bool At(uint64_t index) const {
    return bits_.empty() ? constant_ : (bits_[index / 8] >> (index % 8) & 1) != 0;
  }

 private:
  std::string bits_;
  bool constant_ = false;
};

// A tree in which each tile has 4 or 8 children. Within a subtree tiles are counted level by level,
// within a level by the bits of x, y (and z) in turn.
struct ImplicitTree {
  bool is_octree = false;
  int subtree_levels = 1;
  int levels = 1;  // of the whole tree

  int BitsPerLevel() const { return is_octree ? 3 : 2; }
  uint64_t FirstOfLevel(int level) const {
    return ((uint64_t{1} << (BitsPerLevel() * level)) - 1) / ((1u << BitsPerLevel()) - 1);
  }
};

struct Subtree {
  Availability tiles;
  std::vector<Availability> contents;  // one for each file that a tile names
  Availability children;               // subtrees below the last level
};

// Reads a subtree, binary or JSON, of tiles that name `num_contents` files each. `resolved` finds
// the files that hold its bits. Throws InputError where it has fewer bits than tiles, or says of
// another number of contents which there are; where it says nothing, there are none.
Subtree ReadSubtree(const std::filesystem::path& file, const ImplicitTree& tree,
                    size_t num_contents,
                    const std::function<std::filesystem::path(const JsonPlace& uri)>& resolved);

}  // namespace raylift
