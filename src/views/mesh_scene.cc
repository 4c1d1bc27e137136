#include "views/mesh_scene.h"

#include <optional>
#include <utility>

#include "base/lap_clock.h"
#include "lifting/mesh_spec.h"
#include "views/surface_labels.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

using BuildQuality = RayCasterOptions::BuildQuality;

struct SceneSpec {
  std::vector<MeshSpec> parts;
  std::optional<BuildQuality> build;
};

// Parses specifications; several meshes are one scene, which is built in one way.
SceneSpec ParseSpecs(const std::vector<std::string>& specs) {
  SceneSpec scene;
  for (const std::string& spec : specs) {
    MeshSpec mesh = ParseMeshSpec(spec, MeshUse::kRender);
    if (scene.build && mesh.build && scene.build != mesh.build) {
      throw OptionError("geometry", spec,
                        fmt::format("all meshes are one scene, but another one says build={}",
                                    ToString(*scene.build)));
    }
    if (mesh.build) scene.build = mesh.build;
    scene.parts.push_back(std::move(mesh));
  }
  return scene;
}

template <typename T>
size_t BytesOf(const std::vector<T>& values) {
  return values.size() * sizeof(T);
}

size_t BytesOf(const TriangleMesh& mesh) {
  size_t bytes = BytesOf(mesh.vertices) + BytesOf(mesh.triangles) +
                 BytesOf(mesh.vertex_colors_rgb) + BytesOf(mesh.texture_coordinates) +
                 BytesOf(mesh.triangle_textures) + BytesOf(mesh.triangle_faces) +
                 BytesOf(mesh.triangle_labels);
  for (const Image& texture : mesh.textures) bytes += texture.data.size();
  return bytes;
}

// Loads a scene that is not of triangles, as `open` makes it.
template <typename Spec, typename Open>
MeshScene LoadAlone(const Spec& spec, const std::function<void(const std::string&)>& on_step,
                    const Open& open) {
  RayCasterOptions build;
  build.build_quality = spec.build.value_or(BuildQuality::kMedium);
  LapClock clock;
  on_step("reading and placing points: " + spec.files);
  MeshScene scene;
  scene.caster = open(spec, build);
  const auto take = [&scene](const auto& points) {
    scene.warnings = points.warnings;
    scene.mesh_bytes = points.MemoryBytes();
  };
  if (const Surfels* surfels = scene.caster->surfels()) take(*surfels);
  if (const Splats* splats = scene.caster->splats()) take(*splats);
  scene.tree_bytes = scene.caster->MemoryBytes();
  scene.read_s = clock.Lap();
  return scene;
}

}  // namespace

MeshScene LoadMeshScene(const std::vector<std::string>& specs, const MeshSceneOptions& options) {
  RAYLIFT_CHECK(!specs.empty());
  const auto on_step = [&options](const std::string& step) {
    if (options.on_step) options.on_step(step);
  };
  for (const std::string& spec : specs) {
    const SurfaceKind kind = SurfaceKindOf(spec);
    if (kind == SurfaceKind::kMesh) continue;
    if (specs.size() > 1) {
      throw OptionError("geometry", spec,
                        kind == SurfaceKind::kCloud
                            ? "a point cloud is rendered alone; cloud:a.ply+b.ply are one cloud"
                            : "splats are rendered alone");
    }
    if (kind == SurfaceKind::kSplats) {
      return LoadAlone(
          ParseSplatSpec(spec, MeshUse::kRender), on_step,
          [](const auto& splats, const auto& build) { return OpenSplats(splats, build).caster; });
    }
    return LoadAlone(ParseCloudSpec(spec, MeshUse::kRender), on_step,
                     [&options](const auto& cloud, const auto& build) {
                       return OpenCloud(cloud, options.threads, build);
                     });
  }
  const SceneSpec parsed = ParseSpecs(specs);
  std::vector<SemanticRule> rules;
  if (!options.semantics.empty()) rules = ReadSemanticRules(options.semantics);
  RayCasterOptions build;
  build.build_quality = parsed.build.value_or(BuildQuality::kMedium);
  std::vector<std::pair<std::filesystem::path, const MeshSpec*>> files;
  for (const MeshSpec& part : parsed.parts) {
    for (std::filesystem::path& file : FilesOf(part)) files.emplace_back(std::move(file), &part);
  }
  if (files.size() > 1) {
    for (const auto& [file, part] : files) RequireWorld(file, part->tiles);
  }
  LapClock clock;
  std::vector<TriangleMesh> meshes;
  for (const auto& [file, part] : files) {
    on_step(
        fmt::format("reading mesh {} of {}: {}", meshes.size() + 1, files.size(), file.string()));
    meshes.push_back(OpenMesh(*part, file, options.threads));
  }
  auto mesh = std::make_shared<TriangleMesh>(meshes.size() == 1 ? std::move(meshes.front())
                                                                : MergeMeshes(std::move(meshes)));
  for (std::string& warning : AssignSemantics(rules, *mesh)) {
    mesh->warnings.push_back(std::move(warning));
  }
  const double read_s = clock.Lap();
  build.on_build_progress = [&on_step](double share) {
    on_step(fmt::format("building the acceleration structure: {:.0f} %", 100 * share));
  };
  MeshScene scene;
  scene.warnings = mesh->warnings;
  scene.mesh_bytes = BytesOf(*mesh);
  scene.caster = std::make_shared<const RayCaster>(std::move(mesh), build);
  scene.tree_bytes = scene.caster->MemoryBytes();
  scene.read_s = read_s;
  scene.build_s = clock.Lap();
  return scene;
}

}  // namespace raylift
