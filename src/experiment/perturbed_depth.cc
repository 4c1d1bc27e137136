#include "perturbed_depth.h"

#include <optional>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/parallel.h"
#include "raylift/io/depth_file.h"
#include "raylift/renderers/frame_renderer.h"

namespace raylift {
namespace {

using std::filesystem::path;

std::optional<DepthMap> LoadMap(const NamedGeometry& geometry, const PosedImage& image) {
  if (const auto surface = geometry.Surface()) {
    return RenderDepth(*surface, image.camera, image.cam_from_world, 1);
  }
  const auto map = geometry.maps->Load(image);
  return map != nullptr ? std::optional(*map) : std::nullopt;
}

// Where "depth:FOLDER" finds it.
path FileOfImage(const path& folder, const std::string& image) {
  path file = folder;
  for (const path& part : path(image).relative_path()) {
    if (part != "..") file /= part;
  }
  return file.replace_extension("npy");
}

}  // namespace

std::string WritePerturbedDepth(const path& folder, const std::string& spec,
                                const GeometryContext& context,
                                const DepthPerturbation& perturbation, int threads) {
  const path complete = folder / "complete";
  if (!std::filesystem::exists(complete)) {
    GeometryContext opening = context;
    opening.threads = threads;
    const NamedGeometry geometry = MakeGeometrySource(spec, opening);
    if (geometry.Surface() == nullptr && geometry.maps == nullptr) {
      throw InputError("only meshes, point clouds, splats and depth maps can be perturbed, not " +
                       spec);
    }
    ParallelFor(context.references.size(), threads, [&](size_t i) {
      const PosedImage& image = context.references[i];
      if (const auto map = LoadMap(geometry, image)) {
        WriteDepthFile(FileOfImage(folder, image.name),
                       PerturbDepth(*map, perturbation, image.name));
      }
    });
    WriteFile(complete, "");
  }
  return "depth:" + folder.string() + ",unit=1";
}

}  // namespace raylift
