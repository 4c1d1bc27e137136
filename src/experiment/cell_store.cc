#include "raylift/experiment/cell_store.h"

#include "base/json_text.h"
#include "geometry/pose_json.h"
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;

Json ToJson(const QueryOutcome& outcome) {
  const auto& pose = outcome.cam_from_world;
  return {{"name", outcome.name},
          {"pose", pose ? PoseJson<Json>(*pose) : Json()},
          {"position_observable", outcome.position_observable},
          {"reason", outcome.reason},
          {"inliers_2d3d", outcome.inliers_2d3d},
          {"inliers_2d2d", outcome.inliers_2d2d},
          {"matches_2d3d", outcome.matches_2d3d},
          {"matches_2d2d", outcome.matches_2d2d},
          {"solver", ToString(outcome.solver)}};
}

QueryOutcome FromJson(const Json& json) {
  QueryOutcome outcome;
  outcome.name = json.at("name");
  if (!json.at("pose").is_null()) outcome.cam_from_world = PoseFromJson(json.at("pose"));
  outcome.position_observable = json.at("position_observable");
  outcome.reason = json.at("reason");
  outcome.inliers_2d3d = json.at("inliers_2d3d");
  outcome.inliers_2d2d = json.at("inliers_2d2d");
  outcome.matches_2d3d = json.at("matches_2d3d");
  outcome.matches_2d2d = json.at("matches_2d2d");
  outcome.solver = FromName<Solver>(json.at("solver").get<std::string>()).value_or(Solver::kP3p);
  return outcome;
}

}  // namespace

bool QueryOutcome::operator==(const QueryOutcome& other) const {
  return ToJson(*this) == ToJson(other);
}

CellStore::CellStore(std::filesystem::path folder) : folder_(std::move(folder)) {}

std::filesystem::path CellStore::FileOf(const Cell& cell) const {
  return folder_ / (cell.Key() + ".json");
}

std::optional<std::vector<QueryOutcome>> CellStore::Read(const Cell& cell) const {
  const auto file = FileOf(cell);
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(file, ignored)) return std::nullopt;
  try {
    const Json json = Json::parse(ReadFile(file));
    if (json.at("inputs") != Json::parse(cell.inputs)) return std::nullopt;
    std::vector<QueryOutcome> outcomes;
    for (const Json& outcome : json.at("outcomes")) outcomes.push_back(FromJson(outcome));
    if (outcomes.size() != cell.end - cell.begin) return std::nullopt;
    return outcomes;
  } catch (const nlohmann::json::exception&) {
    return std::nullopt;  // damaged: made again
  }
}

void CellStore::Write(const Cell& cell, std::span<const QueryOutcome> outcomes) const {
  RAYLIFT_CHECK_EQ(outcomes.size(), cell.end - cell.begin);
  Json list = Json::array();
  for (const QueryOutcome& outcome : outcomes) list.push_back(ToJson(outcome));
  const Json json = {{"setting", cell.setting.Name()},
                     {"inputs", Json::parse(cell.inputs)},
                     {"outcomes", std::move(list)}};
  WriteFile(FileOf(cell), JsonText(json) + '\n');
}

}  // namespace raylift
