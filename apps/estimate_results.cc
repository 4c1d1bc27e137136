#include "apps/estimate_results.h"

#include <map>

#include "geometry/pose_json.h"
#include "localization/results/result_json.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/localization/localizer.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr const char* kPoses = "poses.txt";
constexpr const char* kCsv = "estimates.csv";
constexpr const char* kJson = "estimates.json";
constexpr const char* kTiming = "timing.jsonl";
constexpr const char* kTime = "time_ms";

bool HasPose(const EstimateRow& row) { return row.at("status") == "ok"; }

std::string Number(const EstimateRow& value) { return FormatDouble(value.get<double>()); }

TableRow CsvFields(const EstimateRow& row) {
  TableRow fields = {row.at("name"), row.at("method"), row.at("status")};
  if (row.contains("qvec")) {
    for (const char* vector : {"qvec", "tvec"}) {
      for (const EstimateRow& number : row.at(vector)) fields.push_back(Number(number));
    }
  } else {
    fields.resize(fields.size() + 7);
  }
  for (const char* count : {"inliers_2d3d", "inliers_2d2d", "iterations"}) {
    fields.push_back(std::to_string(row.at(count).get<int>()));
  }
  fields.push_back(row.value("solver", ""));
  if (row.contains(kTime)) fields.push_back(fmt::format("{:.3f}", row[kTime].get<double>()));
  fields.push_back(row.at("verdict"));
  fields.push_back(Number(row.at("confidence")));
  for (const char* sigma : {"rotation_sigma_deg", "position_sigma"}) {
    fields.push_back(row.contains(sigma) ? Number(row.at(sigma)) : "");
  }
  return fields;
}

// Returns the row of a manifest's line. Throws InputError or an exception of the JSON library where
// it holds none.
EstimateRow RowOf(const std::string& line) {
  EstimateRow row = EstimateRow::parse(line).at("estimate");
  CsvFields(row);
  if (HasPose(row)) FromJson<Rigid3>(row);
  return row;
}

}  // namespace

EstimateRow MakeEstimateRow(const std::string& name, const std::string& file, Method method,
                            const PoseEstimate& estimate, double time_ms) {
  const std::string reason = ReasonNotLocalized(estimate);
  const bool ok = reason.empty();
  EstimateRow row = {{"name", name},
                     {"file", file},
                     {"method", ToString(method)},
                     {"status", ok ? "ok" : reason},
                     {"verdict", ToString(ok ? estimate.verdict : PoseVerdict::kFailed)},
                     {"confidence", ok ? estimate.confidence : 0},
                     {"inliers_2d3d", estimate.score_2d3d.num_inliers},
                     {"inliers_2d2d", estimate.score_2d2d.num_inliers},
                     {kTime, time_ms}};
  if (estimate.cam_from_world) row.update(ToJson(*estimate.cam_from_world));
  row.update(ToJson(estimate));
  return row;
}

std::string FormatEstimatesCsv(std::span<const EstimateRow> rows) {
  TableRow names = {"name",         "method",       "status",     "qw",    "qx",
                    "qy",           "qz",           "tx",         "ty",    "tz",
                    "inliers_2d3d", "inliers_2d2d", "iterations", "solver"};
  if (!rows.empty() && rows.front().contains(kTime)) names.emplace_back(kTime);
  for (const char* name : {"verdict", "confidence", "rotation_sigma_deg", "position_sigma"}) {
    names.emplace_back(name);
  }
  std::string text = CsvLine(names);
  for (const EstimateRow& row : rows) text += CsvLine(CsvFields(row));
  return text;
}

std::string FormatEstimatesJson(std::span<const EstimateRow> rows) {
  EstimateRow json = EstimateRow::array();
  for (const EstimateRow& row : rows) json.push_back(row);
  return JsonText(json, 1) + '\n';
}

std::vector<NamedPose> PosesOf(std::span<const EstimateRow> rows) {
  std::vector<NamedPose> poses;
  for (const EstimateRow& row : rows) {
    if (HasPose(row)) poses.push_back({row.at("name"), FromJson<Rigid3>(row)});
  }
  return poses;
}

void PrintEstimates(std::span<const EstimateRow> rows) {
  size_t count = 0;
  for (const EstimateRow& row : rows) {
    if (HasPose(row)) {
      ++count;
      continue;
    }
    fmt::print("no pose: {}: {}\n", row.at("name").get<std::string>(),
               row.at("status").get<std::string>());
  }
  fmt::print("{}: {} of {} problems have a pose\n", rows.front().at("method").get<std::string>(),
             count, rows.size());
}

JobForm EstimateJobForm() {
  return {.results = {kCsv, kJson, kPoses}, .is_readable = [](const std::string& line) {
            try {
              RowOf(line);
              return true;
            } catch (const nlohmann::json::exception&) {
              return false;
            } catch (const InputError&) {
              return false;
            }
          }};
}

std::string EstimateLine(size_t place, const std::string& key, const EstimateRow& row) {
  return JsonText(
      EstimateRow{{"name", row.at("file")}, {"place", place}, {"key", key}, {"estimate", row}});
}

std::vector<EstimateRow> EstimateRowsOf(const TaskManifest& manifest) {
  std::map<size_t, EstimateRow> in_order;
  for (const auto& [key, record] : manifest.records) {
    in_order.emplace(record.place, RowOf(record.line));
  }
  std::vector<EstimateRow> rows;
  rows.reserve(in_order.size());
  for (auto& [place, row] : in_order) rows.push_back(std::move(row));
  return rows;
}

void WriteEstimatedPoses(const path& file, std::span<const EstimateRow> rows) {
  std::map<std::string, std::string> file_of_name;
  for (const EstimateRow& row : rows) {
    const auto [first, is_new] = file_of_name.emplace(row.at("name"), row.at("file"));
    if (is_new) continue;
    throw InputError(row.at("file").get<std::string>(), "name",
                     fmt::format("\"{}\" stands twice (also in {}): a pose file has a name once",
                                 first->first, first->second));
  }
  WritePoseFile(file, PosesOf(rows));
}

void WriteEstimates(const path& out, std::span<const EstimateRow> rows) {
  std::vector<EstimateRow> timeless(rows.begin(), rows.end());
  std::string timing;
  for (EstimateRow& row : timeless) {
    if (!row.contains(kTime)) continue;  // from a run that was complete
    timing += JsonText(EstimateRow{{"name", row.at("file")}, {"milliseconds", row[kTime]}}) + '\n';
    row.erase(kTime);
  }
  WriteFile(out / kJson, FormatEstimatesJson(timeless));
  WriteEstimatedPoses(out / kPoses, timeless);
  WriteFile(out / kCsv, FormatEstimatesCsv(timeless));
  if (!timing.empty()) WriteFile(out / kTiming, timing);
}

TaskManifest WithoutTimes(TaskManifest manifest) {
  for (auto& [key, record] : manifest.records) {
    EstimateRow line = EstimateRow::parse(record.line);
    line.at("estimate").erase(kTime);
    record.line = JsonText(line);
  }
  return manifest;
}

}  // namespace raylift
