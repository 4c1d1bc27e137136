#include "raylift/views/mesh_scene.h"

#include <chrono>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/renderers/mesh_tiles.h"

namespace raylift {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::string_view kForm =
    "expected mesh:PATH[,build=low|medium]; only meshes are rendered";

struct MeshSpec {
  std::string files;
  RayCasterOptions::BuildQuality build = RayCasterOptions::BuildQuality::kMedium;
};

MeshSpec ParseSpec(const std::string& spec) {
  constexpr std::string_view kPrefix = "mesh:";
  if (!spec.starts_with(kPrefix)) throw OptionError("--geometry", spec, kForm);
  const auto parts = SplitBy(std::string_view(spec).substr(kPrefix.size()), ',');
  MeshSpec parsed{std::string(parts.front())};
  if (parsed.files.empty()) throw OptionError("--geometry", spec, kForm);
  for (size_t i = 1; i < parts.size(); ++i) {
    if (parts[i] == "build=low") {
      parsed.build = RayCasterOptions::BuildQuality::kLow;
    } else if (parts[i] != "build=medium") {
      throw OptionError("--geometry", spec, kForm);
    }
  }
  return parsed;
}

template <typename T>
size_t BytesOf(const std::vector<T>& values) {
  return values.size() * sizeof(T);
}

size_t BytesOf(const TriangleMesh& mesh) {
  size_t bytes = BytesOf(mesh.vertices) + BytesOf(mesh.triangles) +
                 BytesOf(mesh.vertex_colors_rgb) + BytesOf(mesh.texture_coordinates) +
                 BytesOf(mesh.triangle_textures);
  for (const Image& texture : mesh.textures) bytes += texture.data.size();
  return bytes;
}

double Seconds(Clock::duration duration) { return std::chrono::duration<double>(duration).count(); }

}  // namespace

MeshScene LoadMeshScene(const std::vector<std::string>& specs,
                        const std::function<void(const std::string&)>& on_step) {
  RAYLIFT_CHECK(!specs.empty());
  RayCasterOptions options;
  std::vector<std::filesystem::path> files;
  for (const std::string& spec : specs) {
    const MeshSpec parsed = ParseSpec(spec);
    options.build_quality = parsed.build;
    const auto listed = ListMeshFiles(parsed.files);
    files.insert(files.end(), listed.begin(), listed.end());
  }
  const auto start = Clock::now();
  std::vector<TriangleMesh> meshes;
  for (size_t i = 0; i < files.size(); ++i) {
    on_step(fmt::format("reading mesh {} of {}: {}", i + 1, files.size(), files[i].string()));
    meshes.push_back(ReadMesh(files[i]));
  }
  auto mesh = std::make_shared<const TriangleMesh>(
      meshes.size() == 1 ? std::move(meshes.front()) : MergeMeshes(std::move(meshes)));
  const auto read = Clock::now();
  options.on_build_progress = [&on_step](double share) {
    on_step(fmt::format("building the acceleration structure: {:.0f} %", 100 * share));
  };
  MeshScene scene;
  scene.warnings = mesh->warnings;
  scene.mesh_bytes = BytesOf(*mesh);
  scene.caster = std::make_shared<const RayCaster>(std::move(mesh), options);
  scene.tree_bytes = scene.caster->MemoryBytes();
  scene.read_s = Seconds(read - start);
  scene.build_s = Seconds(Clock::now() - read);
  return scene;
}

}  // namespace raylift
