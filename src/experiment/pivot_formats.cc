// The forms of a table: text, Markdown, CSV and LaTeX.

#include <algorithm>
#include <iterator>
#include <utility>

#include "experiment/pivot.h"
#include <fmt/format.h>

#include "raylift/base/text.h"

namespace raylift {
namespace {

// The text of a cell, each value marked by its place.
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

// One line of column titles; equal neighbors share one.
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
