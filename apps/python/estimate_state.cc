#include "apps/python/estimate_state.h"

#include "geometry/pose_json.h"
#include "localization/results/result_json.h"
#include <fmt/format.h>

#include "raylift/io/pose_problem_json.h"

namespace raylift::python {
namespace {

struct WholeEstimate {
  PoseEstimate estimate;
};

void Flags(JsonMembers& members, const char* name, std::vector<bool>& flags) {
  std::string text;
  for (const bool flag : flags) text += flag ? '1' : '0';
  members(name, text);
  flags.assign(text.size(), false);
  for (size_t i = 0; i < text.size(); ++i) flags[i] = text[i] == '1';
}

void Members(JsonMembers& members, WholeEstimate& whole) {
  PoseEstimate& estimate = whole.estimate;
  members("cam_from_world", estimate.cam_from_world);
  members("failure", estimate.failure);
  members("verdict", estimate.verdict);
  members("confidence", estimate.confidence);
  members("position_observable", estimate.position_observable);
  Flags(members, "inliers_2d3d", estimate.inliers_2d3d);
  Flags(members, "inliers_2d2d", estimate.inliers_2d2d);
  raylift::Members(members, estimate);
}

}  // namespace

ProblemState StateOf(const KnownProblem& problem) {
  return {FormatPoseProblem({problem, std::nullopt}),
          problem.scene_noise ? ToJson(*problem.scene_noise).dump() : ""};
}

std::shared_ptr<KnownProblem> ProblemOf(const ProblemState& state) {
  std::optional<SceneNoise> noise;
  if (!state.second.empty()) noise = ParseJson<SceneNoise>(state.second);
  return std::make_shared<KnownProblem>(ParsePoseProblem(state.first, "pickle").problem, noise);
}

std::string StateOf(const PoseEstimate& estimate) { return ToJson(WholeEstimate{estimate}).dump(); }

std::shared_ptr<PoseEstimate> EstimateOf(const std::string& state) {
  return std::make_shared<PoseEstimate>(ParseJson<WholeEstimate>(state).estimate);
}

std::vector<std::pair<std::string, std::string>> HtmlRowsOf(const PoseEstimate& estimate) {
  if (!estimate.cam_from_world) return {{"no pose", std::string(ToString(estimate.failure))}};
  const Eigen::Vector3d center = estimate.cam_from_world->Inverse().translation;
  const auto inliers = [](const MatchSetScore& score) {
    return fmt::format("{} of {}", score.num_inliers, score.num_matches);
  };
  return {{"verdict", std::string(ToString(estimate.verdict))},
          {"confidence", fmt::format("{:.4f}", estimate.confidence)},
          {"camera's center",
           fmt::format("({:.6g}, {:.6g}, {:.6g})", center.x(), center.y(), center.z())},
          {"its standard deviation", fmt::format("{:.2g}", estimate.position_sigma)},
          {"that of the rotation, degrees", fmt::format("{:.2g}", estimate.rotation_sigma_deg)},
          {"2D-3D matches that agree", inliers(estimate.score_2d3d)},
          {"2D-2D matches that agree", inliers(estimate.score_2d2d)}};
}

}  // namespace raylift::python
