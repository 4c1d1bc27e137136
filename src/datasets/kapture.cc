#include "datasets/kapture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <utility>

#include "base/read_limits.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/io/line_tokens.h"
#include "raylift/io/unit_quaternion.h"

namespace raylift {
namespace {

using std::filesystem::path;

// qw, qx, qy, qz, tx, ty, tz from a field on; none where one is empty, which means unknown.
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

// What tells the two formats apart.
enum class Form { kKapture, kCapture };

// The comma-separated fields of each line.
class CsvReader {
 public:
  CsvReader(const path& file, Form form) : lines_(file), form_(form) {
    if (form == Form::kCapture) return;
    const auto header = lines_.Next();
    if (!header || !header->starts_with("# kapture format: 1.")) {
      lines_.Fail("expected \"# kapture format: 1.x\"");
    }
  }

  // The next line of at least `count` fields, or none at the end.
  std::optional<std::vector<std::string_view>> Next(size_t count) {
    const auto line = lines_.NextContent();
    if (!line) return std::nullopt;
    auto fields = SplitBy(*line, ',');
    if (fields.size() < count) {
      lines_.Fail(fmt::format("expected {} fields, found {}", count, fields.size()));
    }
    return fields;
  }

  // What a pose of the line takes into the device, from the world or from the rig; none where it is
  // not known.
  std::optional<Rigid3> Pose(const std::vector<std::string_view>& fields, size_t first) const {
    const auto pose = ParsePose(lines_, fields, first);
    return pose && form_ == Form::kCapture ? pose->Inverse() : pose;
  }

  const LineReader& lines() const { return lines_; }

 private:
  LineReader lines_;
  Form form_;
};

// By id; none where the model is unknown. Other sensors are left out.
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

// By sensor: the rigs that it is part of.
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

// Times and devices.
using Keys = std::set<std::pair<uint64_t, std::string>>;

class Trajectories {
 public:
  Trajectories(const path& folder, Form form) : rigs_(ReadRigs(folder / "rigs.txt", form)) {
    path file = folder / "trajectories.txt";
    // Sessions as they were recorded have poses of their own there, and the world's here.
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

  // Of a sensor: its own, else that of a rig that holds it, which may hold that one in turn.
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

  // Whether keys hold a device or a rig that it is part of.
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

// All records of cameras whose device or one of its rigs is `wanted` at that time.
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

}  // namespace raylift
