#include <fstream>

#include "base/constants.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gmock/gmock.h>

#include "raylift/evaluation/pose_errors.h"

namespace raylift {
namespace {

using ::testing::HasSubstr;

const std::vector<Threshold> kThresholds = {{0.05, 5}, {0.25, 2}};

std::vector<ResultSummary> Results() {
  return {{.name = "P3P",
           .num_queries = 3,
           .num_localized = 2,
           .recalls_percent = {100. / 3, 200. / 3},
           .median_position = 0.0123456789,
           .median_rotation_deg = 1.5,
           .missing_names = {"c.png"},
           .unknown_names = {}},
          {.name = "Oracle",
           .uses_ground_truth = true,
           .num_queries = 3,
           .num_localized = 1,
           .recalls_percent = {0, 100},
           .median_position = kInfinity,
           .median_rotation_deg = kInfinity,
           .missing_names = {"a.png", "c.png"},
           .unknown_names = {"x.png"}}};
}

TEST(Tables, TextIsAlignedAndMarksTheOracle) {
  EXPECT_EQ(FormatTableText({kThresholds, Results()}),
            "result    queries  localized  unknown  0.05,5deg %  0.25,2deg %  median position  "
            "median deg\n"
            "P3P             3          2        0        33.33        66.67         0.012346  "
            "       1.5\n"
            "Oracle *        3          1        1         0.00       100.00                -  "
            "         -\n"
            "* chosen with the ground truth\n");
}

TEST(Tables, ImagesWithoutAPoseAreCountedAndNamed) {
  ResultSummary result = Results()[1];
  EXPECT_EQ(DescribeMissing(result),
            "Oracle: 2 of 3 images of the ground truth have no pose and count as not localized: "
            "a.png, c.png");
  result.missing_names.assign(6, "d.png");
  EXPECT_THAT(DescribeMissing(result), HasSubstr("d.png, d.png, d.png, d.png, d.png, ..."));
  result.missing_names.clear();
  EXPECT_EQ(DescribeMissing(result), "");
}

TEST(Tables, CsvHoldsTheSameNumbers) {
  EXPECT_EQ(FormatTableCsv({kThresholds, Results()}),
            "name,uses_ground_truth,queries,localized,unknown,recall_percent_0.05_5deg,"
            "recall_percent_0.25_2deg,median_position,median_rotation_deg\n"
            "P3P,false,3,2,0,33.33,66.67,0.012346,1.5\n"
            "Oracle,true,3,1,1,0.00,100.00,inf,inf\n");
}

TEST(Tables, JsonHoldsTheSameNumbers) {
  const std::string json = FormatTableJson({kThresholds, Results()});
  for (const char* part :
       {"\"position\": 0.05", "\"rotation_deg\": 5", "\"name\": \"P3P\"",
        "\"uses_ground_truth\": true", "\"queries\": 3", "\"localized\": 2", "\"unknown\": 1",
        "33.33,", "66.67\n", "\"median_position\": 0.012346,", "\"median_rotation_deg\": 1.5,",
        "\"median_position\": null,", "\"x.png\""}) {
    EXPECT_THAT(json, HasSubstr(part));
  }
}

TEST(Tables, TextKeepsOddNamesOnTheirLine) {
  std::vector<ResultSummary> results = Results();
  results[0].name = "a\nb\tc";
  results[1].name = "M\xc3\xbcnchen";  // seven characters, eight bytes
  const std::string text = FormatTableText({kThresholds, results});
  EXPECT_THAT(text, HasSubstr("\na?b?c            3"));
  EXPECT_THAT(text, HasSubstr("\nM\xc3\xbcnchen *        3"));
}

constexpr const char* kTablesScript = R"(
import csv
import json
import sys

folder = sys.argv[1]
rows = list(csv.reader(open(folder + "/table.csv", newline="", encoding="utf-8", errors="replace")))
results = json.load(open(folder + "/table.json", encoding="utf-8"))["results"]
assert len(rows) == 1 + len(results), rows
for row, result in zip(rows[1:], results):
    assert len(row) == len(rows[0]), row
    assert row[0] == result["name"], (row[0], result["name"])
    numbers = [result["queries"], result["localized"], result["unknown"],
               *result["recalls_percent"], result["median_position"], result["median_rotation_deg"]]
    numbers = [float("inf") if number is None else number for number in numbers]
    assert [float(field) for field in row[2:]] == numbers, (row, numbers)
print("same")
)";

TEST(Tables, OddNamesAndNumbersAreTheSameToPythonsReaders) {
  if (!HasProgram("python3")) {
    GTEST_SKIP() << "Python is not on this machine";
  }
  std::vector<ResultSummary> results = Results();
  for (const char* name :
       {"comma, quote\" and\nnew line", " blanks ", "back\\slash", "M\xc3\xbcnchen", "tab\there",
        "control\x01", "=1+1", "", "not UTF-8: \xff"}) {
    results.push_back(results[results.size() % 2]);
    results.back().name = name;
    results.back().missing_names = {name};
  }
  const auto folder = TestFolder();
  std::ofstream(folder / "check.py") << kTablesScript;
  std::ofstream(folder / "table.csv") << FormatTableCsv({kThresholds, results});
  std::ofstream(folder / "table.json") << FormatTableJson({kThresholds, results});
  EXPECT_EQ(RunProgram("python3 " + (folder / "check.py").string() + " " + folder.string()),
            "same\n");
}

}  // namespace
}  // namespace raylift
