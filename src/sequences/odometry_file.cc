#include <algorithm>
#include <string_view>
#include <utility>

#include "datasets/importers.h"
#include "io/text/json_document.h"
#include "io/text/line_tokens.h"
#include "sequences/odometry.h"
#include <Eigen/Core>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/datasets/dataset.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr size_t kKittiNumbers = 12;

Odometry OfKapture(const path& folder) {
  const std::vector<KaptureImage> images = ReadKapture(folder);
  Odometry odometry{.times = TimesOf(images)};
  for (const KaptureImage& image : images) {
    if (image.cam_from_world) odometry.by_name.emplace(image.name, *image.cam_from_world);
  }
  return odometry;
}

Odometry OfTransforms(const path& file) {
  Odometry odometry;
  for (const PosedImage& image : ReadTransforms(file, odometry.warnings)) {
    odometry.by_name.emplace(image.name, image.cam_from_world);
  }
  return odometry;
}

Odometry OfKitti(const path& file) {
  Odometry odometry;
  LineReader lines(file);
  while (const auto line = lines.NextContent()) {
    LineTokens tokens(lines, *line);
    Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
    for (int row = 0; row < 3; ++row) {
      matrix.row(row) = tokens.Vector<4>("a row of the pose's matrix");
    }
    tokens.ExpectEnd();
    const auto world_from_cam = RigidFromMatrix(matrix);
    if (!world_from_cam) lines.Fail("expected a right-handed rotation and a translation");
    odometry.in_order.push_back(world_from_cam->Inverse());
  }
  return odometry;
}

template <typename Fail>
void AddAtTime(double time_s, const Rigid3& cam_from_world, std::vector<TimedPose>& poses,
               const Fail& fail) {
  if (!poses.empty() && !(time_s > poses.back().time_s)) {
    fail(fmt::format("expected a time after {}, found {}", FormatDouble(poses.back().time_s),
                     FormatDouble(time_s)));
  }
  poses.push_back({time_s, cam_from_world});
}

// Reads EuRoC's lines: time [ns], px, py, pz, qw, qx, qy, qz, ...
Odometry OfEuroc(const path& file) {
  constexpr size_t kFields = 8;
  constexpr double kSecondsPerTick = 1e-9;
  Odometry odometry;
  LineReader lines(file);
  while (const auto line = lines.NextContent()) {
    const auto fields = SplitBy(*line, ',');
    if (fields.size() < kFields) {
      lines.Fail(fmt::format("expected {} fields, time [ns], px, py, pz, qw, qx, qy, qz, found {}",
                             kFields, fields.size()));
    }
    const auto number = [&](size_t field, std::string_view name) {
      return lines.Double(Trim(fields[field]), name);
    };
    const auto time_s =
        kSecondsPerTick * static_cast<double>(lines.Uint(Trim(fields[0]), "time [ns]"));
    const Eigen::Vector3d position(number(1, "px"), number(2, "py"), number(3, "pz"));
    const auto rotation =
        UnitQuaternion({number(4, "qw"), number(5, "qx"), number(6, "qy"), number(7, "qz")});
    if (!rotation) lines.Fail("expected a quaternion of length 1 (qw qx qy qz)");
    AddAtTime(time_s, Rigid3{*rotation, position}.Inverse(), odometry.by_time,
              [&](std::string_view message) { lines.Fail(message); });
  }
  return odometry;
}

// Reads sixteen numbers, or four times four.
Eigen::Matrix4d ReadNumbers(const JsonPlace& place) {
  Eigen::Matrix4d matrix;
  if (place.ArraySize() == 16) {
    const Eigen::Matrix<double, 16, 1> numbers = place.Vector<16>();
    return Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(numbers.data());
  }
  place.ExpectArraySize(4);
  for (int row = 0; row < 4; ++row) {
    const JsonPlace numbers = place.At(static_cast<size_t>(row));
    matrix.row(row) = numbers.Vector<4>();
  }
  return matrix;
}

// A line as recorders on phones write it.
struct JsonLine {
  int number;
  std::optional<std::string> name;
  std::optional<double> time_s;
  Eigen::Matrix4d transform;
};

JsonLine ReadJsonLine(const LineReader& lines, std::string_view line) {
  const JsonDocument document(
      line, fmt::format("{}: line {}", lines.path().string(), lines.line_number()));
  const JsonPlace root = document.Root();
  const JsonPlace transform = root.Member("transform");
  JsonLine read{lines.line_number(), {}, {}, ReadNumbers(transform)};
  if (root.Has("name")) {
    const JsonPlace name = root.Member("name");
    read.name = name.String();
  }
  if (root.Has("timestamp")) {
    const JsonPlace timestamp = root.Member("timestamp");
    read.time_s = timestamp.Number();
  }
  if (!read.name && !read.time_s) root.Fail("expected timestamp or name");
  return read;
}

// Reads lines of JSON. Matrices are by rows, or by columns where the last numbers of one of them
// say so.
Odometry OfJsonLines(const path& file) {
  std::vector<JsonLine> read;
  LineReader lines(file);
  while (const auto line = lines.NextContent()) read.push_back(ReadJsonLine(lines, *line));
  const bool by_columns = std::any_of(read.begin(), read.end(), [](const JsonLine& line) {
    return !line.transform.row(3).isApprox(Eigen::RowVector4d::UnitW());
  });
  Odometry odometry;
  for (const JsonLine& line : read) {
    const auto fail = [&](std::string_view message) {
      throw InputError(file, fmt::format("line {}: {}", line.number, message));
    };
    Eigen::Matrix4d transform = line.transform;
    if (by_columns) transform.transposeInPlace();
    const auto world_from_cam = RigidFromMatrix(transform);
    if (!world_from_cam) fail("transform: expected a right-handed rotation and a translation");
    const Rigid3 cam_from_world =
        CamFromWorld(*world_from_cam, PoseConvention::kWorldFromOpenGlCamera);
    if (line.name.has_value() != read.front().name.has_value() ||
        line.time_s.has_value() != read.front().time_s.has_value()) {
      fail("expected name and timestamp in all lines or in none");
    }
    if (!line.name) {
      AddAtTime(*line.time_s, cam_from_world, odometry.by_time, fail);
      continue;
    }
    if (!odometry.by_name.emplace(*line.name, cam_from_world).second) {
      fail(fmt::format("{} stands twice", *line.name));
    }
    if (line.time_s) odometry.times.emplace(*line.name, *line.time_s);
  }
  return odometry;
}

bool AreNumbers(std::span<const std::string_view> tokens) {
  return std::all_of(tokens.begin(), tokens.end(),
                     [](std::string_view token) { return ParseDouble(token).has_value(); });
}

Odometry OfLines(const path& file) {
  LineReader lines(file);
  const auto line = lines.NextContent();
  if (!line) throw InputError(file, "expected poses, found none");
  if (line->starts_with('{')) return OfJsonLines(file);
  if (AreNumbers(SplitBy(*line, ',')) && line->find(',') != std::string_view::npos) {
    return OfEuroc(file);
  }
  const auto tokens = SplitTokens(*line);
  if (!AreNumbers(tokens)) return {.by_name = ReadModelOrPoses(file)};
  if (tokens.size() == kKittiNumbers) return OfKitti(file);
  return {.by_time = ReadTumTrajectory(file)};
}

}  // namespace

Odometry ReadOdometry(const path& odometry) {
  if (std::filesystem::is_directory(odometry)) {
    if (std::filesystem::exists(odometry / "sensors" / "trajectories.txt")) {
      return OfKapture(odometry);
    }
    return {.by_name = ReadModelOrPoses(odometry)};
  }
  return odometry.extension() == ".json" ? OfTransforms(odometry) : OfLines(odometry);
}

}  // namespace raylift
