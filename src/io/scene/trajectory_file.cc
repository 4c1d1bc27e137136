#include "io/scene/trajectory_file.h"

#include <map>
#include <string>

#include "io/text/line_tokens.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

void AppendLine(std::span<const double> numbers, std::string& text) {
  for (const double number : numbers) {
    text += FormatDouble(number + 0.0);  // no -0
    text += ' ';
  }
  text.back() = '\n';
}

using std::filesystem::path;

// kapture has the first eleven of COLMAP's models.
bool IsOfKapture(CameraModel model) { return model <= CameraModel::kThinPrismFisheye; }

void CheckNameInCsv(const path& file, const std::string& name) {
  if (name.empty() || name.find_first_of(",\r\n") != std::string::npos || Trim(name) != name ||
      name.starts_with('#')) {
    throw InputError(file, fmt::format("the file cannot hold the name \"{}\"", name));
  }
}

}  // namespace

std::optional<double> TimeInName(const std::string& name) {
  const std::string file = name.substr(name.rfind('/') + 1);
  return ParseDouble(file.substr(0, file.rfind('.')));
}

double SecondsPerTick(double latest) {
  double largest_seconds = 1e11, seconds = 1;
  for (int thousandths = 0; thousandths < 3 && latest > largest_seconds; ++thousandths) {
    largest_seconds *= 1000;
    seconds *= 1e-3;
  }
  return seconds;
}

void WriteTumTrajectory(const std::filesystem::path& path, std::span<const TimedPose> poses) {
  std::string text = "# timestamp tx ty tz qx qy qz qw\n";
  for (const TimedPose& pose : poses) {
    const Rigid3 world_from_cam = pose.cam_from_world.Inverse();
    const Eigen::Vector3d& t = world_from_cam.translation;
    const Eigen::Quaterniond& q = world_from_cam.rotation;
    const double numbers[] = {pose.time_s, t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()};
    AppendLine(numbers, text);
  }
  WriteFile(path, text);
}

std::vector<TimedPose> ReadTumTrajectory(const std::filesystem::path& path) {
  std::vector<TimedPose> poses;
  LineReader lines(path);
  while (const auto line = lines.NextContent()) {
    LineTokens tokens(lines, *line);
    const double time_s = tokens.Double("time");
    const Eigen::Vector3d translation = tokens.Vector<3>("tx ty tz");
    const Eigen::Vector4d xyzw = tokens.Vector<4>("qx qy qz qw");
    tokens.ExpectEnd();
    const auto rotation = UnitQuaternion({xyzw[3], xyzw[0], xyzw[1], xyzw[2]});
    if (!rotation) lines.Fail("expected a quaternion of length 1 (qx qy qz qw)");
    if (!poses.empty() && !(time_s > poses.back().time_s)) {
      lines.Fail(fmt::format("expected a time after {}, found {}",
                             FormatDouble(poses.back().time_s), FormatDouble(time_s)));
    }
    poses.push_back({time_s, Rigid3{*rotation, translation}.Inverse()});
  }
  if (poses.empty()) throw InputError(path, "expected poses, found none");
  return poses;
}

void WriteKittiTrajectory(const std::filesystem::path& path, std::span<const TimedPose> poses) {
  std::string text;
  for (const TimedPose& pose : poses) {
    const Rigid3 world_from_cam = pose.cam_from_world.Inverse();
    Eigen::Matrix<double, 3, 4, Eigen::RowMajor> matrix;
    matrix << world_from_cam.rotation.toRotationMatrix(), world_from_cam.translation;
    AppendLine({matrix.data(), static_cast<size_t>(matrix.size())}, text);
  }
  WriteFile(path, text);
}

void WriteKapture(const path& folder, std::span<const PosedImage> images) {
  const path sensors_file = folder / "sensors" / "sensors.txt";
  const path trajectories_file = folder / "sensors" / "trajectories.txt";
  const path records_file = folder / "sensors" / "records_camera.txt";
  constexpr const char* kHeader = "# kapture format: 1.1\n";
  std::string sensors = fmt::format("{}# sensor_device_id, name, type, params...\n", kHeader);
  std::string trajectories =
      fmt::format("{}# timestamp, device_id, qw, qx, qy, qz, tx, ty, tz\n", kHeader);
  std::string records = fmt::format("{}# timestamp, device_id, image_path\n", kHeader);
  std::map<std::string, size_t> sensor_of_camera;
  for (size_t i = 0; i < images.size(); ++i) {
    const PosedImage& image = images[i];
    CheckNameInCsv(records_file, image.name);
    std::string camera = image.camera.ToString();
    if (!IsOfKapture(image.camera.model())) {
      throw InputError(sensors_file, image.name,
                       fmt::format("kapture has no camera model for \"{}\"", camera));
    }
    const auto [sensor, is_new] = sensor_of_camera.emplace(camera, sensor_of_camera.size());
    if (is_new) {
      for (size_t at = 0; (at = camera.find(' ', at)) != std::string::npos; at += 2) {
        camera.replace(at, 1, ", ");
      }
      sensors += fmt::format("camera{}, , camera, {}\n", sensor->second, camera);
    }
    trajectories += fmt::format("{}, camera{}, {}\n", i, sensor->second,
                                FormatPose(image.cam_from_world, ", "));
    records += fmt::format("{}, camera{}, {}\n", i, sensor->second, image.name);
  }
  WriteFile(sensors_file, sensors);
  WriteFile(trajectories_file, trajectories);
  WriteFile(records_file, records);
}

}  // namespace raylift
