#include "localization/results/query_job.h"

#include <algorithm>
#include <set>
#include <system_error>
#include <utility>

#include "geometry/pose_json.h"
#include "jobs/file_promises.h"
#include "localization/checks/run_checks.h"
#include "localization/results/result_json.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/io/query_list.h"

namespace raylift {

JobForm QueryJobForm(const std::filesystem::path& out) {
  JobForm form{.results = {"queries.jsonl", "poses.txt", "summary.json"},
               .is_readable = &IsReadableLine};
  const std::vector<std::string> of_walks = WalkFilesIn(out);
  form.results.insert(form.results.end(), of_walks.begin(), of_walks.end());
  return form;
}

TrajectoryFiles TrajectoryFilesOf(size_t number) {
  const std::string end = number == 0 ? ".txt" : fmt::format("_{}.txt", number);
  return {"trajectory" + end, "trajectory_covariance" + end};
}

namespace {

// Returns how many walks of a list walk.json tells of; 0 where it is no list's, or not readable.
size_t WalksOfList(const std::filesystem::path& file) {
  try {
    const auto json = nlohmann::json::parse(ReadFile(file), nullptr, /*allow_exceptions=*/false);
    return json.is_object() && json.contains("walks") ? json.at("walks").size() : 0;
  } catch (const InputError&) {
    return 0;
  }
}

}  // namespace

std::vector<std::string> WalkFilesIn(const std::filesystem::path& out) {
  if (!Exists(out / kWalkFile)) return {};
  const size_t of_list = WalksOfList(out / kWalkFile);
  std::vector<std::string> names;
  for (size_t number = of_list > 0 ? 1 : 0; number <= of_list; ++number) {
    TrajectoryFiles files = TrajectoryFilesOf(number);
    names.insert(names.end(), {std::move(files.poses), std::move(files.covariances)});
  }
  names.emplace_back(kWalkFile);
  return names;
}

QueryJob::QueryJob(std::span<const Query> queries, const std::string& header,
                   const JobFolder& folder)
    : names_(NamesOf(queries)),
      job_(names_, header, folder, QueryJobForm(folder.out)),
      facts_(FactsOf(job_.manifest())) {
  for (const QueryRecord& record : RecordsOf(job_.manifest())) {
    told_.insert(record.warnings.begin(), record.warnings.end());
  }
}

void QueryJob::Begin(const RunFacts& facts) {
  job_.Begin(ToJsonLine(facts));
  facts_ = facts;
}

std::map<size_t, std::optional<JoinedReference>> QueryJob::Joined() const {
  std::map<size_t, std::optional<JoinedReference>> joined;
  for (QueryRecord& record : RecordsOf(job_.manifest())) {
    TakeNames(record);
    joined.emplace(record.place, std::move(record.joined));
  }
  return joined;
}

void QueryJob::Add(size_t query, QueryRecord record) {
  record.place = query;
  record.key = job_.key(query);
  TakeNames(record);
  const std::lock_guard<std::mutex> lock(mutex_);
  std::erase_if(record.warnings,
                [this](const std::string& warning) { return !told_.insert(warning).second; });
  job_.Add(query, ToJsonLine(record));
}

void QueryJob::TakeNames(QueryRecord& record) const {
  record.localized.name = names_[record.place];
  if (record.joined) record.joined->image.name = names_[record.place];
}

std::optional<std::vector<QueryRecord>> QueryJob::Whole() {
  std::optional<TaskManifest> whole = job_.Whole();
  if (!whole) return std::nullopt;
  std::vector<QueryRecord> records = RecordsOf(*whole);
  whole_ = WithRecords(std::move(*whole), records);
  for (QueryRecord& record : records) TakeNames(record);
  return records;
}

void QueryJob::Finish(std::span<const std::filesystem::path> results) {
  job_.Finish(whole_, results);
}

using Json = nlohmann::ordered_json;

namespace {

// A line of facts on the scene.
struct SceneFacts {
  RunFacts& facts;
};

}  // namespace

static void Members(JsonMembers& members, SceneFacts& scene) {
  RunFacts& facts = scene.facts;
  members("references", facts.num_references);
  members("geometry", facts.geometry);
  members("warnings", facts.warnings);
  members("checks_geometry", facts.checks_geometry);
  members("calibration", facts.calibration);
  members("input_warnings", facts.input_warnings);
}

static void Members(JsonMembers& members, RunFacts& facts) {
  SceneFacts scene{facts};
  members("scene", scene);
  members("files", facts.files);
}

static void Members(JsonMembers& members, PointLink& link) {
  members.Row(link.pixel.x(), link.pixel.y(), link.point_in_world.x(), link.point_in_world.y(),
              link.point_in_world.z());
}

static void Members(JsonMembers& members, JoinedReference& joined) {
  std::string camera = joined.image.camera.ToString();
  members("camera", camera);
  joined.image.camera = ParseCamera("camera", camera);
  members("cam_from_world", joined.image.cam_from_world);
  members("covariance", joined.covariance);
  members("distance", joined.distance);
  members("links", joined.links);
}

static void Members(JsonMembers& members, QueryRecord& record) {
  members("name", record.localized.name);
  members("place", record.place);
  members("key", record.key);
  members("warnings", record.warnings);
  members("log_focal_factor", record.log_focal_factor);
  StageTimes& times = record.localized.times;
  double all_ms = 0;
  for (const QueryStage& stage : kQueryStages) all_ms += times.*stage.milliseconds;
  members.If(all_ms > 0, "milliseconds", times);
  MembersOfDiagnostics(members, record.diagnostics, record.localized);
  members.If(record.joined.has_value(), "joined", record.joined);
  members("files", record.files);
}

std::string ToJsonLine(const RunFacts& facts) { return JsonText(ToJson(facts)); }

std::string ToJsonLine(const QueryRecord& record) { return JsonText(ToJson(record)); }

bool IsReadableLine(const std::string& line) {
  try {
    const Json json = Json::parse(line);
    if (json.contains("scene")) {
      FromJson<RunFacts>(json);
    } else {
      FromJson<QueryRecord>(json);
    }
    return true;
  } catch (const nlohmann::json::exception&) {
    return false;
  } catch (const InputError&) {
    return false;
  }
}

std::optional<RunFacts> FactsOf(const TaskManifest& manifest) {
  if (!manifest.facts) return std::nullopt;
  return ParseJson<RunFacts>(*manifest.facts);
}

std::vector<QueryRecord> RecordsOf(const TaskManifest& manifest) {
  std::vector<QueryRecord> sorted;
  sorted.reserve(manifest.records.size());
  for (const auto& [key, record] : manifest.records) {
    sorted.push_back(ParseJson<QueryRecord>(record.line));
  }
  std::sort(sorted.begin(), sorted.end(),
            [](const QueryRecord& a, const QueryRecord& b) { return a.place < b.place; });
  std::set<std::string> warnings;
  for (QueryRecord& record : sorted) {
    warnings.insert(record.warnings.begin(), record.warnings.end());
    record.warnings.clear();
  }
  if (!sorted.empty()) sorted.front().warnings.assign(warnings.begin(), warnings.end());
  return sorted;
}

TaskManifest WithRecords(TaskManifest manifest, std::span<const QueryRecord> records) {
  manifest.records.clear();
  for (const QueryRecord& record : records) {
    QueryRecord timeless = record;
    timeless.localized.times = {};
    manifest.records.insert_or_assign(record.key, TaskRecord{record.place, ToJsonLine(timeless)});
  }
  return manifest;
}

std::vector<std::string> AllWarnings(const RunFacts& facts, std::span<const QueryRecord> records) {
  std::set<std::string> of_matches;
  std::vector<LocalizedQuery> localized;
  std::vector<double> log_focal_factors;
  for (const QueryRecord& record : records) {
    of_matches.insert(record.warnings.begin(), record.warnings.end());
    localized.push_back(record.localized);
    if (record.log_focal_factor) log_focal_factors.push_back(*record.log_focal_factor);
  }
  std::vector<std::string> all = facts.warnings;
  const auto add = [&all](const auto& more) { all.insert(all.end(), more.begin(), more.end()); };
  add(of_matches);
  add(facts.input_warnings);
  // Where a warning names the repair, a second one that something is wrong is left out.
  add(RunWarnings(localized, log_focal_factors,
                  facts.checks_geometry && facts.input_warnings.empty()));
  return all;
}

void WriteResults(const std::filesystem::path& out, const RunFacts& facts,
                  std::span<const QueryRecord> records, const std::optional<RunTimes>& times) {
  std::vector<LocalizedQuery> localized;
  std::vector<std::string> lines;
  for (const QueryRecord& record : records) {
    localized.push_back(record.localized);
    lines.push_back(record.diagnostics);
  }
  WriteSceneCalibration(out / "scene_calibration.json", facts.calibration);
  WritePoses(out / "poses.txt", localized);
  WriteQueryDiagnostics(out / "queries.jsonl", lines);
  WriteSummary(out / "summary.json", localized,
               {.num_references = facts.num_references,
                .geometry = facts.geometry,
                .warnings = AllWarnings(facts, records),
                .scene_noise = facts.calibration.match_noise});
  WriteTiming(out / "timing.jsonl", localized, times);
}

}  // namespace raylift
