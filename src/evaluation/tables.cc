#include "raylift/evaluation/tables.h"

#include <algorithm>
#include <cmath>
#include <string_view>
#include <vector>

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

std::string CsvField(const std::string& text) {
  const bool is_plain = text.find_first_of(",\"\r\n") == std::string::npos && Trim(text) == text;
  if (is_plain) {
    return text;
  }
  std::string quoted = "\"";
  for (const char c : text) {
    quoted += c;
    if (c == '"') {
      quoted += c;
    }
  }
  return quoted + '"';
}

std::string Join(const std::vector<std::string>& fields, std::string_view separator) {
  std::string line;
  for (size_t i = 0; i < fields.size(); ++i) {
    line += i > 0 ? separator : "";
    line += fields[i];
  }
  return line;
}

// Control characters would break the lines of a table.
std::string Printable(std::string text) {
  for (char& c : text) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) {
      c = '?';
    }
  }
  return text;
}

// Characters, not bytes, of UTF-8.
size_t Width(std::string_view text) {
  return static_cast<size_t>(std::count_if(text.begin(), text.end(), [](char c) {
    return (static_cast<unsigned char>(c) & 0xc0) != 0x80;
  }));
}

using Row = std::vector<std::string>;

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

// The first column to the left, numbers to the right.
std::string Align(const std::vector<Row>& rows) {
  std::vector<size_t> widths(rows.front().size(), 0);
  for (const Row& row : rows) {
    for (size_t i = 0; i < row.size(); ++i) {
      widths[i] = std::max(widths[i], Width(row[i]));
    }
  }
  std::string text;
  for (const Row& row : rows) {
    for (size_t i = 0; i < row.size(); ++i) {
      const std::string padding(widths[i] - Width(row[i]), ' ');
      text += i == 0 ? row[i] + padding : "  " + padding + row[i];
    }
    text += '\n';
  }
  return text;
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
  return Align(rows) + (any_uses_ground_truth ? "* chosen with the ground truth\n" : "");
}

std::string FormatTableCsv(const ResultTable& table) {
  Row header = {"name", "uses_ground_truth", "queries", "localized", "unknown"};
  for (const Threshold& threshold : table.thresholds) {
    header.push_back(fmt::format("recall_percent_{}_{}deg", FormatDouble(threshold.position),
                                 FormatDouble(threshold.rotation_deg)));
  }
  header.insert(header.end(), {"median_position", "median_rotation_deg"});
  std::string text = Join(header, ",") + '\n';
  for (const ResultSummary& result : table.results) {
    Row row = Numbers(result);
    row.insert(row.begin(), {CsvField(result.name), result.uses_ground_truth ? "true" : "false"});
    text += Join(row, ",") + '\n';
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
  }
  const Json document = {{"thresholds", thresholds}, {"results", results}};
  // File names need not be UTF-8; what is not is replaced.
  return document.dump(2, ' ', false, Json::error_handler_t::replace) + '\n';
}

}  // namespace raylift
