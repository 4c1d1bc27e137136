#include "experiment/pivot.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <set>
#include <utility>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

std::string FilterTitle(const Experiment& experiment, const Setting& setting, FilterPart part) {
  if (!Matters(setting[Axis::kFilter])) return {};
  const NamedFilter& filter = experiment.FilterOf(setting);
  if (filter.mode == FilterMode::kOff) return "-";
  if (filter.mode == FilterMode::kAuto) return "auto";
  const ConsistencyThresholds& thresholds = filter.thresholds;
  switch (part) {
    case FilterPart::kReprojectionPx:
      return FormatDouble(thresholds.reprojection_px);
    case FilterPart::kMinViews:
      return std::to_string(thresholds.min_views);
    case FilterPart::kMinRatio:
      return thresholds.min_ratio > 0 ? FormatDouble(thresholds.min_ratio) : "-";
  }
  RAYLIFT_CHECK(false);
}

// Returns the text that tells settings apart on an axis; empty if it does not matter.
std::string Value(const Experiment& experiment, const Setting& setting, LayoutAxis axis) {
  if (const Axis* known = std::get_if<Axis>(&axis)) return TextOf(setting[*known]);
  return FilterTitle(experiment, setting, std::get<FilterPart>(axis));
}

std::vector<std::string> ValuesOf(const Experiment& experiment, const Setting& setting,
                                  const std::vector<LayoutAxis>& axes) {
  std::vector<std::string> values;
  values.reserve(axes.size());
  for (const LayoutAxis axis : axes) values.push_back(Value(experiment, setting, axis));
  return values;
}

// Returns whether a setting belongs to a column: axes that do not matter to it may differ.
bool Fits(const std::vector<std::string>& of_setting, const std::vector<std::string>& column) {
  for (size_t i = 0; i < column.size(); ++i) {
    if (!of_setting[i].empty() && of_setting[i] != column[i]) return false;
  }
  return true;
}

// Returns the results ordered by the first axis, then the second ..., each in the order in which
// its values come in the grid.
std::vector<const SettingResult*> OrderedBy(const Experiment& experiment,
                                            const std::vector<LayoutAxis>& axes,
                                            std::vector<const SettingResult*> results) {
  std::vector<std::map<std::string, size_t>> ranks(axes.size());
  std::map<const SettingResult*, std::vector<size_t>> keys;
  for (const SettingResult* result : results) {
    const auto values = ValuesOf(experiment, result->setting, axes);
    std::vector<size_t>& key = keys[result];  // empty without axes
    for (size_t i = 0; i < axes.size(); ++i) {
      key.push_back(ranks[i].emplace(values[i], ranks[i].size()).first->second);
    }
  }
  std::stable_sort(
      results.begin(), results.end(),
      [&](const SettingResult* a, const SettingResult* b) { return keys.at(a) < keys.at(b); });
  return results;
}

struct PrintedValue {
  double value;
  std::string text;
};

PrintedValue Printed(double value, int digits) {
  if (!std::isfinite(value)) return {value, "inf"};
  std::string text = fmt::format("{:.{}f}", value, digits);
  return {ParseDouble(text).value(), std::move(text)};
}

std::vector<PrintedValue> PrintedValues(const SettingResult& result, TableValue value) {
  std::vector<PrintedValue> printed;
  switch (value) {
    case TableValue::kRecalls:
      for (size_t t = 0; t < result.thresholds.size(); ++t) {
        printed.push_back(Printed(result.RecallPercent(t), 1));
      }
      break;
    case TableValue::kAuc:
      for (size_t t = 0; t < result.thresholds.size(); ++t) {
        printed.push_back(Printed(result.AucPercent(t), 1));
      }
      break;
    case TableValue::kMedian:
      printed.push_back(Printed(result.MedianPosition(), 4));
      printed.push_back(Printed(result.MedianRotationDeg(), 3));
      break;
    case TableValue::kLocalized:
      printed.push_back(Printed(result.LocalizedPercent(), 1));
      break;
  }
  return printed;
}

// Returns the thresholds where all scenes have the same, else their numbers.
std::vector<std::string> NamesOfValues(TableValue value,
                                       std::span<const SettingResult* const> all) {
  if (value == TableValue::kMedian) return {"position", "deg"};
  if (value == TableValue::kLocalized) return {"localized %"};
  std::vector<std::string> names;
  size_t count = 0;
  for (const SettingResult* result : all) count = std::max(count, result->thresholds.size());
  for (size_t t = 0; t < count; ++t) {
    std::set<std::string> texts;
    for (const SettingResult* result : all) {
      if (t >= result->thresholds.size()) continue;
      texts.insert(fmt::format("({}, {}deg)", FormatDouble(result->thresholds[t].position),
                               FormatDouble(result->thresholds[t].rotation_deg)));
    }
    names.push_back(texts.size() == 1 ? *texts.begin() : fmt::format("threshold {}", t + 1));
  }
  return names;
}

void RankColumn(PivotTable& table, size_t column) {
  for (size_t v = 0; v < table.value_names.size(); ++v) {
    std::set<double> values;
    const auto ranked = [&](const PivotTable::Row& row) {
      return !row.uses_ground_truth && row.cells[column].known &&
             v < row.cells[column].values.size();
    };
    for (const PivotTable::Row& row : table.rows) {
      if (ranked(row)) values.insert(row.cells[column].values[v]);
    }
    std::vector<double> order(values.begin(), values.end());
    if (!table.low_is_better) std::reverse(order.begin(), order.end());
    for (PivotTable::Row& row : table.rows) {
      if (!ranked(row)) continue;
      PivotCell& cell = row.cells[column];
      const auto place = std::find(order.begin(), order.end(), cell.values[v]) - order.begin();
      cell.places[v] = place < 3 ? static_cast<int>(place) + 1 : 0;
    }
  }
}

std::string AxisTitle(LayoutAxis axis) {
  return std::visit([](auto known) { return std::string(TitleOf(known)); }, axis);
}

}  // namespace

std::string ValueTitle(const Experiment& experiment, const Setting& setting, LayoutAxis axis) {
  std::string text = Value(experiment, setting, axis);
  const Axis* known = std::get_if<Axis>(&axis);
  if (text.empty() || known == nullptr) return text;
  switch (*known) {
    case Axis::kScene:
      return experiment.SceneOf(setting).title;
    case Axis::kEvery:
      return "1/" + text;
    case Axis::kGeometry:
      return experiment.GeometryOf(setting)->title;
    case Axis::kMethod:
      return setting.IsOracle() ? "Oracle"
                                : std::string(TitleOf(std::get<Method>(setting[Axis::kMethod])));
    case Axis::kScore:
      return std::string(TitleOf(std::get<ScoreCombination>(setting[Axis::kScore])));
    case Axis::kAlign:
    case Axis::kFilter:
    case Axis::kLo:
    case Axis::kAlpha:
      return text;
  }
  RAYLIFT_CHECK(false);
}

PivotTable MakePivot(const Experiment& experiment, const TableLayout& layout,
                     std::span<const SettingResult> results) {
  PivotTable table;
  table.name = layout.name;
  table.title = layout.title;
  table.low_is_better = layout.value == TableValue::kMedian;
  for (const LayoutAxis axis : layout.rows) table.row_axes.push_back(AxisTitle(axis));
  for (const LayoutAxis axis : layout.columns) table.column_axes.push_back(AxisTitle(axis));

  std::vector<const SettingResult*> shown;
  for (const SettingResult& result : results) {
    if (layout.where.Matches(result.setting)) shown.push_back(&result);
  }
  table.value_names = NamesOfValues(layout.value, shown);

  std::vector<std::vector<std::string>> row_keys, column_keys;
  const auto has_all = [](const std::vector<std::string>& values) {
    return std::none_of(values.begin(), values.end(),
                        [](const std::string& value) { return value.empty(); });
  };
  const auto add = [](std::vector<std::vector<std::string>>& keys,
                      const std::vector<std::string>& key) {
    const bool is_new = std::find(keys.begin(), keys.end(), key) == keys.end();
    if (is_new) keys.push_back(key);
    return is_new;
  };
  const auto titles = [&](const Setting& setting, const std::vector<LayoutAxis>& axes) {
    std::vector<std::string> texts;
    texts.reserve(axes.size());
    for (const LayoutAxis axis : axes) texts.push_back(ValueTitle(experiment, setting, axis));
    return texts;
  };
  for (const bool complete : {true, false}) {
    if (!complete && !column_keys.empty()) break;
    for (const SettingResult* result : OrderedBy(experiment, layout.columns, shown)) {
      const auto key = ValuesOf(experiment, result->setting, layout.columns);
      if (has_all(key) != complete) continue;
      if (add(column_keys, key)) table.columns.push_back(titles(result->setting, layout.columns));
    }
  }
  for (const SettingResult* result : OrderedBy(experiment, layout.rows, shown)) {
    if (!add(row_keys, ValuesOf(experiment, result->setting, layout.rows))) continue;
    PivotTable::Row& row = table.rows.emplace_back();
    row.titles = titles(result->setting, layout.rows);
    row.uses_ground_truth = result->uses_ground_truth;
    row.cells.resize(column_keys.size());
  }
  std::map<std::pair<size_t, size_t>, const Setting*> taken;
  for (const SettingResult* result : shown) {
    const auto row_key = ValuesOf(experiment, result->setting, layout.rows);
    const auto r = static_cast<size_t>(std::find(row_keys.begin(), row_keys.end(), row_key) -
                                       row_keys.begin());
    const auto column_key = ValuesOf(experiment, result->setting, layout.columns);
    for (size_t c = 0; c < column_keys.size(); ++c) {
      if (!Fits(column_key, column_keys[c])) continue;
      const auto [other, is_first] = taken.emplace(std::pair(r, c), &result->setting);
      if (!is_first) {
        throw InputError(experiment.file, "table " + layout.name,
                         fmt::format("{} and {} fall into one cell: name what tells them apart in "
                                     "rows, columns or where",
                                     other->second->Name(), result->setting.Name()));
      }
      PivotCell& cell = table.rows[r].cells[c];
      cell.known = !result->comparisons.empty();
      if (!cell.known) continue;
      for (PrintedValue& printed : PrintedValues(*result, layout.value)) {
        cell.values.push_back(printed.value);
        cell.texts.push_back(std::move(printed.text));
      }
      cell.places.assign(cell.values.size(), 0);
    }
  }
  for (size_t c = 0; c < column_keys.size(); ++c) RankColumn(table, c);
  return table;
}

// Writes a table as text, Markdown, CSV and LaTeX.
namespace {

// Returns the text of a cell, each value marked by its rank.
template <typename Mark>
std::string CellText(const PivotCell& cell, const Mark& mark) {
  if (!cell.known) return "-";
  std::string text;
  for (size_t v = 0; v < cell.texts.size(); ++v) {
    if (v > 0) text += " / ";
    text += mark(cell.texts[v], cell.places[v]);
  }
  return text;
}

std::string FirstTitle(const PivotTable::Row& row) {
  return (row.titles.empty() ? std::string() : row.titles.front()) +
         (row.uses_ground_truth ? " *" : "");
}

TableRow RowTitles(const PivotTable::Row& row) {
  TableRow titles = row.titles;
  if (!titles.empty()) titles.front() = FirstTitle(row);
  return titles;
}

bool AnyUsesGroundTruth(const PivotTable& table) {
  return std::any_of(table.rows.begin(), table.rows.end(),
                     [](const PivotTable::Row& row) { return row.uses_ground_truth; });
}

std::string Note(const PivotTable& table) {
  return JoinTitles(table.value_names, " / ") +
         (AnyUsesGroundTruth(table) ? "; * chosen with the ground truth" : "");
}

std::string MarkdownLine(const TableRow& fields) {
  std::string line = "|";
  for (const std::string& field : fields) line += " " + field + " |";
  return line + "\n";
}

// Fields that are empty stand as well.
std::string LatexFields(const TableRow& fields) {
  std::string line;
  for (size_t i = 0; i < fields.size(); ++i) line += (i == 0 ? "" : " & ") + fields[i];
  return line + " \\\\\n";
}

// Returns one line of column titles; equal neighbors share one.
std::string LatexHeader(const PivotTable& table, size_t axis) {
  TableRow fields;
  const bool is_last = axis + 1 == std::max<size_t>(table.column_axes.size(), 1);
  for (const std::string& title : table.row_axes) {
    fields.push_back(is_last ? EscapeLatex(title) : "");
  }
  for (size_t c = 0; c < table.columns.size();) {
    size_t end = c + 1;
    const auto same = [&](size_t other) {
      return std::equal(table.columns[c].begin(),
                        table.columns[c].begin() + static_cast<std::ptrdiff_t>(axis) + 1,
                        table.columns[other].begin());
    };
    while (!is_last && end < table.columns.size() && same(end)) ++end;
    const std::string title = table.column_axes.empty() ? "" : EscapeLatex(table.columns[c][axis]);
    fields.push_back(end - c == 1 ? title
                                  : fmt::format("\\multicolumn{{{}}}{{l}}{{{}}}", end - c, title));
    c = end;
  }
  return LatexFields(fields);
}

constexpr std::string_view kEscapedInLatex = "&%$#_{}";
constexpr std::pair<char, std::string_view> kLatexNames[] = {
    {'\\', "\\textbackslash{}"}, {'~', "\\textasciitilde{}"}, {'^', "\\textasciicircum{}"},
    {'<', "\\textless{}"},       {'>', "\\textgreater{}"},    {'\n', " "}};

}  // namespace

std::string JoinTitles(const std::vector<std::string>& parts, std::string_view between) {
  std::string joined;
  for (const std::string& part : parts) {
    if (!joined.empty() && !part.empty()) joined += between;
    joined += part;
  }
  return joined;
}

std::string FormatPivotText(const PivotTable& table) {
  TableRow header = table.row_axes;
  for (const auto& column : table.columns) header.push_back(JoinTitles(column, ", "));
  std::vector<TableRow> lines = {header};
  for (const PivotTable::Row& row : table.rows) {
    TableRow line = RowTitles(row);
    for (const PivotCell& cell : row.cells) {
      line.push_back(CellText(
          cell, [](const std::string& text, int place) { return place == 1 ? text + "<" : text; }));
    }
    lines.push_back(std::move(line));
  }
  return fmt::format("{}\n{}{}; < best of the column\n", table.title, AlignColumns(lines),
                     Note(table));
}

std::string EscapeMarkdown(std::string_view text) {
  constexpr std::string_view kSpecial = R"(\`*_[]<>|#)";
  std::string escaped;
  for (const char c : text) {
    if (kSpecial.find(c) != std::string_view::npos) escaped += '\\';
    escaped += c == '\n' || c == '\r' ? ' ' : c;
  }
  return escaped;
}

std::string FormatPivotMarkdown(const PivotTable& table) {
  TableRow header;
  for (const std::string& title : table.row_axes) header.push_back(EscapeMarkdown(title));
  for (const auto& column : table.columns)
    header.push_back(EscapeMarkdown(JoinTitles(column, ", ")));
  std::string text =
      fmt::format("**{}**\n\n{}|", EscapeMarkdown(table.title), MarkdownLine(header));
  for (size_t i = 0; i < header.size(); ++i) text += "---|";
  text += "\n";
  for (const PivotTable::Row& row : table.rows) {
    TableRow line = RowTitles(row);
    for (std::string& title : line) title = EscapeMarkdown(title);
    for (const PivotCell& cell : row.cells) {
      line.push_back(CellText(cell, [](const std::string& value, int place) {
        if (place == 1) return "**" + value + "**";
        return place == 2 ? "_" + value + "_" : value;
      }));
    }
    text += MarkdownLine(line);
  }
  return fmt::format("{}\n{}. **Best**, _second_ of the column.\n", text,
                     EscapeMarkdown(Note(table)));
}

std::string FormatPivotCsv(const PivotTable& table) {
  TableRow header = table.row_axes;
  for (const auto& column : table.columns) {
    for (const std::string& name : table.value_names) {
      header.push_back(JoinTitles({JoinTitles(column, " "), name}, " "));
    }
  }
  std::string text = CsvLine(header);
  for (const PivotTable::Row& row : table.rows) {
    TableRow line = row.titles;
    for (const PivotCell& cell : row.cells) {
      for (size_t v = 0; v < table.value_names.size(); ++v) {
        line.push_back(v < cell.texts.size() ? cell.texts[v] : "");
      }
    }
    text += CsvLine(line);
  }
  return text;
}

std::string EscapeLatex(std::string_view text) {
  std::string escaped;
  for (const char c : text) {
    const auto* const name = std::find_if(std::begin(kLatexNames), std::end(kLatexNames),
                                          [c](const auto& entry) { return entry.first == c; });
    if (name != std::end(kLatexNames)) {
      escaped += name->second;
      continue;
    }
    if (kEscapedInLatex.find(c) != std::string_view::npos) escaped += '\\';
    escaped += c;
  }
  return escaped;
}

std::string FormatPivotLatex(const PivotTable& table) {
  std::string text =
      "% \\usepackage{booktabs,xcolor}\n"
      "\\providecommand{\\first}[1]{{\\setlength{\\fboxsep}{0pt}\\colorbox[RGB]{255,184,184}{#1}}}"
      "\n"
      "\\providecommand{\\second}[1]{{\\setlength{\\fboxsep}{0pt}\\colorbox[RGB]{255,222,184}{#1}}}"
      "\n"
      "\\providecommand{\\third}[1]{{\\setlength{\\fboxsep}{0pt}\\colorbox[RGB]{255,255,184}{#1}}}"
      "\n"
      "\\begin{table*}\n\\centering\\small\n";
  text += fmt::format("\\begin{{tabular}}{{{}}}\n\\toprule\n",
                      std::string(table.row_axes.size() + table.columns.size(), 'l'));
  for (size_t axis = 0; axis < std::max<size_t>(table.column_axes.size(), 1); ++axis) {
    text += LatexHeader(table, axis);
  }
  text += "\\midrule\n";
  const auto group_of = [&](size_t r) {
    return table.rows[r].titles.empty() ? std::string() : table.rows[r].titles.front();
  };
  const auto is_grouped = [&](size_t r) {
    return r + 1 < table.rows.size() && group_of(r) == group_of(r + 1);
  };
  for (size_t r = 0; r < table.rows.size(); ++r) {
    const PivotTable::Row& row = table.rows[r];
    // A line where a block of rows of one kind begins or ends.
    if (r > 0 && group_of(r) != group_of(r - 1) &&
        (is_grouped(r) || (r > 1 && group_of(r - 1) == group_of(r - 2)))) {
      text += "\\midrule\n";
    }
    TableRow line;
    for (size_t i = 0; i < row.titles.size(); ++i) {
      const std::string title = EscapeLatex(i == 0 ? FirstTitle(row) : row.titles[i]);
      line.push_back(i == 0 ? "\\texttt{" + title + "}" : title);
    }
    for (const PivotCell& cell : row.cells) {
      line.push_back(CellText(cell, [](const std::string& value, int place) {
        constexpr const char* kMarks[] = {"", "\\first{", "\\second{", "\\third{"};
        return place == 0 ? value : kMarks[place] + value + "}";
      }));
    }
    text += LatexFields(line);
  }
  return text +
         fmt::format("\\bottomrule\n\\end{{tabular}}\n\\caption{{{} {}.}}\n\\end{{table*}}\n",
                     EscapeLatex(table.title), EscapeLatex(Note(table)));
}

}  // namespace raylift
