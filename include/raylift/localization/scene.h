// A scene in which queries are localized: references with known poses, and the geometry that lifts
// their keypoints. A scene is opened from a COLMAP model, from a scene file or from a mesh alone,
// or filled by hand:
//
//   Scene scene = OpenScene({.model = "sfm", .images = "photos", .geometry = {"mesh:a.ply"}});
//
//   Scene scene;
//   scene.references.images = {{"left.jpg", camera, cam_from_world}, ...};
//   scene.AddGeometry(std::make_shared<MeshSource>("room", caster), caster);
//
// All that is large is shared and const: copies are cheap, and a copy with other geometry leaves
// the first one as it is.

#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/geometry/rigid3.h"
#include "raylift/lifting/depth_alignment.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/scene/photographs.h"

namespace raylift {

class Covisibility;
class PackedMap;
class RayCaster;
struct RenderHooks;
struct SceneCalibration;
struct RenderedReferenceOptions;
struct RenderedReferences;
struct SceneFile;

// The references in use, and the names of those that exist but were dropped by subsampling; a
// retrieval list may name these.
struct ReferenceSet {
  std::filesystem::path model;  // for messages
  std::vector<PosedImage> images;
  std::vector<std::string> thinned_out;
  // The packed map that the references are from; else null.
  std::shared_ptr<const PackedMap> map = nullptr;
};

struct LoadedReferences {
  ReferenceSet references;
  std::shared_ptr<const Covisibility> covisibility;
  std::vector<std::string> warnings;
};

// Reads the images of a COLMAP model whose poses may be in another convention, and subsamples them.
// Cameras of equal parameters count as one. Throws InputError where no image is left, or where
// subsampling per camera drops none as each image has a camera of its own.
LoadedReferences LoadReferences(const std::filesystem::path& model,
                                const Subsampling& subsampling = {},
                                PoseConvention poses = PoseConvention::kCamFromWorld);

// Returns the references as queries, to be localized by the others: every matcher leaves out the
// reference of the query's name.
std::vector<Query> QueriesOf(const ReferenceSet& references);
std::map<std::string, Rigid3> PosesOf(const ReferenceSet& references);

// Return the names in the order of the list.
std::vector<std::string> NamesOf(std::span<const PosedImage> images);
std::vector<std::string> NamesOf(std::span<const Query> queries);

// A source of geometry of a scene.
struct SceneSource {
  NamedGeometry geometry;
  std::string spec;  // as in the option --geometry; of a source from memory its description
  std::string name;  // what tables call it: the specification, unless someone named it
  // The correction of its depth; geometry.source then gives the corrected points, and `as_read` is
  // the uncorrected source.
  std::optional<DepthAlignment> alignment = std::nullopt;
  std::shared_ptr<const GeometrySource> as_read = nullptr;
};

struct Scene {
  ReferenceSet references;
  // The convention of the poses in the model's files; in memory they are cam_from_world.
  PoseConvention model_poses = PoseConvention::kCamFromWorld;
  std::filesystem::path images;  // folder of the references' photographs; may be empty
  // This is null where covisibility is not known.
  std::shared_ptr<const Covisibility> covisibility = nullptr;
  std::vector<SceneSource> sources;  // in the order in which they are asked
  // The rendered references, where references were rendered; else null.
  std::shared_ptr<const RenderedReferences> rendered = nullptr;
  // The calibration (scene_calibration.h); null: none.
  std::shared_ptr<const SceneCalibration> calibration = nullptr;
  std::vector<std::string> warnings;  // what the user should know of the files

  // Adds a source, named by its description. `mesh` is the mesh that it lifts from, where it does,
  // for Mesh(). The kind matters to the alignment of depth and to checks of the input: SfM points
  // are not aligned.
  void AddGeometry(std::shared_ptr<const GeometrySource> source,
                   std::shared_ptr<const RayCaster> mesh = nullptr,
                   GeometryKind kind = GeometryKind::kMesh);
  // Returns the mesh of the first source that is one; null where none is.
  std::shared_ptr<const RayCaster> Mesh() const;
  // Returns the first mesh or point cloud, for pictures and retrieval; null where there is none.
  std::shared_ptr<const RayCaster> Surface() const;
  // Returns the sources to lift by.
  std::vector<std::shared_ptr<const GeometrySource>> Geometry() const;
};

// Is called with each source as it is opened and returns the one to use in its place: for counting,
// caching.
using WrapSource = std::function<std::shared_ptr<const GeometrySource>(
    std::shared_ptr<const GeometrySource> source)>;

struct SceneOptions {
  std::filesystem::path model = {};  // COLMAP model of the references
  PoseConvention model_poses = PoseConvention::kCamFromWorld;
  Subsampling subsampling = {};
  std::filesystem::path images = {};
  std::vector<std::string> geometry = {};    // as the option --geometry takes them
  size_t max_cache_bytes = size_t{1} << 29;  // of depth maps, per source
  WrapSource wrap_source = {};
  int threads = 0;  // to read meshes; 0: all
};

// Opens a scene. Throws OptionError for a geometry's specification that is wrong, InputError where
// a file cannot be read.
Scene OpenScene(const SceneOptions& options);

// Returns the references and the geometry that a scene file names: its first geometry, or those of
// these names. Throws InputError where there is none of a name.
SceneOptions SceneOptionsOf(const SceneFile& file, std::span<const std::string> geometries = {});

// Opens a scene whose references are rendered from its one geometry, a mesh. References that
// `rendered.out` holds from before are used again.
Scene OpenMeshScene(const std::string& mesh_spec, const Subsampling& subsampling,
                    const RenderedReferenceOptions& rendered, const RenderHooks& hooks);

// Opens a specification of geometry for the scene's references; warnings go to the scene's
// warnings.
void OpenGeometry(Scene& scene, const std::string& spec, const SceneOptions& options = {});

}  // namespace raylift
