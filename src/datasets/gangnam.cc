// Gangnam Station (Lee et al., CVPR 2021), a kapture data set: the folder `release` of a floor
// holds mapping, validation and test. Poses of the test photographs are not public.

#include <algorithm>

#include "datasets/importers.h"
#include "datasets/kapture.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using std::filesystem::path;

// Kapture does not say the unit: by the size of times of this century.
double SecondsPerTick(const std::vector<KaptureImage>& images) {
  uint64_t latest = 0;
  for (const KaptureImage& image : images) latest = std::max(latest, image.timestamp);
  uint64_t largest_seconds = 100'000'000'000;
  double seconds = 1;
  for (int thousandths = 0; thousandths < 3 && latest > largest_seconds; ++thousandths) {
    largest_seconds *= 1000;
    seconds *= 1e-3;
  }
  return seconds;
}

void TakeTimes(const std::vector<KaptureImage>& images, ImportedScene& scene) {
  const double seconds = SecondsPerTick(images);
  for (const KaptureImage& image : images) {
    scene.times.emplace(image.name, seconds * static_cast<double>(image.timestamp));
  }
}

void TakeReferences(const path& folder, const ImportOptions& options, Skipped& skipped,
                    ImportedScene& scene) {
  const auto images = ReadKapture(folder);
  for (const KaptureImage& image : images) {
    const auto camera = options.camera ? options.camera : image.camera;
    if (!camera) {
      skipped.Add("the model of its camera is unknown", image.name);
    } else if (!image.cam_from_world) {
      skipped.Add("it has no pose", image.name);
    } else {
      scene.references.push_back({image.name, *camera, *image.cam_from_world});
    }
  }
  TakeTimes(images, scene);
}

void TakeQueries(const path& folder, const ImportOptions& options, Skipped& skipped,
                 ImportedScene& scene) {
  const auto images = ReadKapture(folder);
  for (const KaptureImage& image : images) {
    const auto camera = options.camera ? options.camera : image.camera;
    if (!camera) {
      skipped.Add("the model of its camera is unknown", image.name);
      continue;
    }
    scene.queries.push_back({image.name, *camera});
    if (image.cam_from_world) {
      scene.ground_truth.push_back({image.name, *image.cam_from_world});
    }
  }
  TakeTimes(images, scene);
  if (scene.ground_truth.size() < scene.queries.size()) {
    scene.notes.push_back(fmt::format("poses of {} of {} queries are public",
                                      scene.ground_truth.size(), scene.queries.size()));
  }
}

}  // namespace

ImportedScenes ImportGangnam(const path& folder, const ImportOptions& options) {
  ImportedScene scene = SceneOfFolder(folder);
  const path release =
      std::filesystem::is_directory(folder / "release") ? folder / "release" : folder;
  const path mapping = release / "mapping", queries = release / options.split;
  for (const path& part : {mapping, queries}) {
    if (!std::filesystem::is_directory(part)) {
      throw InputError(part, "there is no such folder (the split names that of the queries)");
    }
  }
  scene.images = mapping / "sensors" / "records_data";
  scene.query_images = queries / "sensors" / "records_data";
  Skipped skipped;
  TakeReferences(mapping, options, skipped, scene);
  TakeQueries(queries, options, skipped, scene);
  skipped.AddWarnings(scene.warnings);
  RequireImages(folder, scene);
  scene.thresholds = "gangnam";
  return {std::move(scene)};
}

}  // namespace raylift
