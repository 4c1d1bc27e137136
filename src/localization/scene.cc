#include "raylift/localization/scene.h"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/lifting/aligned_source.h"

namespace raylift {
namespace {

template <typename T>
void Append(std::vector<T>& all, std::vector<T> more) {
  all.insert(all.end(), std::make_move_iterator(more.begin()), std::make_move_iterator(more.end()));
}

void LoadModel(Scene& scene, const std::filesystem::path& model, const Thinning& thinning) {
  LoadedReferences loaded = LoadReferences(model, thinning, scene.model_poses);
  scene.references = std::move(loaded.references);
  scene.covisibility = std::make_shared<const Covisibility>(std::move(loaded.covisibility));
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
  added.geometry.understood = "from memory";
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

Scene OpenScene(const SceneOptions& options) {
  Scene scene;
  scene.model_poses = options.model_poses;
  scene.images = options.images;
  LoadModel(scene, options.model, options.thinning);
  for (const std::string& spec : options.geometry) OpenGeometry(scene, spec, options);
  return scene;
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

Scene OpenMeshScene(const std::string& mesh_spec, const Thinning& thinning,
                    const RenderedReferenceOptions& rendered, const RenderHooks& hooks) {
  Scene scene;
  OpenGeometry(scene, mesh_spec, {.threads = rendered.threads});
  const auto mesh = scene.Mesh();
  if (mesh == nullptr) throw OptionError("geometry", mesh_spec, "expected mesh:PATH");
  scene.rendered = RenderReferences(mesh, rendered, hooks);
  scene.images = scene.rendered->images;
  Append(scene.warnings, scene.rendered->warnings);
  LoadModel(scene, scene.rendered->model, thinning);
  return scene;
}

Scene Aligned(const Scene& scene, AlignMode mode, std::span<const ReferenceMatch> matches,
              int threads) {
  Scene aligned = scene;
  if (mode == AlignMode::kOff) return aligned;
  for (SceneSource& source : aligned.sources) {
    if (source.geometry.kind == GeometryKind::kSfm) continue;
    source.alignment = AlignDepth(*source.geometry.source, scene.references.images, matches,
                                  {.mode = mode}, threads);
    if (source.alignment->mode == AlignMode::kOff) continue;
    source.geometry.source = std::make_shared<const AlignedSource>(
        std::move(source.geometry.source), source.alignment->Corrections());
  }
  return aligned;
}

}  // namespace raylift
