#include "raylift/io/trajectory_file.h"

#include <string>

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

}  // namespace

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

}  // namespace raylift
