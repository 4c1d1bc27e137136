#include "raylift/localization/result_files.h"

#include <algorithm>
#include <utility>

#include "base/json_text.h"
#include "base/statistics.h"
#include "localization/fields.h"
#include "localization/results/result_json.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;

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

// Returns the medians of each stage's counts.
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

double SecondsOf(const QueryStage& stage, std::span<const LocalizedQuery> queries) {
  constexpr double kMilli = 1e-3;
  double sum = 0;
  for (const LocalizedQuery& query : queries) sum += kMilli * query.times.*stage.milliseconds;
  return sum;
}

// Returns whether a query has times; queries of a former run that was complete have none.
bool HasTimes(const StageTimes& times) {
  return std::any_of(std::begin(kQueryStages), std::end(kQueryStages),
                     [&](const QueryStage& stage) { return times.*stage.milliseconds > 0; });
}

}  // namespace

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

std::string FormatQueryDiagnostics(const LocalizedQuery& query) { return JsonText(ToJson(query)); }

void WriteQueryDiagnostics(const std::filesystem::path& path, std::span<const std::string> lines) {
  std::string text;
  for (const std::string& line : lines) {
    text += line;
    text += '\n';
  }
  WriteFile(path, text);
}

std::vector<LocalizedQuery> ReadQueryDiagnostics(const std::filesystem::path& path) {
  std::vector<LocalizedQuery> queries;
  LineReader lines(path);
  while (const auto line = lines.NextContent()) {
    try {
      queries.push_back(ParseJson<LocalizedQuery>(*line));
    } catch (const InputError& error) {
      lines.Fail(
          fmt::format("is no query's diagnostics, as localize writes them: {}", error.what()));
    }
  }
  return queries;
}

std::vector<GeometrySummary> SummaryOf(std::span<const SceneSource> geometry) {
  std::vector<GeometrySummary> summaries;
  for (const SceneSource& used : geometry) {
    GeometrySummary& summary = summaries.emplace_back();
    summary.spec = used.spec;
    summary.interpretation = used.geometry.interpretation;
    if (!used.alignment) continue;
    summary.alignment = {.mode = std::string(ToString(used.alignment->mode)),
                         .median_factor = used.alignment->median_factor,
                         .median_before_px = used.alignment->median_before_px,
                         .median_after_px = used.alignment->median_after_px};
  }
  return summaries;
}

void WriteAlignment(const std::filesystem::path& path, std::span<const SceneSource> geometry) {
  std::string text;
  for (const SceneSource& used : geometry) {
    if (!used.alignment) continue;
    for (const MapAlignment& map : used.alignment->maps) {
      Json json = {{"geometry", used.spec}};
      json.update(ToJson(map));
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
      "s for them (all threads: {})",
      times.Total(), times.reading, times.matching, times.learning, times.queries, stages);
}

void WriteTiming(const std::filesystem::path& path, std::span<const LocalizedQuery> queries,
                 const std::optional<RunTimes>& run) {
  std::string text;
  for (const LocalizedQuery& query : queries) {
    if (!HasTimes(query.times)) continue;
    Json json = {{"name", query.name}, {"milliseconds", ToJson(query.times)}};
    text += JsonText(json) + '\n';
  }
  if (text.empty() && Exists(path)) return;
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
  const auto localized = std::count_if(
      queries.begin(), queries.end(),
      [](const LocalizedQuery& query) { return query.verdict() == PoseVerdict::kLocalized; });
  Json json = {{"queries", queries.size()},
               {"localized", localized},  // doubtful poses are among the verdicts alone
               {"verdicts", VerdictsJson(queries)},
               {"least_confident", LeastConfidentJson(queries)},
               {"references", summary.num_references},
               {"geometry", ToJson(summary.geometry)},
               {"medians", MediansJson(queries)},
               {"warnings", summary.warnings}};
  if (summary.scene_noise) json["scene_noise"] = ToJson(*summary.scene_noise);
  const RerenderCounts rerender = CountRerendered(queries);
  if (rerender.asked) {
    json["rerender"] = {{"queries_improved", rerender.improved},
                        {"rounds_kept", rerender.rounds_kept}};
  }
  WriteFile(path, JsonText(json, 2) + '\n');
}

}  // namespace raylift
