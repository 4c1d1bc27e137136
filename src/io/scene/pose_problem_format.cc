// Writing of pose problems: one match per line, numbers in their shortest form that reads back as
// the same double, so that equal problems give equal bytes.

#include <algorithm>
#include <cmath>
#include <optional>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/io/pose_problem_json.h"
#include "raylift/scene/keypoints.h"

namespace raylift {
namespace {

void AppendNumber(double value, std::string* text) {
  RAYLIFT_CHECK(std::isfinite(value));
  // Readers take "-0" for an integer, which has no sign.
  *text += value == 0 && std::signbit(value) ? "-0.0" : FormatDouble(value);
}

template <typename Numbers>
void AppendNumbers(const Numbers& numbers, std::string* text) {
  *text += '[';
  bool is_first = true;
  for (const double number : numbers) {
    *text += is_first ? "" : ", ";
    is_first = false;
    AppendNumber(number, text);
  }
  *text += ']';
}

void AppendString(const std::string& string, std::string* text) {
  try {
    *text += nlohmann::json(string).dump();
  } catch (const nlohmann::json::exception&) {
    throw InputError(fmt::format("the name \"{}\" is not UTF-8, which JSON demands", string));
  }
}

void AppendCamera(const Camera& camera, std::string* text) {
  *text +=
      fmt::format(R"({{"model": "{}", "width": {}, "height": {}, "params": )",
                  GetCameraModelInfo(camera.model()).name, camera.width_px(), camera.height_px());
  AppendNumbers(camera.params(), text);
  *text += '}';
}

void AppendPose(const Rigid3& pose, std::string* text) {
  const Eigen::Quaterniond& q = pose.rotation;
  *text += R"({"qvec": )";
  AppendNumbers(Eigen::Vector4d(q.w(), q.x(), q.y(), q.z()), text);
  *text += R"(, "tvec": )";
  AppendNumbers(pose.translation, text);
  *text += '}';
}

// ",\n" and `"name": [`, then one row per line.
template <typename Row, typename AppendRow>
void AppendArray(std::string_view name, const std::vector<Row>& rows, AppendRow append_row,
                 std::string* text) {
  *text += fmt::format(",\n\"{}\": [", name);
  bool is_first = true;
  for (const Row& row : rows) {
    *text += is_first ? "\n" : ",\n";
    is_first = false;
    append_row(row, text);
  }
  *text += rows.empty() ? "]" : "\n]";
}

void AppendReference(const PosedImage& reference, std::string* text) {
  *text += R"({"name": )";
  AppendString(reference.name, text);
  *text += R"(, "camera": )";
  AppendCamera(reference.camera, text);
  *text += R"(, "cam_from_world": )";
  AppendPose(reference.cam_from_world, text);
  *text += '}';
}

void AppendMatch2D2D(const Match2D2D& match, std::string* text) {
  *text += fmt::format("[{}", match.reference);
  for (const double number :
       {match.query_px.x(), match.query_px.y(), match.reference_px.x(), match.reference_px.y()}) {
    *text += ", ";
    AppendNumber(number, text);
  }
  *text += ']';
}

void AppendMatch2D3D(const Match2D3D& match, std::string* text) {
  Eigen::Matrix<double, 5, 1> row;
  row << match.query_px, match.point_in_world;
  AppendNumbers(row, text);
}

void AppendOtherCameras(const std::vector<RigCamera>& cameras, std::string* text) {
  if (cameras.empty()) return;
  *text += ", \"other_cameras\": [";
  for (const RigCamera& camera : cameras) {
    *text += &camera == &cameras.front() ? "\n{\"name\": " : ",\n{\"name\": ";
    AppendString(camera.name, text);
    *text += ", \"camera\": ";
    AppendCamera(camera.camera, text);
    *text += ", \"cam_from_query\": ";
    AppendPose(camera.cam_from_query, text);
    *text += '}';
  }
  *text += "\n]";
}

// "," and `"name": [`, then all values in one line.
template <typename Value, typename TextOf>
void AppendLine(std::string_view name, const std::vector<Value>& values, TextOf text_of,
                std::string* text) {
  *text += fmt::format(",\n\"{}\": [", name);
  for (const Value& value : values) {
    if (&value != values.data()) *text += ", ";
    *text += text_of(value);
  }
  *text += ']';
}

void AppendReferenceIndex(const Match2D3D& match, std::string* text) {
  *text += match.reference ? std::to_string(*match.reference) : "null";
}

void AppendSigma(const std::optional<double>& sigma, std::string* text) {
  if (sigma) {
    AppendNumber(*sigma, text);
  } else {
    *text += "null";
  }
}
void AppendPointSigma(const Match2D3D& match, std::string* text) {
  AppendSigma(match.point_sigma, text);
}
void AppendDepthSigma(const Match2D3D& match, std::string* text) {
  AppendSigma(match.log_depth_sigma, text);
}
void AppendReferenceSigma(const Match2D2D& match, std::string* text) {
  AppendSigma(match.reference_sigma_px, text);
}

// A member of "extra": an index or null per match; left out where there is none.
template <typename Match, typename Index>
void AppendIndices(std::string_view name, const std::vector<Match>& matches,
                   std::optional<Index> Match::*index, std::string* extra) {
  const auto has_index = [index](const Match& match) { return (match.*index).has_value(); };
  if (std::none_of(matches.begin(), matches.end(), has_index)) return;
  const auto text_of = [&](const Match& match) {
    return has_index(match) ? std::to_string(*(match.*index)) : std::string("null");
  };
  AppendLine(name, matches, text_of, extra);
}

void AppendPriors(const PosePriors& priors, std::string* text) {
  const auto append = [text](std::string_view name, const Eigen::Vector3d& vector) {
    *text += fmt::format("\"{}\": ", name);
    AppendNumbers(vector, text);
  };
  const auto append_sigma = [text](double sigma_deg) {
    *text += ", \"sigma_deg\": ";
    AppendNumber(sigma_deg, text);
    *text += '}';
  };
  if (priors.position) {
    *text += ", \"position_prior\": {";
    append("position", priors.position->position);
    *text += ", ";
    append("sigma", priors.position->sigma);
    *text += '}';
  }
  if (priors.gravity) {
    *text += ", \"gravity_prior\": {";
    append("down_in_cam", priors.gravity->down_in_cam);
    *text += ", ";
    append("down_in_world", priors.gravity->down_in_world);
    append_sigma(priors.gravity->sigma_deg);
  }
  if (priors.heading) {
    *text += ", \"heading_prior\": {";
    append("right_in_cam", priors.heading->right_in_cam);
    *text += ", ";
    append("right_in_world", priors.heading->right_in_world);
    *text += ", ";
    append("down_in_world", priors.heading->down_in_world);
    append_sigma(priors.heading->sigma_deg);
  }
  if (priors.orientation) {
    const Eigen::Quaterniond& q = priors.orientation->cam_from_world;
    *text += ", \"orientation_prior\": {\"qvec\": ";
    AppendNumbers(Eigen::Vector4d(q.w(), q.x(), q.y(), q.z()), text);
    append_sigma(priors.orientation->sigma_deg);
  }
  if (priors.focal_range != 1) {
    *text += ", \"focal_range\": ";
    AppendNumber(priors.focal_range, text);
  }
  if (priors.focal_sigma) {
    *text += ", \"focal_sigma\": ";
    AppendNumber(*priors.focal_sigma, text);
  }
}

void AppendReferenceSigmas(const ReferenceSigmas& sigmas, std::string* text) {
  std::string members;
  const auto append = [&](std::string_view name, const std::optional<double>& sigma) {
    if (!sigma) return;
    members += fmt::format("{}\"{}\": ", members.empty() ? "" : ", ", name);
    AppendNumber(*sigma, &members);
  };
  append("factor", sigmas.factor);
  append("rotation_deg", sigmas.rotation_deg);
  append("position", sigmas.position);
  if (!members.empty()) *text += ",\n\"reference_sigmas\": {" + members + '}';
}

// Which keypoints the matches are of: also where a reader would find them by equal pixels, as other
// readers need not know that.
void AppendExtra(const PoseProblem& problem, std::string* text) {
  PoseProblem complete = problem;
  AssignKeypointsByPixel(complete);
  const std::vector<Match2D2D>& pairs = complete.matches_2d2d;
  const std::vector<Match2D3D>& points = complete.matches_2d3d;
  std::string extra;
  AppendIndices("keypoint", pairs, &Match2D2D::query_keypoint, &extra);
  AppendIndices("keypoint_2d3d", points, &Match2D3D::query_keypoint, &extra);
  AppendIndices("reference_keypoint", pairs, &Match2D2D::reference_keypoint, &extra);
  AppendIndices("match_2d2d", points, &Match2D3D::match_2d2d, &extra);
  if (!extra.empty()) *text += ",\n\"extra\": {" + extra.substr(1) + '}';
}

}  // namespace

std::string FormatPoseProblem(const PoseProblemFile& file) {
  const PoseProblem& problem = file.problem;
  std::string text = fmt::format("{{\n\"format\": \"pose-problem/{}\",\n\"name\": ",
                                 problem.priors.empty() && problem.other_cameras.empty() ? 1 : 2);
  AppendString(problem.name, &text);
  text += ",\n\"query\": {\"camera\": ";
  AppendCamera(problem.query_camera, &text);
  if (file.gt_cam_from_world) {
    text += ", \"gt_cam_from_world\": ";
    AppendPose(*file.gt_cam_from_world, &text);
  }
  AppendPriors(problem.priors, &text);
  AppendOtherCameras(problem.other_cameras, &text);
  text += '}';
  AppendArray("references", problem.references, AppendReference, &text);
  if (!problem.reference_clusters.empty()) {
    AppendLine(
        "reference_clusters", problem.reference_clusters,
        [](int cluster) { return std::to_string(cluster); }, &text);
  }
  AppendArray("matches_2d2d", problem.matches_2d2d, AppendMatch2D2D, &text);
  const auto& matches = problem.matches_2d3d;
  AppendArray("matches_2d3d", matches, AppendMatch2D3D, &text);
  if (std::any_of(matches.begin(), matches.end(), [](const auto& m) { return m.reference; })) {
    AppendArray("matches_2d3d_reference", matches, AppendReferenceIndex, &text);
  }
  if (std::any_of(matches.begin(), matches.end(), [](const auto& m) { return m.point_sigma; })) {
    AppendArray("matches_2d3d_sigma", matches, AppendPointSigma, &text);
  }
  if (std::any_of(matches.begin(), matches.end(),
                  [](const auto& m) { return m.log_depth_sigma; })) {
    AppendArray("matches_2d3d_log_depth_sigma", matches, AppendDepthSigma, &text);
  }
  const auto& pairs = problem.matches_2d2d;
  if (std::any_of(pairs.begin(), pairs.end(), [](const auto& m) { return m.reference_sigma_px; })) {
    AppendArray("matches_2d2d_sigma_px", pairs, AppendReferenceSigma, &text);
  }
  if (!problem.other_cameras.empty()) {
    const auto camera_of = [](const auto& match) { return std::to_string(match.camera); };
    AppendLine("matches_2d2d_camera", pairs, camera_of, &text);
    AppendLine("matches_2d3d_camera", matches, camera_of, &text);
  }
  AppendReferenceSigmas(problem.reference_sigmas, &text);
  AppendExtra(problem, &text);
  text += "\n}\n";
  return text;
}

void WritePoseProblem(const std::filesystem::path& path, const PoseProblemFile& file) {
  std::string text;
  try {
    text = FormatPoseProblem(file);
  } catch (const InputError& error) {
    throw InputError(path, error.what());
  }
  WriteFile(path, text);
}

}  // namespace raylift
