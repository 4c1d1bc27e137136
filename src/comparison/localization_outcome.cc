#include "localization_outcome.h"

#include "base/json_text.h"
#include "geometry/pose_json.h"
#include <nlohmann/json.hpp>

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;

Json ToJson(const std::optional<Rigid3>& pose) { return pose ? PoseJson<Json>(*pose) : Json(); }

std::optional<Rigid3> PoseOf(const Json& json) {
  return json.is_null() ? std::nullopt : std::optional(PoseFromJson(json));
}

Json ToJson(const QueryDetail& detail) {
  Json candidates = Json::array();
  for (const QueryDetail::Candidate& candidate : detail.candidates) {
    candidates.push_back({candidate.solver, candidate.error.position, candidate.error.rotation_deg,
                          candidate.inliers_2d2d, candidate.chosen});
  }
  Json keypoints = Json::array();
  for (const QueryDetail::Keypoint& keypoint : detail.keypoints) {
    keypoints.push_back({keypoint.pixel.x(), keypoint.pixel.y(), keypoint.is_inlier});
  }
  return {{"counts",
           {detail.retrieved, detail.matched, detail.hit, detail.consistent, detail.inliers_2d3d,
            detail.inliers_2d2d}},
          {"solver", detail.solver},
          {"pose", ToJson(detail.cam_from_world)},
          {"candidates", std::move(candidates)},
          {"keypoints", std::move(keypoints)}};
}

QueryDetail DetailOf(const Json& json) {
  QueryDetail detail;
  const Json& counts = json.at("counts");
  size_t next = 0;
  for (size_t* count : {&detail.retrieved, &detail.matched, &detail.hit, &detail.consistent,
                        &detail.inliers_2d3d, &detail.inliers_2d2d}) {
    *count = counts.at(next++).get<size_t>();
  }
  detail.solver = json.at("solver").get<std::string>();
  detail.cam_from_world = PoseOf(json.at("pose"));
  for (const Json& candidate : json.at("candidates")) {
    detail.candidates.push_back(
        {.solver = candidate.at(0).get<std::string>(),
         .error = {candidate.at(1).get<double>(), candidate.at(2).get<double>()},
         .inliers_2d2d = candidate.at(3).get<size_t>(),
         .chosen = candidate.at(4).get<bool>()});
  }
  for (const Json& keypoint : json.at("keypoints")) {
    detail.keypoints.push_back(
        {.pixel = {keypoint.at(0).get<double>(), keypoint.at(1).get<double>()},
         .is_inlier = keypoint.at(2).get<bool>()});
  }
  return detail;
}

}  // namespace

std::string FormatOutcomes(std::span<const LocalizationOutcome> outcomes) {
  Json json = Json::array();
  for (const LocalizationOutcome& outcome : outcomes) {
    json.push_back({{"pose", ToJson(outcome.cam_from_world)},
                    {"inliers", {outcome.inliers_2d3d, outcome.inliers_2d2d}},
                    {"detail", ToJson(outcome.detail)}});
  }
  return JsonText(json);
}

std::optional<std::vector<LocalizationOutcome>> ParseOutcomes(const std::string& text) {
  try {
    std::vector<LocalizationOutcome> outcomes;
    for (const Json& json : Json::parse(text)) {
      LocalizationOutcome& outcome = outcomes.emplace_back();
      outcome.cam_from_world = PoseOf(json.at("pose"));
      outcome.inliers_2d3d = json.at("inliers").at(0).get<double>();
      outcome.inliers_2d2d = json.at("inliers").at(1).get<double>();
      outcome.detail = DetailOf(json.at("detail"));
    }
    return outcomes;
  } catch (const nlohmann::json::exception&) {
    return std::nullopt;
  }
}

}  // namespace raylift
