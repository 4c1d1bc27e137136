#include "apps/finished_run.h"

#include <unordered_map>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/io/query_list.h"
#include "raylift/localization/result_files.h"
#include "raylift/localization/scene.h"

namespace raylift {
namespace {

using std::filesystem::path;
using Json = nlohmann::json;

// Empty where the option has no value.
path PathOption(const Json& options, const char* name) {
  const Json& value = options.at(name);
  return value.is_null() ? path() : path(value.get<std::string>());
}

void TakeOptions(const path& folder, FinishedRun& run) {
  const path file = folder / "options.json";
  try {
    const Json options = Json::parse(ReadFile(file));
    run.query_list = PathOption(options, "queries");
    run.leave_one_out = options.value("leave-one-out", false);
    run.query_images = PathOption(options, "query-images");
    if (run.query_images.empty()) run.query_images = PathOption(options, "images");
    run.model = PathOption(options, "model");
    if (run.model.empty()) run.model = folder / "references" / "model";  // rendered
    const auto poses = FromName<PoseConvention>(options.at("model-poses").get<std::string>());
    if (!poses) throw InputError(file, "model-poses", "expected " + NameList<PoseConvention>());
    run.model_poses = *poses;
    run.subsampling = {.every = options.at("every").get<int>(),
                       .offset = options.at("every-offset").get<int>(),
                       .per_camera = options.at("every-per-camera").get<bool>()};
    run.geometry = options.at("geometry").get<std::vector<std::string>>();
    const path crs = options.contains("crs") ? PathOption(options, "crs") : path();
    if (!crs.empty()) run.world = WorldFrame::Parse(crs.string());
  } catch (const Json::exception& error) {
    throw InputError(file, "is not what localize writes: " + std::string(error.what()));
  }
}

std::vector<Query> ListedQueries(const FinishedRun& run) {
  if (!run.query_list.empty()) return ReadQueryList(run.query_list, run.query_images);
  if (!run.leave_one_out) {
    throw OptionError("--queries is required where RUN is a pose file");
  }
  return QueriesOf(LoadReferences(run.model, run.subsampling, run.model_poses).references);
}

}  // namespace

std::vector<Query> FinishedRun::PosedQueries() const {
  std::unordered_map<std::string, Query> listed;
  for (Query& query : ListedQueries(*this)) {
    const std::string name = query.name;
    listed.emplace(name, std::move(query));
  }
  std::vector<Query> posed;
  for (const LocalizedQuery& query : queries) {
    const auto found = listed.find(query.name);
    if (found == listed.end()) {
      throw InputError(query_list.empty() ? model : query_list,
                       fmt::format("{} has a pose, but is missing here", query.name));
    }
    posed.push_back(found->second);
  }
  return posed;
}

FinishedRun ReadFinishedRun(const path& folder_or_pose_file) {
  FinishedRun run;
  if (std::filesystem::is_directory(folder_or_pose_file)) {
    run.queries = ReadQueryDiagnostics(folder_or_pose_file / "queries.jsonl");
    TakeOptions(folder_or_pose_file, run);
    return run;
  }
  for (const NamedPose& pose : ReadPoseFile(folder_or_pose_file)) {
    LocalizedQuery& query = run.queries.emplace_back();
    query.name = pose.name;
    query.estimate.cam_from_world = pose.cam_from_world;
    query.estimate.verdict = PoseVerdict::kLocalized;
    query.estimate.confidence = 1;
  }
  return run;
}

}  // namespace raylift
