#include "surfaces/tileset.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <map>
#include <numbers>
#include <optional>
#include <string_view>
#include <utility>

#include "base/input_paths.h"
#include "base/read_limits.h"
#include "io/text/json_document.h"
#include "surfaces/file_readers.h"
#include "surfaces/input_files.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/geometry/geodesy.h"

namespace raylift {
namespace {

using Eigen::Affine3d;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using std::filesystem::path;

// The refinement of a tile: one with kAdd is shown together with its children, one with kReplace
// where they are not.
enum class Refine { kAdd, kReplace };

// The values that a tile passes on to its children.
struct Branch {
  Affine3d root_from_tile = Affine3d::Identity();
  Refine refine = Refine::kReplace;
  int depth = 0;
};

// A tileset.json that is being read.
struct OpenTileset {
  path file;
  path canonical;
  Matrix3d z_up_from_gltf = ZUpFromYUp();
};

bool IsNetworkAddress(std::string_view uri) {
  const size_t colon = uri.find(':');
  const std::string_view scheme = uri.substr(0, colon);
  const bool is_scheme = colon != std::string_view::npos && !scheme.empty() &&
                         std::all_of(scheme.begin(), scheme.end(), [](unsigned char c) {
                           return std::isalnum(c) != 0 || c == '+' || c == '-' || c == '.';
                         });
  return is_scheme || uri.starts_with("//");
}

void CheckExtensions(const JsonPlace& root) {
  constexpr std::array<std::string_view, 5> kKnown = {
      "3DTILES_content_gltf", "3DTILES_implicit_tiling", "3DTILES_multiple_contents",
      "3DTILES_metadata", "3DTILES_bounding_volume_S2"};
  if (!root.Has("extensionsRequired")) return;
  const JsonPlace required = root.Member("extensionsRequired");
  for (size_t i = 0; i < required.ArraySize(); ++i) {
    const JsonPlace extension = required.At(i);
    const std::string name = extension.String();
    if (std::find(kKnown.begin(), kKnown.end(), name) == kKnown.end()) {
      extension.Fail(fmt::format("the tileset requires {}, which is not read", Shown(name)));
    }
  }
}

Matrix3d ZUpFromGltf(const JsonPlace& asset) {
  if (!asset.Has("gltfUpAxis")) return ZUpFromYUp();
  const JsonPlace axis = asset.Member("gltfUpAxis");
  const std::string name = Lower(axis.String());
  if (name == "z") return Matrix3d::Identity();
  if (name != "y") axis.Fail("expected Y or Z");
  return ZUpFromYUp();
}

Affine3d TransformOf(const JsonPlace& tile) {
  Affine3d transform = Affine3d::Identity();
  if (!tile.Has("transform")) return transform;
  const JsonPlace place = tile.Member("transform");
  transform.matrix() = Eigen::Map<const Eigen::Matrix4d>(place.Vector<16>().eval().data());
  const bool is_affine = transform.matrix().row(3) == Eigen::RowVector4d(0, 0, 0, 1);
  const double volume = transform.linear().determinant();
  if (!is_affine || !std::isfinite(volume) || volume == 0) {
    place.Fail("expected a 4 x 4 matrix, column by column, that keeps volumes: 0 0 0 1 at its end");
  }
  return transform;
}

// Returns the center of a box, a sphere, or a region in longitudes and latitudes.
Vector3d CenterOf(const JsonPlace& tile, const Affine3d& root_from_tile) {
  const JsonPlace volume = tile.Member("boundingVolume");
  if (volume.Has("region")) {
    const JsonPlace region = volume.Member("region");
    const auto v = region.Vector<6>();  // west, south, east, north, lowest, highest
    if (!v.head<4>().isZero(0) && v.head<4>().cwiseAbs().maxCoeff() > 2 * std::numbers::pi) {
      region.Fail("expected radians");
    }
    const double east = v[2] < v[0] ? v[2] + 2 * std::numbers::pi : v[2];
    const Vector3d degrees = Vector3d(v[0] + east, v[1] + v[3], 0) * (90 / std::numbers::pi);
    const double middle = (v[4] + v[5]) / 2;
    return CrsTransform(Crs("EPSG:4979"), Crs("EPSG:4978"))({degrees.x(), degrees.y(), middle});
  }
  for (const char* kind : {"box", "sphere"}) {
    if (!volume.Has(kind)) continue;
    const JsonPlace numbers = volume.Member(kind);
    const bool is_box = std::string_view(kind) == "box";
    const Vector3d center =
        is_box ? numbers.Vector<12>().head<3>().eval() : numbers.Vector<4>().head<3>().eval();
    return root_from_tile * center;
  }
  volume.Fail("expected a box, a region or a sphere");
}

template <typename Visit>
void ForEachContent(const JsonPlace& tile, const Visit& visit) {
  if (tile.Has("content")) {
    const JsonPlace content = tile.Member("content");
    if (!content.IsNull()) visit(content);
  }
  const auto visit_all = [&](const JsonPlace& object) {
    const JsonPlace contents = object.Member("contents");
    for (size_t i = 0; i < contents.ArraySize(); ++i) {
      const JsonPlace content = contents.At(i);
      visit(content);
    }
  };
  if (tile.Has("contents")) return visit_all(tile);
  if (!tile.Has("extensions")) return;
  const JsonPlace extensions = tile.Member("extensions");
  if (!extensions.Has("3DTILES_multiple_contents")) return;
  const JsonPlace several = extensions.Member("3DTILES_multiple_contents");
  visit_all(several);
}

// The parts of a tile that are shown: its content, its children.
struct Showing {
  bool content = false, children = false;
};

Refine RefineOf(const JsonPlace& place) {
  const std::string name = Lower(place.String());
  if (name == "add") return Refine::kAdd;
  if (name == "replace") return Refine::kReplace;
  place.Fail("expected ADD or REPLACE");
}

// A tree of implicit tiles, and the templates of its tiles' file names.
struct ImplicitTiles {
  ImplicitTree tree;
  std::string subtree_uri;
  std::vector<std::string> content_uris;
  Branch branch;
  double error;  // of the root
};

// A tile's place in the whole tree.
struct TilePlace {
  int level = 0;
  uint64_t x = 0, y = 0, z = 0;
};

int Levels(const JsonPlace& tiling, std::string_view name, int most) {
  const JsonPlace place = tiling.Member(name);
  const int levels = place.Int();
  if (levels < 0 || levels > most) place.Fail(fmt::format("expected a number up to {}", most));
  return levels;
}

std::string Filled(std::string text, const TilePlace& at) {
  const std::array<std::pair<std::string_view, uint64_t>, 4> values = {
      {{"{level}", static_cast<uint64_t>(at.level)}, {"{x}", at.x}, {"{y}", at.y}, {"{z}", at.z}}};
  for (const auto& [name, value] : values) {
    for (size_t i = text.find(name); i != std::string::npos; i = text.find(name)) {
      text.replace(i, name.size(), std::to_string(value));
    }
  }
  return text;
}

class TilesetWalk {
 public:
  TilesetWalk(const path& root_file, double max_error)
      : folder_(root_file.lexically_normal().parent_path()), max_error_(max_error) {}

  Tileset Run(const path& root_file) {
    ReadTileset(root_file.lexically_normal(), Branch());
    return std::move(tileset_);
  }

 private:
  void ReadTileset(const path& file, const Branch& parent) {
    const JsonDocument document(ReadFile(file), file);
    const JsonPlace json = document.Root();
    const JsonPlace asset = json.Member("asset");
    const JsonPlace version = asset.Member("version");
    if (!version.String().starts_with("1.")) {
      version.Fail(fmt::format("expected 1.0 or 1.1, found {}", Shown(version.String())));
    }
    CheckExtensions(json);
    std::error_code ignored;
    open_.push_back({file, std::filesystem::weakly_canonical(file, ignored), ZUpFromGltf(asset)});
    const JsonPlace root = json.Member("root");
    if (open_.size() == 1) tileset_.center = CenterOf(root, TransformOf(root));
    ReadTile(root, parent);
    open_.pop_back();
  }

  void ReadTile(const JsonPlace& tile, const Branch& parent) {
    Branch branch = parent;
    branch.root_from_tile = parent.root_from_tile * TransformOf(tile);
    if (++branch.depth > kMaxTileNesting) {
      tile.Fail(fmt::format("tiles are nested more than {} deep", kMaxTileNesting));
    }
    Count(tile);
    if (tile.Has("refine")) branch.refine = RefineOf(tile.Member("refine"));
    const JsonPlace error_place = tile.Member("geometricError");
    const double error = error_place.Number();
    if (!(error >= 0)) error_place.Fail("expected 0 or more");
    const double scale = branch.root_from_tile.linear().colwise().norm().maxCoeff();
    if (tile.Has("implicitTiling")) return ReadImplicit(tile, tile, branch, error * scale);
    if (tile.Has("extensions")) {
      const JsonPlace extensions = tile.Member("extensions");
      if (extensions.Has("3DTILES_implicit_tiling")) {
        return ReadImplicit(tile, extensions, branch, error * scale);
      }
    }
    bool has_content = false;
    ForEachContent(tile, [&](const JsonPlace&) { has_content = true; });
    const bool has_children =
        tile.Has("children") && JsonPlace(tile.Member("children")).ArraySize() > 0;
    const Showing shown = ShownOf(has_content, has_children, error * scale, branch.refine);
    ForEachContent(tile, [&](const JsonPlace& content) {
      const JsonPlace uri = content.Member(content.Has("uri") ? "uri" : "url");
      AddContent(uri, Resolved(uri, uri.String(), open_.back().file), branch, shown.content);
    });
    if (!shown.children) return;
    const JsonPlace children = tile.Member("children");
    for (size_t i = 0; i < children.ArraySize(); ++i) {
      const JsonPlace child = children.At(i);
      ReadTile(child, branch);
    }
  }

  Showing ShownOf(bool has_content, bool has_children, double error, Refine refine) const {
    const bool is_fine = max_error_ > 0 && error <= max_error_ && has_content;
    const bool descends = has_children && !is_fine;
    return {.content = !descends || refine == Refine::kAdd, .children = descends};
  }

  void Count(const JsonPlace& place) {
    if (++num_tiles_ > kMaxTiles)
      place.Fail(fmt::format("there are more than {} tiles", kMaxTiles));
  }

  void CountUse(const JsonPlace& place, const path& file) {
    if (++num_uses_[file] > kMaxTileUses) {
      place.Fail(fmt::format("more than {} tiles name {}", kMaxTileUses, file.string()));
    }
  }

  path Resolved(const JsonPlace& place, const std::string& uri, const path& named_in) const {
    return place.Blame([&] { return ResolveInTileset(uri, named_in, folder_); });
  }

  // Adds a tile's content. Further tilesets are part of the tree, whatever shows of the tile that
  // names them; other files are added where the tile is shown.
  void AddContent(const JsonPlace& place, const path& file, const Branch& branch, bool is_shown) {
    const bool is_tileset = LowerExtension(file) == ".json";
    if (!is_tileset && !is_shown) return;
    CountUse(place, file);
    if (!is_tileset) {
      tileset_.contents.push_back(
          {file, branch.root_from_tile, open_.back().z_up_from_gltf, folder_});
      return;
    }
    std::error_code ignored;
    const path canonical = std::filesystem::weakly_canonical(file, ignored);
    for (const OpenTileset& open : open_) {
      if (open.canonical == canonical) place.Fail("the tileset includes itself");
    }
    ReadTileset(file, branch);
  }

  // ---- implicit tiling ----

  void ReadImplicit(const JsonPlace& tile, const JsonPlace& holder, const Branch& branch,
                    double error) {
    const JsonPlace tiling =
        holder.Member(holder.Has("implicitTiling") ? "implicitTiling" : "3DTILES_implicit_tiling");
    ImplicitTiles implicit{
        .tree = {}, .subtree_uri = {}, .content_uris = {}, .branch = branch, .error = error};
    const JsonPlace scheme = tiling.Member("subdivisionScheme");
    implicit.tree.is_octree = scheme.String() == "OCTREE";
    if (!implicit.tree.is_octree && scheme.String() != "QUADTREE") {
      scheme.Fail("expected QUADTREE or OCTREE");
    }
    implicit.tree.subtree_levels = Levels(tiling, "subtreeLevels", kMaxSubtreeLevels);
    if (implicit.tree.subtree_levels == 0) tiling.Fail("subtreeLevels: expected 1 or more");
    implicit.tree.levels = tiling.Has("availableLevels")
                               ? Levels(tiling, "availableLevels", kMaxImplicitLevels)
                               : Levels(tiling, "maximumLevel", kMaxImplicitLevels - 1) + 1;
    const JsonPlace subtrees = tiling.Member("subtrees");
    const JsonPlace subtree_uri = subtrees.Member("uri");
    implicit.subtree_uri = subtree_uri.String();
    ForEachContent(tile, [&](const JsonPlace& content) {
      const JsonPlace uri = content.Member("uri");
      implicit.content_uris.push_back(uri.String());
    });
    ReadSubtreeAt(tiling, implicit, {});
  }

  void ReadSubtreeAt(const JsonPlace& tiling, const ImplicitTiles& implicit, const TilePlace& at) {
    const path file = Resolved(tiling, Filled(implicit.subtree_uri, at), open_.back().file);
    CountUse(tiling, file);
    const Subtree subtree =
        ReadSubtree(file, implicit.tree, implicit.content_uris.size(),
                    [&](const JsonPlace& uri) { return Resolved(uri, uri.String(), file); });
    if (subtree.tiles.At(0)) ReadImplicitTile(tiling, implicit, subtree, at, 0, 0);
  }

  // Reads a tile of an implicit tree and those below it; `level` and `code` are its place within
  // its subtree.
  void ReadImplicitTile(const JsonPlace& tiling, const ImplicitTiles& implicit,
                        const Subtree& subtree, const TilePlace& at, int level, uint64_t code) {
    Count(tiling);
    const ImplicitTree& tree = implicit.tree;
    const uint64_t index = tree.FirstOfLevel(level) + code;
    const bool is_last = level + 1 == tree.subtree_levels;
    const auto has_child = [&](uint64_t child) {
      const uint64_t child_code = code << tree.BitsPerLevel() | child;
      return at.level + 1 < tree.levels &&
             (is_last ? subtree.children.At(child_code)
                      : subtree.tiles.At(tree.FirstOfLevel(level + 1) + child_code));
    };
    const uint64_t num_children = uint64_t{1} << tree.BitsPerLevel();
    bool has_children = false, has_content = false;
    for (uint64_t child = 0; child < num_children; ++child) has_children |= has_child(child);
    for (size_t i = 0; i < implicit.content_uris.size(); ++i) {
      has_content |= subtree.contents[i].At(index);
    }
    const Showing shown = ShownOf(has_content, has_children, std::ldexp(implicit.error, -at.level),
                                  implicit.branch.refine);
    for (size_t i = 0; i < implicit.content_uris.size(); ++i) {
      if (!subtree.contents[i].At(index)) continue;
      const std::string uri = Filled(implicit.content_uris[i], at);
      AddContent(tiling, Resolved(tiling, uri, open_.back().file), implicit.branch, shown.content);
    }
    for (uint64_t child = 0; shown.children && child < num_children; ++child) {
      if (!has_child(child)) continue;
      const TilePlace below{at.level + 1, at.x << 1 | (child & 1), at.y << 1 | (child >> 1 & 1),
                            at.z << 1 | child >> 2};
      if (is_last) {
        ReadSubtreeAt(tiling, implicit, below);
      } else {
        ReadImplicitTile(tiling, implicit, subtree, below, level + 1,
                         code << tree.BitsPerLevel() | child);
      }
    }
  }

  const path folder_;
  const double max_error_;
  Tileset tileset_;
  std::vector<OpenTileset> open_;
  std::map<path, int> num_uses_;
  int num_tiles_ = 0;
};

}  // namespace

std::optional<Vector3d> CenterOfTileset(const path& root_file) {
  const JsonDocument document(ReadFile(root_file), root_file);
  const JsonPlace json = document.Root();
  if (!json.Has("root")) return std::nullopt;
  const JsonPlace root = json.Member("root");
  return CenterOf(root, TransformOf(root));
}

path ResolveInTileset(const std::string& uri, const path& named_in, const path& folder) {
  if (IsNetworkAddress(uri)) {
    throw InputError(
        fmt::format("expected a file, found an address on a network, {}; download it together with "
                    "its tiles",
                    Shown(uri)));
  }
  const std::string text = DecodedUri(std::string_view(uri).substr(0, uri.find_first_of("?#")));
  const path file = (named_in.parent_path() / text).lexically_normal();
  if (text.empty() || text.find('\0') != std::string::npos ||
      !(FilesMayBeAnywhere() || Below(file, folder.empty() ? "." : folder))) {
    throw InputError(fmt::format(
        "expected a file below the tileset's folder, found {}; RAYLIFT_FILES_ANYWHERE=1 "
        "in the environment allows it",
        Shown(text)));
  }
  if (!IsFile(file)) {
    throw InputError(fmt::format("{}: no such file", Shown(text)));
  }
  return file;
}

Tileset ListTiles(const path& root_file, double max_error) {
  return TilesetWalk(root_file, max_error).Run(root_file);
}

}  // namespace raylift
