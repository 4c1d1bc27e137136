#include "experiment/pivot.h"

#include "experiment/test_experiments.h"
#include <gmock/gmock.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

// `within` of ten queries are exact, the others a unit off.
SettingResult TenQueries(const Setting& setting, int within) {
  SettingResult result;
  result.setting = setting;
  result.thresholds = {{0.1, 1}, {2, 5}};
  Comparison& comparison = result.comparisons.emplace_back();
  for (int q = 0; q < 10; ++q) {
    comparison.queries.push_back({std::to_string(q), PoseError{q < within ? 0.0 : 1.0, 0.5}});
  }
  return result;
}

const TableLayout kByGeometry = {
    "a", "A table", {Axis::kMethod}, {Axis::kGeometry, Axis::kEvery}, TableValue::kRecalls, {}};

Experiment SomeExperiment() { return ReadText(kTwoScenes + "[[grid]]\nscene = \"room\"\n"); }

std::vector<SettingResult> SomeResults() {
  return {TenQueries(RoomSetting(1, "mesh", Method::kP3p), 9),
          TenQueries(RoomSetting(1, "noisy", Method::kP3p), 2),
          TenQueries(RoomSetting(1, "", Method::kE5p1), 6),
          TenQueries(RoomSetting(1, "mesh", Method::kAdaptive, ScoreCombination::kSumMsac), 9),
          TenQueries(RoomSetting(1, "noisy", Method::kAdaptive, ScoreCombination::kSumMsac), 7)};
}

TEST(Pivot, WhatNeedsNoGeometryStandsInAllItsColumns) {
  const PivotTable table = MakePivot(SomeExperiment(), kByGeometry, SomeResults());
  ASSERT_EQ(table.columns.size(), 2u);
  EXPECT_THAT(table.columns[0], ElementsAre("mesh", "1/1"));
  EXPECT_THAT(table.columns[1], ElementsAre("noisy depth", "1/1"));
  ASSERT_EQ(table.rows.size(), 3u);
  EXPECT_THAT(table.rows[0].titles, ElementsAre("P3P"));
  EXPECT_THAT(table.rows[0].cells[1].texts, ElementsAre("20.0", "100.0"));
  EXPECT_THAT(table.rows[1].titles, ElementsAre("E5+1"));
  for (const PivotCell& cell : table.rows[1].cells) {
    EXPECT_THAT(cell.texts, ElementsAre("60.0", "100.0"));
  }
}

TEST(Pivot, ATableMayHaveOneColumnOfAll) {
  TableLayout layout = kByGeometry;
  layout.columns = {};
  layout.where.values[Axis::kGeometry] = {std::string("noisy")};
  const PivotTable table = MakePivot(SomeExperiment(), layout, SomeResults());
  ASSERT_EQ(table.columns.size(), 1u);
  ASSERT_EQ(table.rows.size(), 3u);
  EXPECT_THAT(table.rows[0].cells[0].texts, ElementsAre("20.0", "100.0"));
}

TEST(Pivot, RanksEachColumnAndLeavesOutTheOracle) {
  std::vector<SettingResult> results = SomeResults();
  results.push_back(TenQueries(RoomSetting(1, "mesh", Oracle()), 10));
  results.back().uses_ground_truth = true;
  const PivotTable table = MakePivot(SomeExperiment(), kByGeometry, results);
  EXPECT_THAT(table.rows[0].cells[0].places, ElementsAre(1, 1));  // P3P, as good as Adaptive
  EXPECT_THAT(table.rows[1].cells[0].places, ElementsAre(2, 1));
  EXPECT_THAT(table.rows[2].cells[0].places, ElementsAre(1, 1));
  EXPECT_THAT(table.rows[3].cells[0].places, ElementsAre(0, 0));
  EXPECT_THAT(table.rows[0].cells[1].places, ElementsAre(3, 1));
  EXPECT_FALSE(table.rows[3].cells[1].known);
}

TEST(Pivot, TwoSettingsInOneCellAreAnError) {
  TableLayout layout = kByGeometry;
  layout.columns = {Axis::kEvery};
  try {
    MakePivot(SomeExperiment(), layout, SomeResults());
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("table a: "));
    EXPECT_THAT(error.what(), HasSubstr("geometry=mesh"));
    EXPECT_THAT(error.what(), HasSubstr("geometry=noisy"));
  }
  layout.where.values[Axis::kGeometry] = {std::string("noisy")};
  EXPECT_EQ(MakePivot(SomeExperiment(), layout, SomeResults()).rows.size(), 3u);
}

TEST(Pivot, FormsHoldTheSameNumbers) {
  const PivotTable table = MakePivot(SomeExperiment(), kByGeometry, SomeResults());
  EXPECT_THAT(FormatPivotMarkdown(table),
              HasSubstr("| P3P | **90.0** / **100.0** | 20.0 / **100.0** |\n"));
  EXPECT_THAT(FormatPivotCsv(table), HasSubstr("\nP3P,90.0,100.0,20.0,100.0\n"));
  EXPECT_THAT(FormatPivotText(table), HasSubstr("90.0< / 100.0<"));
  const std::string latex = FormatPivotLatex(table);
  EXPECT_THAT(latex, HasSubstr("\\texttt{E5+1} & \\second{60.0} / \\first{100.0} & "));
  EXPECT_THAT(latex, HasSubstr("\\begin{tabular}{lll}"));
}

TEST(Pivot, TitlesAreNoMarkdown) {
  EXPECT_EQ(EscapeMarkdown("a|b\n# <i>*c*_[d](e)`\\"), R"(a\|b \# \<i\>\*c\*\_\[d\](e)\`\\)");
  PivotTable table = MakePivot(SomeExperiment(), kByGeometry, SomeResults());
  table.title = "x** | <script>";
  EXPECT_THAT(FormatPivotMarkdown(table), HasSubstr(R"(**x\*\* \| \<script\>**)"));
}

TEST(Pivot, MediansAreBestWhereTheyAreLow) {
  TableLayout layout = kByGeometry;
  layout.value = TableValue::kMedian;
  const PivotTable table = MakePivot(SomeExperiment(), layout, SomeResults());
  EXPECT_THAT(table.rows[0].cells[1].texts, ElementsAre("1.0000", "0.500"));
  EXPECT_THAT(table.rows[2].cells[1].texts, ElementsAre("0.0000", "0.500"));
  EXPECT_EQ(table.rows[2].cells[1].places[0], 1);
}

TEST(Pivot, LatexSpecialCharactersAreEscaped) {
  EXPECT_EQ(EscapeLatex("a_b & 50 % {c} #1 $x$ \\ ~ ^ <"),
            "a\\_b \\& 50 \\% \\{c\\} \\#1 \\$x\\$ \\textbackslash{} \\textasciitilde{} "
            "\\textasciicircum{} \\textless{}");
}

}  // namespace
}  // namespace raylift
