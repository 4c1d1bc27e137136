// Makes tables of an experiment's results in the layout that its file asks for, as the paper prints
// them: some axes make the rows, others the columns, and a cell holds the recalls or the medians.

#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "experiment/results.h"

#include "raylift/experiment/experiment.h"

namespace raylift {

struct PivotCell {
  bool known = false;              // a setting is there, and its ground truth
  std::vector<double> values;      // as printed, so that all forms hold the same
  std::vector<std::string> texts;  // of the values
  std::vector<int> places;         // 1: best of the column, 2: second, 3: third, 0: none of these
};

struct PivotTable {
  std::string name, title;
  std::vector<std::string> row_axes, column_axes;  // titles
  std::vector<std::vector<std::string>> columns;   // titles of each column, one per axis
  std::vector<std::string> value_names;            // of the values of a cell
  bool low_is_better = false;
  struct Row {
    std::vector<std::string> titles;  // one per row axis, empty: does not matter to the method
    bool uses_ground_truth = false;   // not ranked
    std::vector<PivotCell> cells;     // one per column
  };
  std::vector<Row> rows;
};

// Makes a table. A setting to which a column axis does not matter stands in all columns. Throws
// InputError where two settings fall into one cell.
PivotTable MakePivot(const Experiment& experiment, const TableLayout& layout,
                     std::span<const SettingResult> results);

std::string FormatPivotText(const PivotTable& table);
std::string FormatPivotMarkdown(const PivotTable& table);
std::string FormatPivotCsv(const PivotTable& table);
// Returns a tabular for booktabs, whose best, second and third values stand in \first, \second and
// \third, as the paper defines them, together with these definitions.
std::string FormatPivotLatex(const PivotTable& table);

// Joins the titles that are not empty.
std::string JoinTitles(const std::vector<std::string>& parts, std::string_view between = ", ");

// Returns the text as a line of Markdown that prints it, also within a table.
std::string EscapeMarkdown(std::string_view text);
// Returns the text with LaTeX's special characters as what they print.
std::string EscapeLatex(std::string_view text);

// Returns a value of an axis as a table prints it ("P3P", "1/5").
std::string ValueTitle(const Experiment& experiment, const Setting& setting, LayoutAxis axis);

std::string FormatExperimentPage(const Experiment& experiment, std::span<const PivotTable> tables,
                                 std::span<const SettingResult> results,
                                 std::span<const JudgedClaim> claims);

// Returns the figure's points as CSV: panel, line, subsampling, a column per value.
std::string FormatFigureCsv(const Experiment& experiment, const TableLayout& layout,
                            std::span<const SettingResult> results);

}  // namespace raylift
