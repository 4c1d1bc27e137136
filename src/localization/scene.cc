#include "raylift/localization/scene.h"

#include <algorithm>
#include <string_view>
#include <utility>

#include "io/map/packed_map.h"
#include "localization/retrieval/covisibility.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/scene_file.h"
#include "raylift/localization/scene_calibration.h"
#include "raylift/views/rendered_references.h"

namespace raylift {

namespace {

template <typename T>
void Append(std::vector<T>& all, std::vector<T> more) {
  all.insert(all.end(), std::make_move_iterator(more.begin()), std::make_move_iterator(more.end()));
}

void LoadModel(Scene& scene, const std::filesystem::path& model, const Subsampling& subsampling) {
  LoadedReferences loaded = LoadReferences(model, subsampling, scene.model_poses);
  scene.references = std::move(loaded.references);
  scene.covisibility = std::move(loaded.covisibility);
  Append(scene.warnings, std::move(loaded.warnings));
}

}  // namespace

void Scene::AddGeometry(std::shared_ptr<const GeometrySource> source,
                        std::shared_ptr<const RayCaster> mesh, GeometryKind kind) {
  RAYLIFT_CHECK(source != nullptr);
  SceneSource added;
  added.geometry.kind = kind;
  added.geometry.mesh = std::move(mesh);
  added.spec = added.name = source->Description();
  added.geometry.interpretation = "from memory";
  added.geometry.source = std::move(source);
  sources.push_back(std::move(added));
}

std::shared_ptr<const RayCaster> Scene::Mesh() const {
  for (const SceneSource& source : sources) {
    if (source.geometry.mesh != nullptr) return source.geometry.mesh;
  }
  return nullptr;
}

std::shared_ptr<const RayCaster> Scene::Surface() const {
  for (const SceneSource& source : sources) {
    if (const auto surface = source.geometry.Surface()) return surface;
  }
  return nullptr;
}

std::vector<std::shared_ptr<const GeometrySource>> Scene::Geometry() const {
  std::vector<std::shared_ptr<const GeometrySource>> geometry;
  for (const SceneSource& source : sources) geometry.push_back(source.geometry.source);
  return geometry;
}

void OpenGeometry(Scene& scene, const std::string& spec, const SceneOptions& options) {
  SceneSource opened;
  opened.spec = opened.name = spec;
  opened.geometry = MakeGeometrySource(spec, {.model = scene.references.model,
                                              .references = scene.references.images,
                                              .thinned_out = scene.references.thinned_out,
                                              .max_cache_bytes = options.max_cache_bytes,
                                              .threads = options.threads});
  if (options.wrap_source) {
    opened.geometry.source = options.wrap_source(std::move(opened.geometry.source));
  }
  Append(scene.warnings, opened.geometry.warnings);
  scene.sources.push_back(std::move(opened));
}

namespace {

// Takes what a packed map knows of its depth, where that is the geometry.
Scene WithPackedCalibration(Scene scene) {
  const auto& map = scene.references.map;
  if (scene.sources.size() != 1 || map == nullptr) return scene;
  constexpr std::string_view kDepth = "depth:";
  const std::string& spec = scene.sources.front().spec;
  if (!spec.starts_with(kDepth)) return scene;
  const std::filesystem::path maps = spec.substr(kDepth.size(), spec.find(',') - kDepth.size());
  if (std::error_code none; !std::filesystem::equivalent(maps, map->file(), none)) return scene;
  const std::string text = map->ReadCalibration();
  if (text.empty()) return scene;
  return Calibrated(scene, std::make_shared<const SceneCalibration>(ParseSceneCalibration(text)));
}

}  // namespace

Scene OpenScene(const SceneOptions& options) {
  Scene scene;
  scene.model_poses = options.model_poses;
  scene.images = options.images;
  LoadModel(scene, options.model, options.subsampling);
  for (const std::string& spec : options.geometry) OpenGeometry(scene, spec, options);
  return WithPackedCalibration(std::move(scene));
}

SceneOptions SceneOptionsOf(const SceneFile& file, std::span<const std::string> geometries) {
  SceneOptions options;
  options.model = file.references;
  options.images = file.images;
  for (const std::string& name : geometries) {
    const auto named = std::find_if(file.geometries.begin(), file.geometries.end(),
                                    [&](const SceneGeometry& g) { return g.name == name; });
    if (named == file.geometries.end()) {
      throw InputError(fmt::format("the scene {} has no geometry {}", file.name, name));
    }
    options.geometry.push_back(named->spec);
  }
  if (geometries.empty() && !file.geometries.empty()) {
    options.geometry = {file.geometries.front().spec};
  }
  return options;
}

Scene OpenMeshScene(const std::string& mesh_spec, const Subsampling& subsampling,
                    const RenderedReferenceOptions& rendered, const RenderHooks& hooks) {
  Scene scene;
  OpenGeometry(scene, mesh_spec, {.threads = rendered.threads});
  const auto mesh = scene.Mesh();
  if (mesh == nullptr) throw OptionError("geometry", mesh_spec, "expected mesh:PATH or dsm:FILE");
  scene.rendered =
      std::make_shared<const RenderedReferences>(RenderReferences(mesh, rendered, hooks));
  scene.images = scene.rendered->images;
  Append(scene.warnings, scene.rendered->warnings);
  LoadModel(scene, scene.rendered->model, subsampling);
  return scene;
}

namespace {

std::vector<size_t> Keep(const std::filesystem::path& model, const std::vector<PosedImage>& images,
                         const Subsampling& subsampling) {
  std::vector<std::string> cameras;
  cameras.reserve(images.size());
  for (const PosedImage& image : images) cameras.push_back(image.camera.ToString());
  std::vector<size_t> kept = KeptIndices(cameras, subsampling);
  const auto fail = [&](std::string_view what) {
    throw InputError(model, fmt::format("{} of {} images by every {}, offset {}", what,
                                        images.size(), subsampling.every, subsampling.offset));
  };
  if (kept.empty()) fail("none is left");
  if (subsampling.per_camera && !subsampling.KeepsAll() && kept.size() == images.size() &&
      images.size() > 1) {
    fail("each has a camera of its own, which leaves all");
  }
  return kept;
}

}  // namespace

LoadedReferences LoadReferences(const std::filesystem::path& model, const Subsampling& subsampling,
                                PoseConvention poses) {
  LoadedReferences loaded;
  loaded.references.model = model;
  loaded.references.map = OpenPackedMap(model);
  std::vector<PosedImage> images;
  if (const auto& map = loaded.references.map) {
    images = map->references();
  } else {
    ColmapModel colmap = ReadColmapModel(model);
    loaded.warnings = std::move(colmap.warnings);
    loaded.covisibility = std::make_shared<const Covisibility>(colmap);
    images = colmap.PosedImages();
  }
  for (PosedImage& image : images) image.cam_from_world = CamFromWorld(image.cam_from_world, poses);
  if (images.empty()) {
    throw InputError(model, "the model has no images with a pose");
  }
  size_t next = 0;
  for (const size_t kept : Keep(model, images, subsampling)) {
    for (; next < kept; ++next) loaded.references.thinned_out.push_back(images[next].name);
    loaded.references.images.push_back(images[next++]);
  }
  for (; next < images.size(); ++next) loaded.references.thinned_out.push_back(images[next].name);
  return loaded;
}

std::vector<Query> QueriesOf(const ReferenceSet& references) {
  std::vector<Query> queries;
  queries.reserve(references.images.size());
  for (const PosedImage& image : references.images) queries.push_back({image.name, image.camera});
  return queries;
}

std::vector<std::string> NamesOf(std::span<const PosedImage> images) {
  std::vector<std::string> names;
  names.reserve(images.size());
  for (const PosedImage& image : images) names.push_back(image.name);
  return names;
}

std::vector<std::string> NamesOf(std::span<const Query> queries) {
  std::vector<std::string> names;
  names.reserve(queries.size());
  for (const Query& query : queries) names.push_back(query.name);
  return names;
}

std::map<std::string, Rigid3> PosesOf(const ReferenceSet& references) {
  std::map<std::string, Rigid3> poses;
  for (const PosedImage& image : references.images) poses.emplace(image.name, image.cam_from_world);
  return poses;
}

}  // namespace raylift
