#include "evaluation/tables.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/json_text.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

std::string Percent(double recall_percent) { return fmt::format("{:.2f}", recall_percent); }

std::string Median(double error) {
  return std::isfinite(error) ? fmt::format("{:.5g}", error) : "inf";
}

nlohmann::ordered_json JsonNumber(const std::string& text) {
  const auto value = ParseDouble(text);
  RAYLIFT_CHECK(value.has_value());
  if (!std::isfinite(*value)) {
    return nullptr;
  }
  return *value;
}

nlohmann::ordered_json CalibrationJson(const Calibration& calibration) {
  const auto number = [](double value) { return JsonNumber(Median(value)); };
  return {{"poses", calibration.poses},
          {"mean_normalized_square", number(calibration.mean_normalized_square)},
          {"median_normalized_square", number(calibration.median_normalized_square)},
          {"coverage_90_percent", number(100 * calibration.coverage_90)},
          {"median_sigmas", number(calibration.median_sigmas)},
          {"below_3_sigma_percent", number(100 * calibration.share_below_3_sigma)}};
}

using Row = TableRow;

// Says how well the covariances of the results fit that have some; empty where none has.
std::string FormatCalibrationText(std::span<const ResultSummary> results) {
  std::vector<Row> rows = {{"covariances", "poses", "mean e2/6", "median e2/6", "in 90% %",
                            "median sigmas", "< 3 sigma %"}};
  for (const ResultSummary& result : results) {
    if (!result.calibration) continue;
    const Calibration& c = *result.calibration;
    rows.push_back({Printable(result.name), std::to_string(c.poses),
                    Median(c.mean_normalized_square), Median(c.median_normalized_square),
                    Percent(100 * c.coverage_90), Median(c.median_sigmas),
                    Percent(100 * c.share_below_3_sigma)});
  }
  return rows.size() > 1 ? AlignColumns(rows) : std::string();
}

// The numbers of a result, in the order of the columns.
Row Numbers(const ResultSummary& result) {
  Row numbers = {std::to_string(result.num_queries), std::to_string(result.num_localized),
                 std::to_string(result.unknown_names.size())};
  for (const double recall : result.recalls_percent) {
    numbers.push_back(Percent(recall));
  }
  numbers.push_back(Median(result.median_position));
  numbers.push_back(Median(result.median_rotation_deg));
  return numbers;
}

}  // namespace

std::string FormatTableText(const ResultTable& table) {
  Row header = {"result", "queries", "localized", "unknown"};
  for (const Threshold& threshold : table.thresholds) {
    header.push_back(fmt::format("{},{}deg %", FormatDouble(threshold.position),
                                 FormatDouble(threshold.rotation_deg)));
  }
  header.insert(header.end(), {"median position", "median deg"});
  std::vector<Row> rows = {header};
  bool any_uses_ground_truth = false;
  for (const ResultSummary& result : table.results) {
    Row row = Numbers(result);
    row.insert(row.begin(), Printable(result.name) + (result.uses_ground_truth ? " *" : ""));
    rows.push_back(std::move(row));
    any_uses_ground_truth = any_uses_ground_truth || result.uses_ground_truth;
  }
  return AlignColumns(rows) + (any_uses_ground_truth ? "* chosen with the ground truth\n" : "") +
         FormatCalibrationText(table.results);
}

std::string FormatTableCsv(const ResultTable& table) {
  Row header = {"name", "uses_ground_truth", "queries", "localized", "unknown"};
  for (const Threshold& threshold : table.thresholds) {
    header.push_back(fmt::format("recall_percent_{}_{}deg", FormatDouble(threshold.position),
                                 FormatDouble(threshold.rotation_deg)));
  }
  header.insert(header.end(), {"median_position", "median_rotation_deg"});
  std::string text = CsvLine(header);
  for (const ResultSummary& result : table.results) {
    Row row = Numbers(result);
    row.insert(row.begin(), {result.name, result.uses_ground_truth ? "true" : "false"});
    text += CsvLine(row);
  }
  return text;
}

std::string FormatTableJson(const ResultTable& table) {
  using Json = nlohmann::ordered_json;
  Json thresholds = Json::array();
  for (const Threshold& threshold : table.thresholds) {
    thresholds.push_back(
        {{"position", threshold.position}, {"rotation_deg", threshold.rotation_deg}});
  }
  Json results = Json::array();
  for (const ResultSummary& result : table.results) {
    Json recalls = Json::array();
    for (const double recall : result.recalls_percent) {
      recalls.push_back(JsonNumber(Percent(recall)));
    }
    results.push_back({{"name", result.name},
                       {"uses_ground_truth", result.uses_ground_truth},
                       {"queries", result.num_queries},
                       {"localized", result.num_localized},
                       {"unknown", result.unknown_names.size()},
                       {"recalls_percent", recalls},
                       {"median_position", JsonNumber(Median(result.median_position))},
                       {"median_rotation_deg", JsonNumber(Median(result.median_rotation_deg))},
                       {"missing_names", result.missing_names},
                       {"unknown_names", result.unknown_names}});
    if (result.calibration) results.back()["calibration"] = CalibrationJson(*result.calibration);
  }
  const Json document = {{"thresholds", thresholds}, {"results", results}};
  return JsonText(document, 2) + '\n';
}

}  // namespace raylift
