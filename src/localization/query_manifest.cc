#include "raylift/localization/query_manifest.h"

#include <algorithm>
#include <set>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/json_text.h"
#include "raylift/jobs/manifest_file.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;

Json KnownJson(const KnownNoise& noise) { return {noise.sigma, noise.errors}; }

KnownNoise KnownOf(const Json& json) { return {json.at(0), json.at(1)}; }

Json KnowledgeJson(const SceneKnowledge& knowledge) {
  Json json = {{"geometry_noise", nullptr}, {"scene_noise", nullptr}};
  if (const auto& noise = knowledge.geometry_noise) {
    json["geometry_noise"] = {{"keypoints_px", noise->keypoints_px},
                              {"geometry_px", noise->geometry_px},
                              {"num_views", noise->num_views}};
  }
  if (const auto& noise = knowledge.scene_noise) {
    json["scene_noise"] = {{"keypoint_px", KnownJson(noise->keypoint_px)},
                           {"depth", KnownJson(noise->depth)},
                           {"common_depth", KnownJson(noise->common_depth)},
                           {"keypoint_tail", noise->keypoint_tail},
                           {"keypoint_tail_variance", noise->keypoint_tail_variance}};
  }
  json["warnings"] = knowledge.warnings;
  return json;
}

SceneKnowledge KnowledgeOf(const Json& json) {
  SceneKnowledge knowledge;
  if (const Json& noise = json.at("geometry_noise"); !noise.is_null()) {
    knowledge.geometry_noise = {.keypoints_px = noise.at("keypoints_px"),
                                .geometry_px = noise.at("geometry_px"),
                                .num_views = noise.at("num_views")};
  }
  if (const Json& noise = json.at("scene_noise"); !noise.is_null()) {
    knowledge.scene_noise = {.keypoint_px = KnownOf(noise.at("keypoint_px")),
                             .depth = KnownOf(noise.at("depth")),
                             .common_depth = KnownOf(noise.at("common_depth")),
                             .keypoint_tail = noise.at("keypoint_tail"),
                             .keypoint_tail_variance = noise.at("keypoint_tail_variance")};
  }
  knowledge.warnings = json.at("warnings").get<std::vector<std::string>>();
  return knowledge;
}

RunFacts FactsOf(const Json& json) {
  RunFacts facts;
  facts.num_references = json.at("references");
  for (const Json& used : json.at("geometry")) {
    GeometrySummary& summary = facts.geometry.emplace_back();
    summary.spec = used.at("spec");
    summary.understood = used.at("understood");
    if (const Json& alignment = used.at("alignment"); !alignment.is_null()) {
      summary.alignment = {alignment.at(0), alignment.at(1), alignment.at(2), alignment.at(3)};
    }
  }
  facts.warnings = json.at("warnings").get<std::vector<std::string>>();
  facts.checks_geometry = json.at("checks_geometry");
  facts.knowledge = KnowledgeOf(json.at("knowledge"));
  return facts;
}

QueryRecord RecordOf(const Json& json) {
  QueryRecord record;
  record.place = json.at("place");
  record.key = json.at("key");
  record.diagnostics = JsonText(json.at("diagnostics"));
  record.localized = ParseQueryDiagnostics(record.diagnostics, json.at("name"));
  record.warnings = json.at("warnings").get<std::vector<std::string>>();
  if (const Json& factor = json.at("log_focal_factor"); !factor.is_null()) {
    record.log_focal_factor = factor.get<double>();
  }
  return record;
}

void TakeLine(const std::string& line, QueryManifest& manifest) {
  try {
    const Json json = Json::parse(line);
    if (json.contains("scene")) {
      manifest.facts = FactsOf(json.at("scene"));
      return;
    }
    QueryRecord record = RecordOf(json);
    manifest.records.insert_or_assign(record.key, std::move(record));
  } catch (const nlohmann::json::exception&) {
    return;
  } catch (const InputError&) {
    return;
  }
}

}  // namespace

std::string ToJsonLine(const RunFacts& facts) {
  Json geometry = Json::array();
  for (const GeometrySummary& used : facts.geometry) {
    Json json = {{"spec", used.spec}, {"understood", used.understood}, {"alignment", nullptr}};
    if (const auto& alignment = used.alignment) {
      json["alignment"] = {alignment->mode, alignment->median_factor, alignment->median_before_px,
                           alignment->median_after_px};
    }
    geometry.push_back(std::move(json));
  }
  return JsonText(Json{{"scene",
                        {{"references", facts.num_references},
                         {"geometry", std::move(geometry)},
                         {"warnings", facts.warnings},
                         {"checks_geometry", facts.checks_geometry},
                         {"knowledge", KnowledgeJson(facts.knowledge)}}}});
}

std::string ToJsonLine(const QueryRecord& record) {
  Json json = {{"name", record.localized.name},
               {"place", record.place},
               {"key", record.key},
               {"warnings", record.warnings},
               {"log_focal_factor", nullptr},
               {"diagnostics", Json::parse(record.diagnostics)}};
  if (record.log_focal_factor) json["log_focal_factor"] = *record.log_focal_factor;
  return JsonText(json);
}

QueryManifest ReadQueryManifest(const std::filesystem::path& file) {
  QueryManifest manifest;
  const ManifestText text = ReadManifestText(file);
  manifest.header = text.header;
  for (const std::string& line : text.lines) TakeLine(line, manifest);
  return manifest;
}

void WriteQueryManifest(const std::filesystem::path& file, const QueryManifest& manifest) {
  std::vector<std::string> lines;
  if (manifest.facts) lines.push_back(ToJsonLine(*manifest.facts));
  for (const QueryRecord& record : InOrder(manifest.records)) lines.push_back(ToJsonLine(record));
  WriteManifestText(file, manifest.header, lines);
}

std::vector<QueryRecord> InOrder(const std::map<std::string, QueryRecord>& records) {
  std::vector<QueryRecord> sorted;
  sorted.reserve(records.size());
  for (const auto& [key, record] : records) sorted.push_back(record);
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
  add(facts.knowledge.warnings);
  add(RunWarnings(localized, log_focal_factors, facts.checks_geometry));
  return all;
}

void WriteResults(const std::filesystem::path& out, const RunFacts& facts,
                  std::span<const QueryRecord> records, const std::optional<double>& seconds) {
  std::vector<LocalizedQuery> localized;
  std::vector<std::string> lines;
  for (const QueryRecord& record : records) {
    localized.push_back(record.localized);
    lines.push_back(record.diagnostics);
  }
  WritePoses(out / "poses.txt", localized);
  WriteQueryDiagnostics(out / "queries.jsonl", lines);
  WriteSummary(out / "summary.json", localized,
               {.num_references = facts.num_references,
                .geometry = facts.geometry,
                .warnings = AllWarnings(facts, records),
                .scene_noise = facts.knowledge.scene_noise,
                .seconds = seconds});
}

std::string HeaderDifference(const std::string& there, const std::string& here) {
  const Json a = Json::parse(there, nullptr, /*allow_exceptions=*/false);
  const Json b = Json::parse(here, nullptr, /*allow_exceptions=*/false);
  if (!a.is_object() || !b.is_object()) return "it is no manifest";
  const Json values_there = a.flatten();
  const Json values_here = b.flatten();
  const auto text = [](const Json& values, const std::string& name) -> std::string {
    return values.contains(name) ? JsonText(values.at(name)) : "nothing";
  };
  for (const Json& values : {values_there, values_here}) {
    for (const auto& [name, value] : values.items()) {
      if (text(values_there, name) == text(values_here, name)) continue;
      return fmt::format("{}: {} there, {} here", name.substr(1), text(values_there, name),
                         text(values_here, name));
    }
  }
  return "the order of its fields differs";
}

}  // namespace raylift
