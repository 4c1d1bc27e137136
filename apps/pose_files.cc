#include "apps/pose_files.h"

#include <algorithm>
#include <map>
#include <unordered_map>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/query_list.h"
#include "raylift/io/scene_file.h"
#include "raylift/localization/result_files.h"
#include "raylift/localization/scene.h"

namespace raylift {

using std::filesystem::path;

namespace {

// Returns the path of an option; empty where it has no value.
path PathOption(const nlohmann::json& options, const char* name) {
  const nlohmann::json& value = options.at(name);
  return value.is_null() ? path() : path(value.get<std::string>());
}

void TakeOptions(const path& folder, FinishedRun& run) {
  const path file = folder / "options.json";
  try {
    const nlohmann::json options = nlohmann::json::parse(ReadFile(file));
    run.query_list = PathOption(options, "queries");
    run.leave_one_out = options.value("leave-one-out", false);
    run.query_images = PathOption(options, "query-images");
    if (run.query_images.empty()) run.query_images = PathOption(options, "images");
    run.references.model = PathOption(options, "model");
    if (run.references.model.empty())
      run.references.model = folder / "references" / "model";  // rendered
    const auto poses = FromName<PoseConvention>(options.at("model-poses").get<std::string>());
    if (!poses) throw InputError(file, "model-poses", "expected " + NameList<PoseConvention>());
    run.references.poses = *poses;
    run.references.subsampling = {.every = options.at("every").get<int>(),
                                  .offset = options.at("every-offset").get<int>(),
                                  .per_camera = options.at("every-per-camera").get<bool>()};
    run.geometry = options.at("geometry").get<std::vector<std::string>>();
    const path crs = options.contains("crs") ? PathOption(options, "crs") : path();
    if (!crs.empty()) run.world = WorldFrame::Parse(crs.string());
  } catch (const nlohmann::json::exception& error) {
    throw InputError(file, "is not what localize writes: " + std::string(error.what()));
  }
}

std::vector<Query> ListedQueries(const FinishedRun& run) {
  if (!run.query_list.empty()) return ReadQueryList(run.query_list, run.query_images);
  if (!run.leave_one_out) {
    throw OptionError("--queries is required where RUN is a pose file");
  }
  return QueriesOf(run.references.Load().references);
}

}  // namespace

std::vector<PosedImage> ReadPosedQueries(const path& model_or_file, const path& query_list) {
  if (query_list.empty()) {
    if (!std::filesystem::is_directory(model_or_file)) {
      throw OptionError("--queries is required where the ground truth is a pose file");
    }
    return ReadColmapModel(model_or_file).PosedImages();
  }
  std::map<std::string, Camera> cameras;
  for (const Query& query : ReadQueryList(query_list)) cameras.emplace(query.name, query.camera);
  std::vector<PosedImage> images;
  for (const auto& [name, pose] : ReadModelOrPoses(model_or_file)) {
    const auto camera = cameras.find(name);
    if (camera == cameras.end()) {
      throw InputError(query_list, fmt::format("{}, of the ground truth, is missing", name));
    }
    images.push_back({name, camera->second, pose});
  }
  return images;
}

std::vector<TimedName> InOrderOfTime(const PosesByName& poses, const path& times_file) {
  std::vector<std::string> names;
  for (const auto& [name, pose] : poses) names.push_back(name);
  const auto times = times_file.empty() ? PlacesByNumbers(names) : ReadTimes(times_file);
  std::vector<TimedName> order;
  for (const std::string& name : names) {
    const auto time = times.find(name);
    if (time == times.end()) {
      throw InputError(times_file, fmt::format("the time of {} is missing", name));
    }
    order.push_back({time->second, name});
  }
  std::stable_sort(order.begin(), order.end(),
                   [](const TimedName& a, const TimedName& b) { return a.time_s < b.time_s; });
  return order;
}

std::string ResultName(const path& file) {
  const std::string stem = file.stem().string();
  const std::string folder = file.parent_path().filename().string();
  return stem == "poses" && !folder.empty() ? folder : stem;
}

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
      throw InputError(query_list.empty() ? references.model : query_list,
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
