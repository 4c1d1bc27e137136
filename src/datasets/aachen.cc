// Aachen Day-Night v1.1 (Sattler et al., CVPR 2018; Zhang et al., IJCV 2021): photographs in
// images_upright, queries/{day,night}_time_queries_with_intrinsics.txt, the COLMAP model of the
// references in 3D-models/aachen_v_1_1. The poses of the queries are not public.

#include <array>
#include <utility>

#include "datasets/importers.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/io/colmap_model.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr std::array<std::pair<std::string_view, std::string_view>, 2> kLists = {
    {{"day", "day_time_queries_with_intrinsics.txt"},
     {"night", "night_time_queries_with_intrinsics.txt"}}};

void TakeQueries(const path& folder, const ImportOptions& options, ImportedScene& scene) {
  Skipped skipped;
  for (const auto& [group, list] : kLists) {
    const path file = folder / "queries" / list;
    if (!std::filesystem::exists(file)) {
      scene.warnings.push_back(
          fmt::format("{} is missing: there are no queries of the {}", file.string(), group));
      continue;
    }
    for (Query& query : ReadQueryList(file)) {
      if (!Exists(scene.images / query.name)) {
        skipped.Add("the photograph is missing", query.name);
        continue;
      }
      if (options.camera) query.camera = *options.camera;
      scene.groups.emplace(query.name, group);
      scene.queries.push_back(std::move(query));
    }
  }
  skipped.AddWarnings(scene.warnings);
}

}  // namespace

ImportedScenes ImportAachen(const path& folder, const ImportOptions& options) {
  ImportedScene scene = SceneOfFolder(folder);
  scene.images = scene.query_images = folder / "images_upright";
  scene.reference_model = folder / "3D-models" / "aachen_v_1_1";
  if (!DetectColmapForm(scene.reference_model)) {
    throw InputError(scene.reference_model, "expected COLMAP's cameras.bin and images.bin there");
  }
  TakeQueries(folder, options, scene);
  RequireImages(folder, scene);
  scene.thresholds = "aachen";
  scene.geometries = {{"sfm", "sfm"}};
  scene.notes.emplace_back(
      "the poses of the queries are not public: hand results in at visuallocalization.net "
      "(raylift evaluate checks submissions)");
  return {std::move(scene)};
}

}  // namespace raylift
