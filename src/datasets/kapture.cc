#include "datasets/kapture.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/io/line_tokens.h"
#include "raylift/io/unit_quaternion.h"

namespace raylift {
namespace {

using std::filesystem::path;

// The comma-separated fields of each line.
class CsvReader {
 public:
  explicit CsvReader(const path& file) : lines_(file) {
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

  const LineReader& lines() const { return lines_; }

 private:
  LineReader lines_;
};

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

// By id; none where the model is unknown. Other sensors are left out.
std::map<std::string, std::optional<Camera>> ReadCameras(const path& file) {
  std::map<std::string, std::optional<Camera>> cameras;
  CsvReader csv(file);
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
std::map<std::string, std::vector<Mount>> ReadRigs(const path& file) {
  std::map<std::string, std::vector<Mount>> rigs;
  if (!std::filesystem::exists(file)) return rigs;
  CsvReader csv(file);
  while (const auto fields = csv.Next(9)) {
    // Sensors whose place in the rig is not known are listed, too.
    if (const auto pose = ParsePose(csv.lines(), *fields, 2)) {
      rigs[std::string((*fields)[1])].push_back({std::string((*fields)[0]), *pose});
    }
  }
  return rigs;
}

class Trajectories {
 public:
  explicit Trajectories(const path& folder) : rigs_(ReadRigs(folder / "rigs.txt")) {
    const path file = folder / "trajectories.txt";
    if (!std::filesystem::exists(file)) return;
    CsvReader csv(file);
    while (const auto fields = csv.Next(9)) {
      const uint64_t timestamp = csv.lines().Uint((*fields)[0], "timestamp");
      if (const auto pose = ParsePose(csv.lines(), *fields, 2)) {
        poses_[{timestamp, std::string((*fields)[1])}] = *pose;
      }
    }
  }

  // Of a sensor: its own, else that of a rig that holds it, which may hold that one in turn.
  std::optional<Rigid3> Find(uint64_t timestamp, const std::string& device, int depth = 0) const {
    constexpr int kMaxDepth = 3;
    const auto own = poses_.find({timestamp, device});
    if (own != poses_.end()) return own->second;
    const auto mounts = rigs_.find(device);
    if (mounts == rigs_.end() || depth == kMaxDepth) return std::nullopt;
    for (const Mount& mount : mounts->second) {
      if (const auto rig_from_world = Find(timestamp, mount.rig, depth + 1)) {
        return mount.sensor_from_rig * *rig_from_world;
      }
    }
    return std::nullopt;
  }

 private:
  std::map<std::string, std::vector<Mount>> rigs_;
  std::map<std::pair<uint64_t, std::string>, Rigid3> poses_;  // by time and device
};

}  // namespace

std::vector<KaptureImage> ReadKapture(const path& folder) {
  const path sensors = folder / "sensors";
  const auto cameras = ReadCameras(sensors / "sensors.txt");
  const Trajectories trajectories(sensors);
  std::vector<KaptureImage> images;
  CsvReader csv(sensors / "records_camera.txt");
  while (const auto fields = csv.Next(3)) {
    const std::string device((*fields)[1]);
    const auto camera = cameras.find(device);
    if (camera == cameras.end()) {
      csv.lines().Fail(fmt::format("sensors.txt holds no camera \"{}\"", device));
    }
    KaptureImage& image = images.emplace_back();
    image.timestamp = csv.lines().Uint((*fields)[0], "timestamp");
    image.name = (*fields)[2];
    image.camera = camera->second;
    image.cam_from_world = trajectories.Find(image.timestamp, device);
  }
  std::sort(images.begin(), images.end(),
            [](const KaptureImage& a, const KaptureImage& b) { return a.name < b.name; });
  return images;
}

}  // namespace raylift
