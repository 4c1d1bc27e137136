#include "raylift/localization/result_files.h"

#include <algorithm>
#include <utility>

#include "base/json_text.h"
#include "base/statistics.h"
#include "geometry/pose_json.h"
#include "localization/fields.h"
#include "localization/results/estimate_json.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/io/query_list.h"
#include "raylift/io/view_list.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;

Json QueryJson(const LocalizedQuery& query) {
  const PoseEstimate& estimate = query.estimate;
  Json json = {{"name", query.name},
               {"status", query.localized() ? "ok" : "not localized"},
               {"reason", query.reason},
               {"verdict", ToString(query.verdict())},
               {"confidence", query.confidence()}};
  ForEachNumber<uint64_t>(ConstFieldsOf(query.counts), [&](const std::string& name, size_t count) {
    json[name] = count;
    if (name == "hit") json["points_by_geometry"] = query.counts.points_of_source;
  });
  if (!query.rig.empty()) json["rig"] = query.rig;
  if (query.counts.noise) {
    json["keypoint_noise_px"] = query.counts.noise->keypoints_px;
    json["geometry_noise_px"] = query.counts.noise->geometry_px;
  }
  if (estimate.cam_from_world) json["cam_from_world"] = PoseJson<Json>(*estimate.cam_from_world);
  AddEstimate(estimate, json);
  if (query.rerender_rounds) json["rerender_rounds_kept"] = *query.rerender_rounds;
  return json;
}

Json GeometryJson(std::span<const GeometrySummary> geometry) {
  Json list = Json::array();
  for (const GeometrySummary& used : geometry) {
    Json json = {{"spec", used.spec}, {"understood", used.understood}};
    if (used.alignment) {
      json["alignment"] = {{"mode", used.alignment->mode},
                           {"median_factor", used.alignment->median_factor},
                           {"median_before_px", used.alignment->median_before_px},
                           {"median_after_px", used.alignment->median_after_px}};
    }
    list.push_back(std::move(json));
  }
  return list;
}

Json SceneNoiseJson(const SceneNoise& noise) {
  const auto known = [](const KnownNoise& of_kind) {
    return Json{{"sigma", of_kind.sigma}, {"errors", of_kind.errors}};
  };
  return {{"keypoint_px", known(noise.keypoint_px)},
          {"depth", known(noise.depth)},
          {"common_depth", known(noise.common_depth)},
          {"keypoint_tail", noise.keypoint_tail},
          {"keypoint_tail_variance", noise.keypoint_tail_variance}};
}

Json VerdictsJson(std::span<const LocalizedQuery> queries) {
  Json json = Json::object();
  for (const EnumName<PoseVerdict>& verdict : kEnumNames<PoseVerdict>) {
    json[std::string(verdict.name)] =
        std::count_if(queries.begin(), queries.end(),
                      [&](const LocalizedQuery& q) { return q.verdict() == verdict.value; });
  }
  return json;
}

Json LeastConfidentJson(std::span<const LocalizedQuery> queries) {
  Json json = Json::array();
  for (const LocalizedQuery* query : NotLocalizedOrDoubtful(queries)) {
    json.push_back({{"name", query->name},
                    {"verdict", ToString(query->verdict())},
                    {"confidence", query->confidence()},
                    {"reason", query->reason}});
  }
  return json;
}

// The medians of what each stage counts.
Json MediansJson(std::span<const LocalizedQuery> queries) {
  Json values = Json::object();
  for (const LocalizedQuery& query : queries) {
    ForEachNumber<uint64_t>(ConstFieldsOf(query.counts),
                            [&](const std::string& name, size_t count) {
                              values[name].push_back(static_cast<double>(count));
                            });
  }
  Json medians = Json::object();
  const StageCounts none;
  ForEachNumber<uint64_t>(ConstFieldsOf(none), [&](const std::string& name, size_t) {
    medians[name] = UpperMedianOr(values.value(name, std::vector<double>()), 0);
  });
  return medians;
}

LocalizedQuery LocalizedOf(const Json& json, const std::string& name) {
  LocalizedQuery localized;
  localized.name = name;
  localized.reason = json.at("reason").get<std::string>();
  StageCounts& counts = localized.counts;
  ForEachNumber<uint64_t>(FieldsOf(counts), [&json](const std::string& field, uint64_t& count) {
    count = json.at(field).get<uint64_t>();
  });
  counts.points_of_source = json.at("points_by_geometry").get<std::vector<size_t>>();
  if (json.contains("cam_from_world")) {
    localized.estimate.cam_from_world = PoseFromJson(json.at("cam_from_world"));
  }
  const auto verdict = FromName<PoseVerdict>(json.at("verdict").get<std::string>());
  if (!verdict) throw InputError("verdict: expected failed, doubtful or localized");
  localized.estimate.verdict = *verdict;
  localized.estimate.confidence = json.at("confidence").get<double>();
  localized.estimate.num_keypoints = json.at("keypoints").get<int>();
  localized.estimate.inlier_keypoints = json.at("inlier_keypoints").get<int>();
  if (localized.localized() && !localized.estimate.cam_from_world) {
    throw InputError("a localized query without a pose");
  }
  if (json.contains("refined_camera")) {
    localized.estimate.refined_camera =
        ParseCamera("refined_camera", json.at("refined_camera").get<std::string>());
  }
  if (json.contains("rerender_rounds_kept")) {
    localized.rerender_rounds = json.at("rerender_rounds_kept").get<int>();
  }
  return localized;
}

struct QueryStage {
  const char* name;
  double StageTimes::*milliseconds;
};
constexpr QueryStage kQueryStages[] = {{"match", &StageTimes::match_ms},
                                       {"lift", &StageTimes::lift_ms},
                                       {"filter", &StageTimes::filter_ms},
                                       {"estimate", &StageTimes::estimate_ms},
                                       {"rerender", &StageTimes::rerender_ms}};

double SecondsOf(const QueryStage& stage, std::span<const LocalizedQuery> queries) {
  constexpr double kMilli = 1e-3;
  double sum = 0;
  for (const LocalizedQuery& query : queries) sum += kMilli * query.times.*stage.milliseconds;
  return sum;
}

}  // namespace

nlohmann::ordered_json TimesJson(const StageTimes& times) {
  Json json = Json::object();
  for (const QueryStage& stage : kQueryStages) json[stage.name] = times.*stage.milliseconds;
  return json;
}

StageTimes TimesFromJson(const nlohmann::ordered_json& json) {
  StageTimes times;
  for (const QueryStage& stage : kQueryStages) {
    times.*stage.milliseconds = json.at(stage.name).get<double>();
  }
  return times;
}

std::vector<const LocalizedQuery*> NotLocalizedOrDoubtful(std::span<const LocalizedQuery> queries) {
  std::vector<const LocalizedQuery*> worst;
  for (const LocalizedQuery& query : queries) {
    if (query.verdict() != PoseVerdict::kLocalized) worst.push_back(&query);
  }
  std::stable_sort(worst.begin(), worst.end(),
                   [](const LocalizedQuery* a, const LocalizedQuery* b) {
                     return std::pair(a->localized(), a->confidence()) <
                            std::pair(b->localized(), b->confidence());
                   });
  return worst;
}

RerenderCounts CountRerendered(std::span<const LocalizedQuery> queries) {
  RerenderCounts counts;
  for (const LocalizedQuery& query : queries) {
    counts.asked = counts.asked || query.rerender_rounds.has_value();
    const int kept = query.rerender_rounds.value_or(0);
    counts.rounds_kept += static_cast<size_t>(kept);
    counts.improved += kept > 0 ? 1 : 0;
  }
  return counts;
}

void WritePoses(const std::filesystem::path& path, const std::vector<LocalizedQuery>& queries) {
  std::vector<NamedPose> poses;
  poses.reserve(queries.size());
  for (const LocalizedQuery& query : queries) {
    if (query.localized()) {
      poses.push_back({query.name, *query.estimate.cam_from_world});
    }
  }
  WritePoseFile(path, poses);
}

std::string FormatQueryDiagnostics(const LocalizedQuery& query) {
  return JsonText(QueryJson(query));
}

void WriteQueryDiagnostics(const std::filesystem::path& path,
                           const std::vector<LocalizedQuery>& queries) {
  std::vector<std::string> lines;
  lines.reserve(queries.size());
  for (const LocalizedQuery& query : queries) lines.push_back(FormatQueryDiagnostics(query));
  WriteQueryDiagnostics(path, lines);
}

void WriteQueryDiagnostics(const std::filesystem::path& path, std::span<const std::string> lines) {
  std::string text;
  for (const std::string& line : lines) {
    text += line;
    text += '\n';
  }
  WriteFile(path, text);
}

LocalizedQuery ParseQueryDiagnostics(const std::string& line, const std::string& name) {
  try {
    return LocalizedOf(Json::parse(line), name);
  } catch (const nlohmann::json::exception& error) {
    throw InputError(error.what());
  }
}

std::vector<LocalizedQuery> ReadQueryDiagnostics(const std::filesystem::path& path) {
  std::vector<LocalizedQuery> queries;
  LineReader lines(path);
  while (const auto line = lines.NextContent()) {
    try {
      const Json json = Json::parse(*line);
      queries.push_back(LocalizedOf(json, json.at("name").get<std::string>()));
    } catch (const nlohmann::json::exception&) {
      lines.Fail("is no query's diagnostics, as localize writes them");
    } catch (const InputError& error) {
      lines.Fail(error.what());
    }
  }
  return queries;
}

std::vector<GeometrySummary> SummaryOf(std::span<const SceneSource> geometry) {
  std::vector<GeometrySummary> summaries;
  for (const SceneSource& used : geometry) {
    GeometrySummary& summary = summaries.emplace_back();
    summary.spec = used.spec;
    summary.understood = used.geometry.understood;
    if (!used.alignment) continue;
    summary.alignment = {.mode = std::string(ToString(used.alignment->mode)),
                         .median_factor = used.alignment->median_factor,
                         .median_before_px = used.alignment->median_before_px,
                         .median_after_px = used.alignment->median_after_px};
  }
  return summaries;
}

std::map<std::string, Eigen::Matrix<double, 6, 6>> ReadCovariances(
    const std::filesystem::path& path) {
  std::map<std::string, Eigen::Matrix<double, 6, 6>> covariances;
  const std::string text = ReadFile(path);
  size_t number = 0;
  for (const std::string_view line : SplitBy(text, '\n')) {
    ++number;
    if (line.empty()) continue;
    try {
      const Json json = Json::parse(line);
      const std::string name = json.at("name").get<std::string>();
      if (!json.contains("covariance")) continue;
      const auto rows = json["covariance"].get<std::vector<std::vector<double>>>();
      Eigen::Matrix<double, 6, 6> covariance;
      if (rows.size() != 6) throw InputError(path, "covariance", "must have six rows");
      for (size_t r = 0; r < 6; ++r) {
        if (rows[r].size() != 6) throw InputError(path, "covariance", "must have six columns");
        for (size_t c = 0; c < 6; ++c) {
          covariance(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(c)) = rows[r][c];
        }
      }
      covariances[name] = covariance;
    } catch (const nlohmann::json::exception&) {
      throw InputError(path, fmt::format("line {}", number),
                       "is no query's diagnostics, as localize writes them");
    }
  }
  return covariances;
}

void WriteAlignment(const std::filesystem::path& path, std::span<const SceneSource> geometry) {
  std::string text;
  for (const SceneSource& used : geometry) {
    if (!used.alignment) continue;
    for (const MapAlignment& map : used.alignment->maps) {
      const Json json = {{"geometry", used.spec},
                         {"reference", map.reference},
                         {"matches", map.num_matches},
                         {"own_correction", map.own_correction},
                         {"columns", map.correction.columns},
                         {"rows", map.correction.rows},
                         {"log_factors", map.correction.log_factors},
                         {"shift", map.correction.shift},
                         {"median_before_px", map.median_before_px},
                         {"median_after_px", map.median_after_px}};
      text += JsonText(json);
      text += '\n';
    }
  }
  WriteFile(path, text);
}

std::string Describe(const RunTimes& times, std::span<const LocalizedQuery> queries) {
  std::string stages;
  for (const QueryStage& stage : kQueryStages) {
    const double seconds = SecondsOf(stage, queries);
    if (seconds == 0) continue;
    stages += fmt::format("{} {:.1f} s, ", stage.name, seconds);
  }
  stages += fmt::format("write {:.1f} s", times.writing);
  return fmt::format(
      "{:.1f} s: {:.1f} s to read, {:.1f} s to match, {:.1f} s for what the queries share, {:.1f} "
      "s "
      "for them (all threads: {})",
      times.Total(), times.reading, times.matching, times.learning, times.queries, stages);
}

void WriteTiming(const std::filesystem::path& path, std::span<const LocalizedQuery> queries,
                 const std::optional<RunTimes>& run) {
  std::string text;
  for (const LocalizedQuery& query : queries) {
    Json json = {{"name", query.name}, {"milliseconds", TimesJson(query.times)}};
    text += JsonText(json) + '\n';
  }
  if (run) {
    Json json = {{"seconds", run->Total()},
                 {"stage_seconds",
                  {{"reading", run->reading},
                   {"matching", run->matching},
                   {"learning", run->learning},
                   {"queries", run->queries}}}};
    for (const QueryStage& stage : kQueryStages) {
      SetIn<Json>(json, "thread_seconds", stage.name, SecondsOf(stage, queries));
    }
    SetIn<Json>(json, "thread_seconds", "write", run->writing);
    text += JsonText(json) + '\n';
  }
  WriteFile(path, text);
}

void WriteSummary(const std::filesystem::path& path, const std::vector<LocalizedQuery>& queries,
                  const RunSummary& summary) {
  Json json = {{"queries", queries.size()},
               {"localized", std::count_if(queries.begin(), queries.end(),
                                           [](const LocalizedQuery& q) { return q.localized(); })},
               {"verdicts", VerdictsJson(queries)},
               {"least_confident", LeastConfidentJson(queries)},
               {"references", summary.num_references},
               {"geometry", GeometryJson(summary.geometry)},
               {"medians", MediansJson(queries)},
               {"warnings", summary.warnings}};
  if (summary.scene_noise) json["scene_noise"] = SceneNoiseJson(*summary.scene_noise);
  const RerenderCounts rerender = CountRerendered(queries);
  if (rerender.asked) {
    json["rerender"] = {{"queries_improved", rerender.improved},
                        {"rounds_kept", rerender.rounds_kept}};
  }
  WriteFile(path, JsonText(json, 2) + '\n');
}

}  // namespace raylift
