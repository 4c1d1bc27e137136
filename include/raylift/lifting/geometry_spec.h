// Geometry sources by specification: "mesh:scene.ply", "cloud:scan.las", "splat:point_cloud.ply",
// "depth:maps,kind=ray", "sfm".

#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/lifting/depth_folder.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/lifting/input_reading.h"
#include "raylift/lifting/mesh_placement.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/photographs.h"

namespace raylift {

enum class GeometryKind { kMesh, kCloud, kSplats, kDepth, kSfm };

struct NamedGeometry {
  GeometryKind kind = GeometryKind::kMesh;
  std::shared_ptr<const GeometrySource> source;
  std::shared_ptr<const RayCaster> mesh;              // of a mesh source; else null
  std::shared_ptr<const DepthFolder> maps = nullptr;  // of depth maps; else null
  std::shared_ptr<const RayCaster> cloud = nullptr;   // of a point cloud or splats; else null
  // How the files were read ("PNG uint16 640 x 480, z").
  std::string understood = {};
  std::vector<std::string> warnings;  // what the user should know of the files
  std::optional<InputReading> depth_reading = std::nullopt;  // of depth maps
  MeshPlacement placement = {};  // of a mesh, cloud or splats, by its specification

  // What can be rendered: the mesh, cloud or splats; null where there is none of them.
  std::shared_ptr<const RayCaster> Surface() const { return mesh != nullptr ? mesh : cloud; }
};

// What a specification does not say.
struct GeometryContext {
  std::filesystem::path model = {};             // the references' COLMAP model
  std::span<const PosedImage> references = {};  // that will be lifted from
  // Names of references that are not in use: an SfM model's points are without them, too.
  std::span<const std::string> thinned_out = {};
  size_t max_cache_bytes = size_t{1} << 29;  // of depth maps that are kept in memory
  int threads = 0;                           // to read a mesh; <= 0: all
};

// Opens "mesh:PATH[,key=value...]", "cloud:PATH[,key=value...]", "splat:FILE[,key=value...]",
// "depth:DIR[,key=value...]" or "sfm[:DIR][,key=value...]" (by default the references' own model);
// GeometryHelp() lists the keys. OptionError for an unknown kind, key or value, InputError where a file cannot be read.
NamedGeometry MakeGeometrySource(const std::string& spec, const GeometryContext& context = {});

// The forms of a specification and their keys, for help texts.
std::string GeometryHelp();

}  // namespace raylift
