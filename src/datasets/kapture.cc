
#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <utility>

#include "base/read_limits.h"
#include "datasets/importers.h"
#include "io/scene/trajectory_file.h"
#include "io/text/line_tokens.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using std::filesystem::path;

// Parses qw, qx, qy, qz, tx, ty, tz from a field on; nullopt where one is empty, which means
// unknown.
std::optional<Rigid3> ParsePose(const LineReader& lines,
                                const std::vector<std::string_view>& fields, size_t first) {
  std::array<double, 7> numbers{};
  for (size_t i = 0; i < 7; ++i) {
    if (fields[first + i].empty()) return std::nullopt;
    const auto number = ParseDouble(fields[first + i]);
    if (!number)
      lines.Fail(fmt::format("pose: expected a number, found \"{}\"", fields[first + i]));
    if (!std::isfinite(*number)) return std::nullopt;
    numbers[i] = *number;
  }
  const auto rotation = UnitQuaternion({numbers[0], numbers[1], numbers[2], numbers[3]});
  if (!rotation) lines.Fail("pose: expected a quaternion of length 1");
  return Rigid3{*rotation, {numbers[4], numbers[5], numbers[6]}};
}

// The two formats, which differ in names, headers and poses.
enum class Form { kKapture, kCapture };

// Reads the comma-separated fields of each line.
class CsvReader {
 public:
  CsvReader(const path& file, Form form) : lines_(file), form_(form) {
    if (form == Form::kCapture) return;
    const auto header = lines_.Next();
    if (!header || !header->starts_with("# kapture format: 1.")) {
      lines_.Fail("expected \"# kapture format: 1.x\"");
    }
  }

  // Returns the next line of at least `count` fields; nullopt at the end.
  std::optional<std::vector<std::string_view>> Next(size_t count) {
    const auto line = lines_.NextContent();
    if (!line) return std::nullopt;
    auto fields = SplitBy(*line, ',');
    if (fields.size() < count) {
      lines_.Fail(fmt::format("expected {} fields, found {}", count, fields.size()));
    }
    return fields;
  }

  // Returns the line's pose: into the device, from the world or from the rig; nullopt if it is not
  // known.
  std::optional<Rigid3> Pose(const std::vector<std::string_view>& fields, size_t first) const {
    const auto pose = ParsePose(lines_, fields, first);
    return pose && form_ == Form::kCapture ? pose->Inverse() : pose;
  }

  const LineReader& lines() const { return lines_; }

 private:
  LineReader lines_;
  Form form_;
};

// Returns the cameras by id; nullopt where the model is unknown. Other sensors are left out.
std::map<std::string, std::optional<Camera>> ReadCameras(const path& file, Form form) {
  std::map<std::string, std::optional<Camera>> cameras;
  CsvReader csv(file, form);
  while (const auto fields = csv.Next(3)) {
    if ((*fields)[2] != "camera") continue;
    if (fields->size() < 6) csv.lines().Fail("expected id, name, camera, MODEL, width, height");
    std::string text;
    for (size_t i = 3; i < fields->size(); ++i) text += std::string((*fields)[i]) + " ";
    std::optional<Camera>& camera = cameras[std::string((*fields)[0])];
    if ((*fields)[3] == "UNKNOWN_CAMERA") continue;
    camera = LineTokens(csv.lines(), text).CameraToEnd();
  }
  return cameras;
}

struct Mount {
  std::string rig;
  Rigid3 sensor_from_rig;
};

// Returns by sensor the rigs that it is part of.
std::map<std::string, std::vector<Mount>> ReadRigs(const path& file, Form form) {
  std::map<std::string, std::vector<Mount>> rigs;
  if (!std::filesystem::exists(file)) return rigs;
  CsvReader csv(file, form);
  while (const auto fields = csv.Next(9)) {
    // Sensors whose place in the rig is not known are listed, too.
    if (const auto pose = csv.Pose(*fields, 2)) {
      rigs[std::string((*fields)[1])].push_back({std::string((*fields)[0]), *pose});
    }
  }
  return rigs;
}

// Pairs of time and device.
using Keys = std::set<std::pair<uint64_t, std::string>>;

class Trajectories {
 public:
  Trajectories(const path& folder, Form form) : rigs_(ReadRigs(folder / "rigs.txt", form)) {
    path file = folder / "trajectories.txt";
    // Sessions as they were recorded have poses of their own in the usual file, and the world's
    // here.
    const path aligned = folder / "proc" / "alignment_trajectories.txt";
    if (form == Form::kCapture && std::filesystem::exists(aligned)) file = aligned;
    if (!std::filesystem::exists(file)) return;
    CsvReader csv(file, form);
    while (const auto fields = csv.Next(9)) {
      const uint64_t timestamp = csv.lines().Uint((*fields)[0], "timestamp");
      if (const auto pose = csv.Pose(*fields, 2)) {
        poses_[{timestamp, std::string((*fields)[1])}] = *pose;
      }
    }
  }

  // Returns a sensor's own pose, else that by a rig that holds it, which another rig may hold in
  // turn.
  std::optional<Rigid3> Find(uint64_t timestamp, const std::string& device, int depth = 0) const {
    const auto own = poses_.find({timestamp, device});
    if (own != poses_.end()) return own->second;
    const auto mounts = rigs_.find(device);
    if (mounts == rigs_.end() || depth == kMaxRigNesting) return std::nullopt;
    for (const Mount& mount : mounts->second) {
      if (const auto rig_from_world = Find(timestamp, mount.rig, depth + 1)) {
        return mount.sensor_from_rig * *rig_from_world;
      }
    }
    return std::nullopt;
  }

  // Returns whether keys hold a device or a rig that it is part of.
  bool Names(const Keys& keys, uint64_t timestamp, const std::string& device) const {
    if (keys.contains({timestamp, device})) return true;
    const auto mounts = rigs_.find(device);
    return mounts != rigs_.end() &&
           std::any_of(mounts->second.begin(), mounts->second.end(), [&](const Mount& mount) {
             return keys.contains({timestamp, mount.rig});
           });
  }

 private:
  std::map<std::string, std::vector<Mount>> rigs_;
  std::map<std::pair<uint64_t, std::string>, Rigid3> poses_;  // by time and device
};

// Returns all records of cameras whose device or one of its rigs is `wanted` at that time.
std::vector<KaptureImage> ReadImages(const path& folder, const path& records, Form form,
                                     const Keys* wanted) {
  const auto cameras = ReadCameras(folder / "sensors.txt", form);
  const Trajectories trajectories(folder, form);
  std::vector<KaptureImage> images;
  CsvReader csv(records, form);
  while (const auto fields = csv.Next(3)) {
    const std::string device((*fields)[1]);
    const auto camera = cameras.find(device);
    if (camera == cameras.end()) {
      csv.lines().Fail(fmt::format("sensors.txt holds no camera \"{}\"", device));
    }
    const uint64_t timestamp = csv.lines().Uint((*fields)[0], "timestamp");
    if (wanted != nullptr && !trajectories.Names(*wanted, timestamp, device)) continue;
    KaptureImage& image = images.emplace_back();
    image.timestamp = timestamp;
    image.name = (*fields)[2];
    image.camera = camera->second;
    image.cam_from_world = trajectories.Find(timestamp, device);
  }
  std::sort(images.begin(), images.end(),
            [](const KaptureImage& a, const KaptureImage& b) { return a.name < b.name; });
  return images;
}

Keys ReadKeys(const path& file) {
  Keys keys;
  CsvReader csv(file, Form::kCapture);
  while (const auto fields = csv.Next(2)) {
    keys.insert({csv.lines().Uint((*fields)[0], "timestamp"), std::string((*fields)[1])});
  }
  return keys;
}

}  // namespace

std::vector<KaptureImage> ReadKapture(const path& folder) {
  const path sensors = folder / "sensors";
  return ReadImages(sensors, sensors / "records_camera.txt", Form::kKapture, nullptr);
}

std::vector<KaptureImage> ReadCaptureSession(const path& session, const path& keys) {
  const std::optional<Keys> wanted = keys.empty() ? std::nullopt : std::optional(ReadKeys(keys));
  return ReadImages(session, session / "images.txt", Form::kCapture, wanted ? &*wanted : nullptr);
}

std::map<std::string, double> TimesOf(std::span<const KaptureImage> images) {
  uint64_t latest = 0;
  for (const KaptureImage& image : images) latest = std::max(latest, image.timestamp);
  const double seconds = SecondsPerTick(static_cast<double>(latest));
  std::map<std::string, double> times;
  for (const KaptureImage& image : images) {
    times.emplace(image.name, seconds * static_cast<double>(image.timestamp));
  }
  return times;
}

// Gangnam Station (Lee et al., CVPR 2021), a kapture data set: the folder `release` of a floor
// holds mapping, validation and test. Poses of the test photographs are not public.

namespace {

// Adds the images whose cameras and poses are known.
void AddReferences(std::span<const KaptureImage> images, Skipped& skipped, ImportedScene& scene) {
  for (const KaptureImage& image : images) {
    if (!image.camera) {
      skipped.Add("the model of its camera is unknown", image.name);
    } else if (!image.cam_from_world) {
      skipped.Add("it has no pose", image.name);
    } else {
      scene.references.push_back({image.name, *image.camera, *image.cam_from_world});
    }
  }
}

// Adds the images whose cameras are known, with the poses that are.
void AddQueries(std::span<const KaptureImage> images, Skipped& skipped, ImportedScene& scene) {
  for (const KaptureImage& image : images) {
    if (!image.camera) {
      skipped.Add("the model of its camera is unknown", image.name);
      continue;
    }
    scene.queries.push_back({image.name, *image.camera});
    if (image.cam_from_world) {
      scene.ground_truth.push_back({image.name, *image.cam_from_world});
    }
  }
}

// Takes the camera that replaces all others, where one is given.
void TakeGivenCamera(const ImportOptions& options, std::vector<KaptureImage>& images) {
  if (!options.camera) return;
  for (KaptureImage& image : images) image.camera = options.camera;
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
  for (const auto& [part, add] : {std::pair(mapping, &AddReferences), {queries, &AddQueries}}) {
    std::vector<KaptureImage> images = ReadKapture(part);
    TakeGivenCamera(options, images);
    add(images, skipped, scene);
    scene.times.merge(TimesOf(images));
  }
  NotePublicPoses(scene);
  skipped.AddWarnings(scene.warnings);
  RequireImages(folder, scene);
  scene.thresholds = "gangnam";
  return {std::move(scene)};
}

// LaMAR (Sarlin et al., ECCV 2022) and CroCoDL: a location's folder in the capture format
// (github.com/microsoft/lamar-benchmark, CAPTURE.md). The session `map` holds the references, each
// session whose name begins with `query` is a scene's queries; poses of test queries are not
// public. A session's queries.txt (or proc/queries.txt) says which of its images, or rigs, are
// localized.

namespace {

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

// Returns the name of an image below the folder of all sessions.
std::string NameBelowSessions(const std::string& session, const KaptureImage& image) {
  return session + "/raw_data/" + image.name;
}

// Returns the images of a session with a camera and a photograph.
std::vector<KaptureImage> ReadSession(const path& sessions, const std::string& session,
                                      const path& keys, const ImportOptions& options,
                                      Skipped& skipped) {
  std::vector<KaptureImage> images;
  std::vector<KaptureImage> read = ReadCaptureSession(sessions / session, keys);
  TakeGivenCamera(options, read);
  for (KaptureImage& image : read) {
    image.name = NameBelowSessions(session, image);
    if (!image.camera) {
      skipped.Add("the model of its camera is unknown", image.name);
    } else if (skipped.HasPhotograph(sessions, image.name)) {
      images.push_back(std::move(image));
    }
  }
  return images;
}

void TakeTime(const KaptureImage& image, ImportedScene& scene) {
  scene.times.emplace(image.name, kSecondsPerTick * static_cast<double>(image.timestamp));
}

void TakeReferences(const std::vector<KaptureImage>& images, ImportedScene& scene) {
  Skipped skipped;
  AddReferences(images, skipped, scene);
  for (const KaptureImage& image : images) {
    if (image.cam_from_world) TakeTime(image, scene);
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
  const auto images = ReadSession(sessions, session, keys, options, skipped);
  AddQueries(images, skipped, scene);
  for (const KaptureImage& image : images) TakeTime(image, scene);
  skipped.AddWarnings(scene.warnings);
  scene.notes.push_back(keys.empty() ? "all images of the session are queries"
                                     : "the queries are those of " + keys.string());
  NotePublicPoses(scene);
}

// Takes the meshes of the map, where it was scanned.
void TakeMeshes(const path& map, ImportedScene& scene) {
  const path meshes = map / "proc" / "meshes";
  if (!std::filesystem::is_directory(meshes)) {
    scene.notes.push_back("the map has no mesh (proc/meshes): its geometry is to be given");
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
