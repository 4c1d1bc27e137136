// LaMAR (Sarlin et al., ECCV 2022) and CroCoDL: a location's folder in the capture format
// (github.com/microsoft/lamar-benchmark, CAPTURE.md). The session `map` holds the references, each
// session whose name begins with `query` is a scene's queries; poses of test queries are not public.
// A session's queries.txt (or proc/queries.txt) says which of its images, or rigs, are localized.

#include <algorithm>

#include "datasets/importers.h"
#include "datasets/kapture.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr double kSecondsPerTick = 1e-6;

std::vector<std::string> QuerySessions(const path& sessions) {
  if (!std::filesystem::is_directory(sessions)) {
    throw InputError(sessions, "there is no such folder");
  }
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(sessions)) {
    const std::string name = entry.path().filename().string();
    if (entry.is_directory() && name.starts_with("query")) names.push_back(name);
  }
  if (names.empty()) throw InputError(sessions, "expected a session whose name begins with query");
  std::sort(names.begin(), names.end());
  return names;
}

// The name of an image below the folder of all sessions.
std::string NameBelowSessions(const std::string& session, const KaptureImage& image) {
  return session + "/raw_data/" + image.name;
}

// The images of a session with a camera and a photograph.
std::vector<KaptureImage> ReadSession(const path& sessions, const std::string& session,
                                      const path& keys, const ImportOptions& options,
                                      Skipped& skipped) {
  std::vector<KaptureImage> images;
  for (KaptureImage& image : ReadCaptureSession(sessions / session, keys)) {
    image.name = NameBelowSessions(session, image);
    if (options.camera) image.camera = options.camera;
    if (!image.camera) {
      skipped.Add("the model of its camera is unknown", image.name);
    } else if (!Exists(sessions / image.name)) {
      skipped.Add("the photograph is missing", image.name);
    } else {
      images.push_back(std::move(image));
    }
  }
  return images;
}

void TakeReferences(const std::vector<KaptureImage>& images, ImportedScene& scene) {
  Skipped skipped;
  for (const KaptureImage& image : images) {
    if (!image.cam_from_world) {
      skipped.Add("it has no pose", image.name);
      continue;
    }
    scene.references.push_back({image.name, *image.camera, *image.cam_from_world});
    scene.times.emplace(image.name, kSecondsPerTick * static_cast<double>(image.timestamp));
  }
  skipped.AddWarnings(scene.warnings);
}

void TakeQueries(const path& sessions, const std::string& session, const ImportOptions& options,
                 ImportedScene& scene) {
  path keys;
  for (const path& file :
       {sessions / session / "queries.txt", sessions / session / "proc" / "queries.txt"}) {
    if (keys.empty() && Exists(file)) keys = file;
  }
  Skipped skipped;
  for (const KaptureImage& image : ReadSession(sessions, session, keys, options, skipped)) {
    scene.queries.push_back({image.name, *image.camera});
    scene.times.emplace(image.name, kSecondsPerTick * static_cast<double>(image.timestamp));
    if (image.cam_from_world) {
      scene.ground_truth.push_back({image.name, *image.cam_from_world});
    }
  }
  skipped.AddWarnings(scene.warnings);
  scene.notes.push_back(keys.empty() ? "all images of the session are queries"
                                     : "the queries are those of " + keys.string());
  if (scene.ground_truth.size() < scene.queries.size()) {
    scene.notes.push_back(fmt::format("poses of {} of {} queries are public",
                                      scene.ground_truth.size(), scene.queries.size()));
  }
}

// Meshes of the map, where it was scanned.
void TakeMeshes(const path& map, ImportedScene& scene) {
  const path meshes = map / "proc" / "meshes";
  if (!std::filesystem::is_directory(meshes)) {
    scene.notes.push_back("the map has no mesh (proc/meshes): give one by --geometry");
    return;
  }
  for (const std::string& file : ListFiles(meshes, ".ply")) {
    scene.geometries.push_back({path(file).stem().string(), "mesh:" + (meshes / file).string()});
  }
}

}  // namespace

ImportedScenes ImportLamar(const path& folder, const ImportOptions& options) {
  const path sessions = folder / "sessions";
  const std::vector<std::string> names = QuerySessions(sessions);
  Skipped skipped;
  const auto map = ReadSession(sessions, "map", {}, options, skipped);
  ImportedScenes scenes;
  for (const std::string& name : names) {
    ImportedScene scene = SceneOfFolder(folder);
    scene.folder = name;
    scene.name += "_" + name;
    scene.images = scene.query_images = sessions;
    skipped.AddWarnings(scene.warnings);
    TakeReferences(map, scene);
    TakeQueries(sessions, name, options, scene);
    RequireImages(folder, scene);
    TakeMeshes(sessions / "map", scene);
    scene.thresholds = "0.1,1:1,5";
    scenes.push_back(std::move(scene));
  }
  return scenes;
}

}  // namespace raylift
