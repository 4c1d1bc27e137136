// A part of an implicit tileset: which of its tiles there are.

#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "io/text/json_document.h"

namespace raylift {

// One bit for each tile, or one for all.
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

// Each tile has 4 or 8 children. Within a subtree tiles are counted level by level, within a level
// by the bits of x, y (and z) in turn.
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
