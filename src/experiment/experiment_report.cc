#include <cmath>
#include <map>

#include "base/json_text.h"
#include "experiment/pivot.h"
#include "report/page.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/text.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;

Json CellJson(const PivotCell& cell) {
  if (!cell.known) return nullptr;
  Json values = Json::array();
  for (size_t v = 0; v < cell.texts.size(); ++v) {
    values.push_back({{"text", cell.texts[v]}, {"place", cell.places[v]}});
  }
  return values;
}

Json TableJson(const PivotTable& table) {
  Json columns = Json::array();
  for (const auto& column : table.columns) columns.push_back(JoinTitles(column));
  Json rows = Json::array();
  for (const PivotTable::Row& row : table.rows) {
    Json cells = Json::array();
    for (const PivotCell& cell : row.cells) cells.push_back(CellJson(cell));
    rows.push_back({{"titles", row.titles},
                    {"uses_ground_truth", row.uses_ground_truth},
                    {"cells", std::move(cells)}});
  }
  return {{"title", table.title},
          {"row_axes", table.row_axes},
          {"columns", std::move(columns)},
          {"value_names", table.value_names},
          {"rows", std::move(rows)}};
}

// Returns the table of a figure: its columns are the panels and the subsampling.
PivotTable FigureTable(const Experiment& experiment, TableLayout table,
                       std::span<const SettingResult> results) {
  table.columns.emplace_back(Axis::kEvery);
  return MakePivot(experiment, table, results);
}

double SubsamplingOf(const std::vector<std::string>& column) {
  return ParseDouble(column.back().substr(2)).value();  // "1/5"
}

Json FigureJson(const PivotTable& table) {
  std::map<std::string, std::vector<size_t>> columns_of_panel;
  std::vector<std::string> panels;  // in order
  for (size_t c = 0; c < table.columns.size(); ++c) {
    const std::vector<std::string>& column = table.columns[c];
    const std::string panel = JoinTitles({column.begin(), column.end() - 1});
    if (columns_of_panel[panel].empty()) panels.push_back(panel);
    columns_of_panel[panel].push_back(c);
  }
  Json charts = Json::array();
  for (const std::string& panel : panels) {
    for (size_t v = 0; v < table.value_names.size(); ++v) {
      Json lines = Json::array();
      for (const PivotTable::Row& row : table.rows) {
        Json points = Json::array();
        for (const size_t c : columns_of_panel[panel]) {
          const PivotCell& cell = row.cells[c];
          if (v < cell.values.size() && std::isfinite(cell.values[v])) {
            points.push_back({SubsamplingOf(table.columns[c]), cell.values[v]});
          }
        }
        const std::string name = JoinTitles(row.titles) + (row.uses_ground_truth ? " *" : "");
        lines.push_back({{"name", name}, {"points", std::move(points)}});
      }
      charts.push_back(
          {{"title", JoinTitles({panel, table.value_names[v]})}, {"lines", std::move(lines)}});
    }
  }
  return {{"title", table.title}, {"percent", !table.low_is_better}, {"panels", std::move(charts)}};
}

Json ClaimJson(const JudgedClaim& claim) {
  Json lines = Json::array();
  const auto rounded = [](double value) { return std::round(10 * value) / 10; };
  for (const ClaimLine& line : claim.lines) {
    lines.push_back({line.place, line.first, line.second, line.measure, rounded(line.first_percent),
                     rounded(line.second_percent),
                     rounded(line.first_percent - line.second_percent),
                     rounded(line.difference_percent.low), rounded(line.difference_percent.high),
                     ToString(line.verdict)});
  }
  return {{"name", claim.name}, {"text", claim.text}, {"lines", std::move(lines)}};
}

}  // namespace

std::string FormatExperimentPage(const Experiment& experiment, std::span<const PivotTable> tables,
                                 std::span<const SettingResult> results,
                                 std::span<const JudgedClaim> claims) {
  Json parts = {{"tables", Json::array()}, {"figures", Json::array()}, {"claims", Json::array()}};
  for (const PivotTable& table : tables) parts["tables"].push_back(TableJson(table));
  for (const TableLayout& figure : experiment.figures) {
    parts["figures"].push_back(FigureJson(FigureTable(experiment, figure, results)));
  }
  for (const JudgedClaim& claim : claims) parts["claims"].push_back(ClaimJson(claim));
  const Json data = {
      {"title", experiment.title},
      {"subtitle", fmt::format("{} scenes, {} settings, {} seeds", experiment.scenes.size(),
                               results.size(), experiment.seeds.size())},
      {"experiment", std::move(parts)}};
  return MakePage(experiment.title, JsonText(data));
}

std::string FormatFigureCsv(const Experiment& experiment, const TableLayout& layout,
                            std::span<const SettingResult> results) {
  const PivotTable table = FigureTable(experiment, layout, results);
  TableRow header = table.column_axes;
  header.insert(header.end(), table.row_axes.begin(), table.row_axes.end());
  header.insert(header.end(), table.value_names.begin(), table.value_names.end());
  std::string text = CsvLine(header);
  for (size_t c = 0; c < table.columns.size(); ++c) {
    for (const PivotTable::Row& row : table.rows) {
      if (!row.cells[c].known) continue;
      TableRow line = table.columns[c];
      line.insert(line.end(), row.titles.begin(), row.titles.end());
      line.insert(line.end(), row.cells[c].texts.begin(), row.cells[c].texts.end());
      text += CsvLine(line);
    }
  }
  return text;
}

}  // namespace raylift
