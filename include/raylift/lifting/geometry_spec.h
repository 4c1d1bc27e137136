// Opens geometry sources by specification: "mesh:scene.ply", "dsm:town.tif", "cloud:scan.las",
// "splat:point_cloud.ply", "depth:maps,kind=ray", "sfm".

#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/LU>

#include "raylift/geometry/rigid3.h"
#include "raylift/lifting/depth_source.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/photographs.h"

namespace raylift {

enum class GeometryKind { kMesh, kCloud, kSplats, kDepth, kSfm };

// The similarity that puts a mesh, point cloud or splats into the world of the references, for
// those in another unit, with other axes or about another origin:
//
//   point_in_world = scale * axes * point_in_mesh + shift
struct MeshPlacement {
  double scale = 1;
  // An orthogonal matrix; its determinant is -1 for a mirror.
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
  Eigen::Vector3d shift = Eigen::Vector3d::Zero();

  bool IsIdentity() const;
  bool IsMirror() const { return axes.determinant() < 0; }
  Eigen::Vector3d operator*(const Eigen::Vector3d& point_in_mesh) const {
    return scale * (axes * point_in_mesh) + shift;
  }
};

// The reading of a scene's input: what the numbers of the depth maps and of the poses are taken to
// mean.
struct DataConvention {
  DepthKind kind = DepthKind::kZ;
  MapOrientation orientation = MapOrientation::kAsStored;
  double first_sample_px = 0.5;  // see DepthSamplingOptions
  double scale = 1;              // see DepthConvention
  PoseConvention poses = PoseConvention::kCamFromWorld;

  bool operator==(const DataConvention&) const = default;
};

struct NamedGeometry {
  GeometryKind kind = GeometryKind::kMesh;
  std::shared_ptr<const GeometrySource> source;
  std::shared_ptr<const RayCaster> mesh;              // of a mesh source; else null
  std::shared_ptr<const DepthFolder> maps = nullptr;  // of depth maps; else null
  std::shared_ptr<const RayCaster> cloud = nullptr;   // of a point cloud or splats; else null
  // The reading of the files, as text ("PNG uint16 640 x 480, z").
  std::string interpretation = {};
  std::vector<std::string> warnings;  // what the user should know of the files
  std::optional<DataConvention> depth_convention = std::nullopt;  // of depth maps
  MeshPlacement placement = {};  // of a mesh, cloud or splats, by its specification

  // Returns what can be rendered: the mesh, cloud or splats; null where there is none.
  std::shared_ptr<const RayCaster> Surface() const { return mesh != nullptr ? mesh : cloud; }

  // Returns an image's depth: a stored map at its own size, or that of a surface at the image's
  // size; nullopt where there is no map of the image. To be called only for geometry that has a
  // surface or maps.
  std::optional<DepthMap> MapOf(const PosedImage& image) const;
};

// Further input for opening a specification.
struct GeometryContext {
  std::filesystem::path model = {};             // the references' COLMAP model
  std::span<const PosedImage> references = {};  // that will be lifted from
  // Names of references that are not in use; the points of an SfM model are taken without them.
  std::span<const std::string> thinned_out = {};
  size_t max_cache_bytes = size_t{1} << 29;  // of depth maps that are kept in memory
  int threads = 0;                           // to read a mesh; <= 0: all
};

// Returns the specification that the path of a file alone stands for, by its extension: scene.obj
// stands for mesh:scene.obj. Other texts stay as they are.
std::string GeometrySpecOf(const std::string& text);

// Opens "mesh:PATH[,key=value...]", "dsm:FILE[,key=value...]", "cloud:PATH[,key=value...]",
// "splat:FILE[,key=value...]", "depth:PATH[,key=value...]" or "sfm[:DIR][,key=value...]" (by
// default the references' own model), or a path that GeometrySpecOf() takes; GeometryHelp() lists
// the keys. Throws OptionError for an unknown kind, key or value, InputError where a file cannot be
// read.
NamedGeometry MakeGeometrySource(const std::string& spec, const GeometryContext& context = {});

// Returns the forms of a specification and their keys, for help texts.
std::string GeometryHelp();

}  // namespace raylift
