// Writes pose problems: one match per line, numbers in their shortest form that reads back as the
// same double, so that equal problems give equal bytes.

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/io/pose_problem_json.h"
#include "raylift/scene/keypoints.h"

namespace raylift {
namespace {

std::string NumberText(double value) {
  RAYLIFT_CHECK(std::isfinite(value));
  // Readers take "-0" for an integer, which has no sign.
  return value == 0 && std::signbit(value) ? "-0.0" : FormatDouble(value);
}

template <typename Numbers>
std::string NumbersText(const Numbers& numbers) {
  std::string text = "[";
  for (const double number : numbers) text += (text.size() > 1 ? ", " : "") + NumberText(number);
  return text + ']';
}

std::string StringText(const std::string& string) {
  try {
    return nlohmann::json(string).dump();
  } catch (const nlohmann::json::exception&) {
    throw InputError(fmt::format("the name \"{}\" is not UTF-8, which JSON demands", string));
  }
}

std::string RotationText(const Eigen::Quaterniond& q) {
  return NumbersText(Eigen::Vector4d(q.w(), q.x(), q.y(), q.z()));
}

std::string LensText(const Camera& camera) {
  return fmt::format(R"({{"model": "{}", "width": {}, "height": {}, "params": {}}})",
                     GetCameraModelInfo(camera.model()).name, camera.width_px(), camera.height_px(),
                     NumbersText(camera.params()));
}

std::string PoseText(const Rigid3& pose) {
  return fmt::format(R"({{"qvec": {}, "tvec": {}}})", RotationText(pose.rotation),
                     NumbersText(pose.translation));
}

std::string ReferenceText(const PosedImage& reference) {
  return fmt::format(R"({{"name": {}, "camera": {}, "cam_from_world": {}}})",
                     StringText(reference.name), LensText(reference.camera),
                     PoseText(reference.cam_from_world));
}

std::string OtherCameraText(const RigCamera& camera) {
  return fmt::format(R"({{"name": {}, "camera": {}, "cam_from_query": {}}})",
                     StringText(camera.name), LensText(camera.camera),
                     PoseText(camera.cam_from_query));
}

std::string PairText(const Match2D2D& match) {
  return fmt::format("[{}, {}, {}, {}, {}]", match.reference, NumberText(match.query_px.x()),
                     NumberText(match.query_px.y()), NumberText(match.reference_px.x()),
                     NumberText(match.reference_px.y()));
}

std::string PointText(const Match2D3D& match) {
  Eigen::Matrix<double, 5, 1> row;
  row << match.query_px, match.point_in_world;
  return NumbersText(row);
}

enum class ListLayout { kOneLine, kLines };

template <typename Value, typename TextOf>
std::string ListText(const std::vector<Value>& values, ListLayout layout, const TextOf& text_of) {
  const bool in_lines = layout == ListLayout::kLines && !values.empty();
  std::string text = "[";
  for (const Value& value : values) {
    if (&value != values.data()) text += in_lines ? "," : ", ";
    if (in_lines) text += '\n';
    text += text_of(value);
  }
  return text + (in_lines ? "\n]" : "]");
}

// Returns a member on a line of its own, behind others.
std::string MemberText(std::string_view name, const std::string& value) {
  return fmt::format(",\n\"{}\": {}", name, value);
}

// Returns a member with a value or null per match; nothing where no match has one.
template <typename Match, typename Value>
std::string ColumnText(std::string_view name, const std::vector<Match>& matches,
                       std::optional<Value> Match::*member, ListLayout layout) {
  const auto has_value = [member](const Match& match) { return (match.*member).has_value(); };
  if (std::none_of(matches.begin(), matches.end(), has_value)) return {};
  return MemberText(name, ListText(matches, layout, [&](const Match& match) -> std::string {
                      if (!has_value(match)) return "null";
                      if constexpr (std::is_floating_point_v<Value>) {
                        return NumberText(*(match.*member));
                      } else {
                        return std::to_string(*(match.*member));
                      }
                    }));
}

std::string PriorsText(const PosePriors& priors) {
  std::string text;
  if (const auto& prior = priors.position) {
    text += fmt::format(R"(, "position_prior": {{"position": {}, "sigma": {}}})",
                        NumbersText(prior->position), NumbersText(prior->sigma));
  }
  if (const auto& prior = priors.gravity) {
    text += fmt::format(
        R"(, "gravity_prior": {{"down_in_cam": {}, "down_in_world": {}, "sigma_deg": {}}})",
        NumbersText(prior->down_in_cam), NumbersText(prior->down_in_world),
        NumberText(prior->sigma_deg));
  }
  if (const auto& prior = priors.heading) {
    text += fmt::format(
        R"(, "heading_prior": {{"right_in_cam": {}, "right_in_world": {}, "down_in_world": {}, )"
        R"("sigma_deg": {}}})",
        NumbersText(prior->right_in_cam), NumbersText(prior->right_in_world),
        NumbersText(prior->down_in_world), NumberText(prior->sigma_deg));
  }
  if (const auto& prior = priors.orientation) {
    text += fmt::format(R"(, "orientation_prior": {{"qvec": {}, "sigma_deg": {}}})",
                        RotationText(prior->cam_from_world), NumberText(prior->sigma_deg));
  }
  if (const auto& prior = priors.range; prior && prior->plane) {
    text += fmt::format(
        R"(, "range_prior": {{"range": {}, "sigma": {}, "point": {}, "normal": {}, )"
        R"("plane_sigma": {}}})",
        NumberText(prior->range), NumberText(prior->sigma), NumbersText(prior->plane->point),
        NumbersText(prior->plane->normal), NumberText(prior->plane->sigma));
  }
  if (priors.focal_range != 1) text += ", \"focal_range\": " + NumberText(priors.focal_range);
  if (priors.focal_sigma) text += ", \"focal_sigma\": " + NumberText(*priors.focal_sigma);
  return text;
}

std::string ReferenceSigmasText(const ReferenceSigmas& sigmas) {
  std::string members;
  const auto append = [&](std::string_view name, const std::optional<double>& sigma) {
    if (!sigma) return;
    members += fmt::format("{}\"{}\": {}", members.empty() ? "" : ", ", name, NumberText(*sigma));
  };
  append("factor", sigmas.factor);
  append("rotation_deg", sigmas.rotation_deg);
  append("position", sigmas.position);
  return members.empty() ? "" : MemberText("reference_sigmas", '{' + members + '}');
}

// Returns the keypoints of the matches, also where a reader would find them by equal pixels, as
// other readers need not do so.
std::string ExtraText(const PoseProblem& problem) {
  PoseProblem complete = problem;
  AssignKeypointsByPixel(complete);
  const std::vector<Match2D2D>& pairs = complete.matches_2d2d;
  const std::vector<Match2D3D>& points = complete.matches_2d3d;
  using enum ListLayout;
  const std::string extra =
      ColumnText("keypoint", pairs, &Match2D2D::query_keypoint, kOneLine) +
      ColumnText("keypoint_2d3d", points, &Match2D3D::query_keypoint, kOneLine) +
      ColumnText("reference_keypoint", pairs, &Match2D2D::reference_keypoint, kOneLine) +
      ColumnText("match_2d2d", points, &Match2D3D::match_2d2d, kOneLine);
  return extra.empty() ? "" : MemberText("extra", '{' + extra.substr(1) + '}');
}

}  // namespace

std::string FormatPoseProblem(const PoseProblemFile& file) {
  using enum ListLayout;
  const PoseProblem& problem = file.problem;
  const std::vector<Match2D2D>& pairs = problem.matches_2d2d;
  const std::vector<Match2D3D>& points = problem.matches_2d3d;
  const bool is_rig = !problem.other_cameras.empty();
  std::string text = fmt::format(
      "{{\n\"format\": \"pose-problem/{}\",\n\"name\": {},\n\"query\": {{\"camera\": {}",
      problem.priors.empty() && !is_rig ? 1 : 2, StringText(problem.name),
      LensText(problem.query_camera));
  if (file.gt_cam_from_world) {
    text += ", \"gt_cam_from_world\": " + PoseText(*file.gt_cam_from_world);
  }
  text += PriorsText(problem.priors);
  if (is_rig) {
    text += ", \"other_cameras\": " + ListText(problem.other_cameras, kLines, OtherCameraText);
  }
  text += '}';
  text += MemberText("references", ListText(problem.references, kLines, ReferenceText));
  if (!problem.reference_clusters.empty()) {
    text += MemberText("reference_clusters",
                       ListText(problem.reference_clusters, kOneLine,
                                [](int cluster) { return std::to_string(cluster); }));
  }
  text += MemberText("matches_2d2d", ListText(pairs, kLines, PairText));
  text += MemberText("matches_2d3d", ListText(points, kLines, PointText));
  text += ColumnText("matches_2d3d_reference", points, &Match2D3D::reference, kLines);
  text += ColumnText("matches_2d3d_sigma", points, &Match2D3D::point_sigma, kLines);
  text += ColumnText("matches_2d3d_log_depth_sigma", points, &Match2D3D::log_depth_sigma, kLines);
  text += ColumnText("matches_2d2d_sigma_px", pairs, &Match2D2D::reference_sigma_px, kLines);
  if (is_rig) {
    const auto camera_of = [](const auto& match) { return std::to_string(match.camera); };
    text += MemberText("matches_2d2d_camera", ListText(pairs, kOneLine, camera_of));
    text += MemberText("matches_2d3d_camera", ListText(points, kOneLine, camera_of));
  }
  text += ReferenceSigmasText(problem.reference_sigmas);
  if (problem.search_area_px2) {
    text += MemberText("search_area_px2", NumberText(*problem.search_area_px2));
  }
  return text + ExtraText(problem) + "\n}\n";
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
