// Makes a tileset one mesh, in the frame that was asked for.

#include <cmath>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "surfaces/file_readers.h"
#include "surfaces/tileset.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/geometry/geodesy.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

using Eigen::Vector3d;
using std::filesystem::path;

constexpr const char* kEarthCentered = "EPSG:4978";

// Returns the place of a point on the earth, if it is an earth-centered one near the ground.
std::optional<LocalFrame> PlaceOnEarth(const Vector3d& point) {
  constexpr double kLeast = 6.2e6, kMost = 6.5e6, kDeepest = -1e5, kHighest = 3e4;
  if (!(point.norm() > kLeast && point.norm() < kMost)) return std::nullopt;
  LocalFrame frame = LocalFrameAt(Crs(kEarthCentered), point);
  const double height = frame.geographic.z();
  return height > kDeepest && height < kHighest ? std::optional(frame) : std::nullopt;
}

// Transforms the points of a tileset to the world.
class TileFrame {
 public:
  TileFrame(const path& file, const Vector3d& center, const std::optional<WorldFrame>& world) {
    const auto place = PlaceOnEarth(center);
    if (!world) {
      if (place) UseLocalAxes(file, center, *place);
      return;
    }
    if (!place) {
      throw InputError(file, "root.boundingVolume",
                       fmt::format("expected earth-centered coordinates, to be led to {}, found a "
                                   "center at {:.9g} {:.9g} {:.9g}",
                                   world->text, center.x(), center.y(), center.z()));
    }
    world_from_root_ = -world->origin;
    if (world->crs.definition() == kEarthCentered) return;
    target_ = world->crs;
    try {
      CheckTarget(file, center);
    } catch (const InputError& error) {
      throw InputError(file, "crs", error.what());
    }
  }

  const std::vector<std::string>& notes() const { return notes_; }

  // Transforms the mesh's positions from the root's frame to the world. Any thread may call it.
  void Lead(RawMesh& mesh) {
    if (!target_) {
      for (Vector3d& point : mesh.positions) point = axes_ * (point - center_) + world_from_root_;
      return;
    }
    auto transform = TakeTransform();
    for (Vector3d& point : mesh.positions) point = (*transform)(point) + world_from_root_;
    const std::lock_guard lock(mutex_);
    idle_.push_back(std::move(transform));
  }

 private:
  void UseLocalAxes(const path& file, const Vector3d& center, const LocalFrame& place) {
    axes_ = place.Axes().transpose();
    center_ = center;
    const Vector3d& there = place.geographic;
    notes_.push_back(fmt::format(
        "{}: in meters east, north and up of {:.9f} {:.9f} {:.4f} (longitude, latitude, height "
        "above the ellipsoid), the center of its root; crs={} keeps it earth-centered, crs=EPSG:N "
        "leads it to a map",
        file.string(), there.x(), there.y(), there.z(), kEarthCentered));
  }

  void CheckTarget(const path& file, const Vector3d& center) {
    auto transform = TakeTransform();
    const Vector3d on_map = (*transform)(center);
    const auto warn = [&](const std::string& text) {
      notes_.push_back(fmt::format("{}: crs: {}", file.string(), text));
    };
    if (const auto warning = transform->Warning()) warn(*warning);
    try {
      target_->Check(on_map);
    } catch (const InputError& error) {
      warn(error.what());
    }
    idle_.push_back(std::move(transform));
  }

  // Returns a transform that is not in use, which one thread may use at a time; one that is idle is
  // taken first, as making one takes milliseconds.
  std::unique_ptr<CrsTransform> TakeTransform() {
    const std::lock_guard lock(mutex_);
    if (idle_.empty()) return std::make_unique<CrsTransform>(Crs(kEarthCentered), *target_);
    auto transform = std::move(idle_.back());
    idle_.pop_back();
    return transform;
  }

  Eigen::Matrix3d axes_ = Eigen::Matrix3d::Identity();
  Vector3d center_ = Vector3d::Zero();
  Vector3d world_from_root_ = Vector3d::Zero();
  std::optional<Crs> target_;
  std::mutex mutex_;
  std::vector<std::unique_ptr<CrsTransform>> idle_;
  std::vector<std::string> notes_;
};

// The meshes of one file of a tileset, and the counts of what was left out.
struct LoadedTile {
  std::vector<TriangleMesh> meshes;
  size_t num_clouds = 0, num_without_area = 0;
};

LoadedTile Load(const TileContent& content, TileFrame& frame) {
  TileMeshes raw = ReadTileContent(content);
  LoadedTile tile{.meshes = {}, .num_clouds = raw.num_clouds};
  for (RawMesh& mesh : raw.meshes) {
    try {
      frame.Lead(mesh);
    } catch (const InputError& error) {
      throw InputError(content.file, error.what());
    }
    if (auto finished = FinishMeshIfAny(content.file, std::move(mesh))) {
      tile.meshes.push_back(std::move(*finished));
    } else {
      ++tile.num_without_area;
    }
  }
  return tile;
}

// Says which tiles do not show; empty where all do.
std::string LeftOut(const LoadedTile& sum) {
  std::string text;
  if (sum.num_clouds > 0) {
    text = fmt::format("{} tiles of points (pnts) are not read", sum.num_clouds);
  }
  if (sum.num_without_area > 0) {
    text += fmt::format("{}{} tiles are left out, as none of their triangles has an area",
                        text.empty() ? "" : "; ", sum.num_without_area);
  }
  return text;
}

// Shortens the list of warnings: thousands of tiles have thousands of small faults of one kind.
void Shorten(std::vector<std::string>& warnings) {
  constexpr size_t kMost = 5;
  if (warnings.size() <= kMost) return;
  const size_t num_left_out = warnings.size() - kMost;
  warnings.resize(kMost);
  warnings.push_back(fmt::format("and {} more such messages about tiles", num_left_out));
}

}  // namespace

bool IsEarthCentered(const path& file) {
  if (MeshKindOf(file) != MeshKind::kTileset) return false;
  const auto center = CenterOfTileset(file);
  return center && PlaceOnEarth(*center);
}

TriangleMesh ReadTileset(const path& file, const MeshReadOptions& options) {
  const Tileset tileset = ListTiles(file, options.tiles.max_error);
  TileFrame frame(file, tileset.center, options.tiles.world);
  std::vector<LoadedTile> tiles(tileset.contents.size());
  ParallelFor(tiles.size(), options.threads,
              [&](size_t i) { tiles[i] = Load(tileset.contents[i], frame); });
  std::vector<TriangleMesh> meshes;
  LoadedTile sum;
  for (LoadedTile& tile : tiles) {
    sum.num_clouds += tile.num_clouds;
    sum.num_without_area += tile.num_without_area;
    for (TriangleMesh& mesh : tile.meshes) meshes.push_back(std::move(mesh));
  }
  const std::string left_out = LeftOut(sum);
  if (meshes.empty()) {
    throw InputError(file, "expected tiles with triangles, found none" +
                               (left_out.empty() ? "" : "; " + left_out));
  }
  TriangleMesh mesh =
      meshes.size() == 1 ? std::move(meshes.front()) : MergeMeshes(std::move(meshes));
  if (options.tiles.world) mesh.crs = options.tiles.world->text;
  Shorten(mesh.warnings);
  if (!left_out.empty()) mesh.warnings.push_back(fmt::format("{}: {}", file.string(), left_out));
  mesh.warnings.insert(mesh.warnings.begin(), frame.notes().begin(), frame.notes().end());
  return mesh;
}

}  // namespace raylift
