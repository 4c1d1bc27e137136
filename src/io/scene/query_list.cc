// Query lists, image lists and pose files.

#include "raylift/io/query_list.h"

#include <algorithm>
#include <unordered_map>
#include <utility>

#include <fmt/format.h>
#include <glob.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/io/image_file.h"
#include "raylift/io/line_tokens.h"
#include "raylift/io/unit_quaternion.h"

namespace raylift {
namespace {

// `*` and `?` as in the shell; brackets and backslashes stand for themselves.
std::vector<std::filesystem::path> MatchingFiles(const std::filesystem::path& pattern) {
  std::string escaped;
  for (const char c : pattern.string()) {
    if (c == '[' || c == ']' || c == '\\') {
      escaped += '\\';
    }
    escaped += c;
  }
  glob_t found{};
  std::vector<std::filesystem::path> files;
  if (glob(escaped.c_str(), GLOB_NOSORT, nullptr, &found) == 0) {
    files.assign(found.gl_pathv, found.gl_pathv + found.gl_pathc);
  }
  globfree(&found);
  std::sort(files.begin(), files.end());
  return files;
}

std::vector<std::filesystem::path> ListedFiles(const std::filesystem::path& path_or_pattern) {
  std::error_code ignored;
  const bool is_pattern = path_or_pattern.string().find_first_of("*?") != std::string::npos;
  if (!is_pattern || std::filesystem::exists(path_or_pattern, ignored)) {
    return {path_or_pattern};
  }
  auto files = MatchingFiles(path_or_pattern);
  if (files.empty()) {
    throw InputError(path_or_pattern, "no file has such a name");
  }
  return files;
}

// Of photographs whose camera is not known.
constexpr double kGuessedFocalRange = 2;
Camera GuessedCamera(const PlaneSize& size) {
  const double focal_px = 1.2 * std::max(size.width_px, size.height_px);
  const double params[] = {focal_px, 0.5 * size.width_px, 0.5 * size.height_px};
  return {CameraModel::kSimplePinhole, size.width_px, size.height_px, params};
}

}  // namespace

std::vector<Query> ReadQueryList(const std::filesystem::path& path_or_pattern,
                                 const std::filesystem::path& images) {
  std::vector<Query> queries;
  std::unordered_map<std::string, std::string> place_of_name;
  for (const std::filesystem::path& path : ListedFiles(path_or_pattern)) {
    LineReader lines(path);
    while (const auto line = lines.NextContent()) {
      LineTokens tokens(lines, *line);
      Query query = {.name = std::string(tokens.Token("name")), .camera = {}};
      if (!images.empty() && tokens.AtEnd()) {
        query.camera = GuessedCamera(ReadImageSize(PathBelow(images, query.name)));
        query.priors.focal_range = kGuessedFocalRange;
      } else {
        query.camera = tokens.CameraToEnd();
      }
      const auto [other, is_new] = place_of_name.emplace(
          query.name, fmt::format("{}: line {}", path.string(), lines.line_number()));
      if (!is_new) {
        tokens.Fail(
            fmt::format("name: \"{}\" stands twice (also in {})", query.name, other->second));
      }
      queries.push_back(std::move(query));
    }
  }
  return queries;
}

void WriteQueryList(const std::filesystem::path& path, const std::vector<Query>& queries) {
  std::string text;
  for (const Query& query : queries) {
    CheckName(path, query.name);
    text += fmt::format("{} {}\n", query.name, query.camera.ToString());
  }
  WriteFile(path, text);
}

std::vector<std::string> ReadImageList(const std::filesystem::path& path) {
  std::vector<std::string> names;
  LineReader lines(path);
  while (const auto line = lines.NextContent()) {
    names.emplace_back(Trim(*line));
  }
  return names;
}

std::vector<NamedPose> ReadPoseFile(const std::filesystem::path& path) {
  std::vector<NamedPose> poses;
  LineReader lines(path);
  while (const auto line = lines.NextContent()) {
    LineTokens tokens(lines, *line);
    NamedPose& pose = poses.emplace_back();
    pose.name = tokens.Token("name");
    const Eigen::Vector4d qvec_wxyz = tokens.Vector<4>("qvec");
    const auto rotation = UnitQuaternion(qvec_wxyz);
    if (!rotation) {
      tokens.Fail(fmt::format("qvec: expected a quaternion of length 1, found one of length {:.6g}",
                              qvec_wxyz.norm()));
    }
    pose.cam_from_world = {*rotation, tokens.Vector<3>("tvec")};
    while (!tokens.AtEnd()) {
      const std::string_view further = tokens.Token("number");
      if (!ParseDouble(further)) {
        tokens.Fail(fmt::format("expected numbers behind the pose, found \"{}\"", further));
      }
    }
  }
  return poses;
}

void WritePoseFile(const std::filesystem::path& path, const std::vector<NamedPose>& poses) {
  std::string text;
  for (const NamedPose& pose : poses) {
    CheckName(path, pose.name);
    const Eigen::Quaterniond& q = pose.cam_from_world.rotation;
    const Eigen::Vector3d& t = pose.cam_from_world.translation;
    text += pose.name;
    for (const double number : {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()}) {
      text += ' ';
      text += FormatDouble(number);
    }
    text += '\n';
  }
  WriteFile(path, text);
}

}  // namespace raylift
