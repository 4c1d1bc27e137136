#include <cmath>
#include <fstream>
#include <sstream>

#include "base/constants.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gmock/gmock.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/evaluation/pose_errors.h"

namespace raylift {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

Comparison FromErrors(const std::vector<std::optional<PoseError>>& errors) {
  Comparison comparison;
  for (size_t i = 0; i < errors.size(); ++i) {
    comparison.queries.push_back({"query" + std::to_string(i), errors[i]});
  }
  return comparison;
}

TEST(Thresholds, AreParsedInOrder) {
  EXPECT_THAT(ParseThresholds("0.05,5:0.1,1:0.25,2"),
              ElementsAre(Threshold{0.05, 5}, Threshold{0.1, 1}, Threshold{0.25, 2}));
  EXPECT_THAT(ParseThresholds(" 5 , 10 "), ElementsAre(Threshold{5, 10}));
}

TEST(Thresholds, DataSetsHaveTheirOwn) {
  EXPECT_THAT(ParseThresholds("gangnam"),
              ElementsAre(Threshold{0.1, 1}, Threshold{0.25, 2}, Threshold{1, 5}));
  EXPECT_THAT(ParseThresholds("7scenes"), ElementsAre(Threshold{0.05, 5}));
  EXPECT_THAT(ThresholdPresetNames(), HasSubstr("|cambridge|"));
}

TEST(Thresholds, RefuseNonsense) {
  for (const char* text : {"", ":", "1", "1,2,3", "1,2:", "a,1", "1,b", "0,1", "1,0", "-1,2",
                           "nan,1", "1,inf", "1;2", "0.05m,5deg"}) {
    try {
      ParseThresholds(text);
      ADD_FAILURE() << "accepted \"" << text << "\"";
    } catch (const OptionError& error) {
      EXPECT_THAT(error.what(), HasSubstr("thresholds = " + std::string(text) + ": ")) << text;
    }
  }
}

// Counted by hand: 4 of 5 queries have a pose.
TEST(Summary, CountsFailedQueriesAsFailures) {
  const Comparison comparison = FromErrors(
      {PoseError{0.04, 0.5}, PoseError{0.05, 5}, PoseError{0.06, 0.1}, PoseError{0.01, 6}, {}});
  const std::vector<Threshold> thresholds = {{0.05, 5}, {0.06, 1}, {1, 10}, {0.001, 0.001}};
  const ResultSummary summary = Summarize("P3P", comparison, thresholds);
  EXPECT_EQ(summary.name, "P3P");
  EXPECT_EQ(summary.num_queries, 5u);
  EXPECT_EQ(summary.num_localized, 4u);
  EXPECT_THAT(summary.recalls_percent, ElementsAre(40, 40, 80, 0));
  EXPECT_EQ(summary.median_position, 0.05);   // 0.01 0.04 0.05 0.06 inf
  EXPECT_EQ(summary.median_rotation_deg, 5);  // 0.1 0.5 5 6 inf
  EXPECT_THAT(summary.missing_names, ElementsAre("query4"));
  EXPECT_EQ(UnknownNamesWarning(summary), "");
}

TEST(Summary, MedianOfAnEvenCountIsTheMiddleTwosMean) {
  const Comparison comparison =
      FromErrors({PoseError{4, 40}, PoseError{1, 10}, PoseError{3, 20}, PoseError{2, 30}});
  const ResultSummary summary = Summarize("m", comparison, {});
  EXPECT_EQ(summary.median_position, 2.5);
  EXPECT_EQ(summary.median_rotation_deg, 25);
  EXPECT_THAT(summary.recalls_percent, IsEmpty());
}

TEST(Summary, MedianIsInfiniteWhereHalfOrMoreFail) {
  EXPECT_EQ(Summarize("m", FromErrors({PoseError{1, 1}, {}, {}}), {}).median_position, kInfinity);
  EXPECT_EQ(Summarize("m", FromErrors({PoseError{1, 1}, {}}), {}).median_rotation_deg, kInfinity);
  EXPECT_EQ(Summarize("m", FromErrors({PoseError{1, 1}, PoseError{2, 2}, {}}), {}).median_position,
            2);
  const ResultSummary nothing = Summarize("m", FromErrors({{}, {}}), std::vector{Threshold{1, 1}});
  EXPECT_EQ(nothing.num_localized, 0u);
  EXPECT_THAT(nothing.recalls_percent, ElementsAre(0));
}

TEST(Summary, NeedsQueries) {
  EXPECT_TRUE(
      FailsWithInputError([] { Summarize("poses.txt", {}, {}); }, {"poses.txt", "no queries"}));
}

TEST(Summary, WarnsOfUnknownNames) {
  Comparison comparison = FromErrors({PoseError{1, 1}});
  comparison.unknown_names = {"other/1.png", "other/2.png"};
  const std::string warning = UnknownNamesWarning(Summarize("m", comparison, {}));
  EXPECT_EQ(warning, "m: 2 of the poses are not in the ground truth, e.g. \"other/1.png\"");
}

constexpr const char* kScript = R"(
import sys
import numpy as np

def matrix(q):
    w, x, y, z = q / np.linalg.norm(q)
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])

def read(path):
    poses = {}
    for line in open(path):
        name, *numbers = line.split()
        numbers = np.array([float(number) for number in numbers])
        poses[name] = matrix(numbers[:4]), numbers[4:]
    return poses

truth, estimated = read(sys.argv[1]), read(sys.argv[2])
errors = np.full((len(truth), 2), np.inf)
for i, name in enumerate(sorted(truth)):
    if name in estimated:
        (R, t), (R2, t2) = truth[name], estimated[name]
        angle = np.arccos(np.clip((np.trace(R.T @ R2) - 1) / 2, -1, 1))
        errors[i] = np.linalg.norm(R.T @ t - R2.T @ t2), np.rad2deg(angle)
with np.errstate(invalid="ignore"):
    median = np.median(errors, axis=0)
print("%.17g %.17g" % tuple(median))
for argument in sys.argv[3:]:
    print("%.17g" % (100 * np.mean((errors <= [float(x) for x in argument.split(",")]).all(axis=1))))
)";

void WritePoses(const std::filesystem::path& path, const PosesByName& poses) {
  std::ofstream file(path);
  for (const auto& [name, pose] : poses) {
    file << name;
    const Eigen::Quaterniond& q = pose.rotation;
    const Eigen::Vector3d& t = pose.translation;
    for (const double value : {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()}) {
      file << ' ' << FormatDouble(value);
    }
    file << '\n';
  }
}

TEST(Summary, AgreesWithNumpy) {
  if (!HasProgram("/usr/bin/python3 -c 'import numpy'")) {
    GTEST_SKIP() << "numpy is not on this machine";
  }
  Rng rng = TestRng();
  const auto folder = TestFolder();
  std::ofstream(folder / "evaluate.py") << kScript;
  const std::string threshold_text = "0.05,5:0.1,1:0.25,2:1,10";
  for (const double share_localized : {1.0, 0.8, 0.4}) {
    PosesByName truth;
    PosesByName estimated;
    for (int i = 0; i < 101; ++i) {
      const std::string name = "image" + std::to_string(i);
      truth[name] = RandomRigid3(rng, 10);
      const double size = std::exp(rng.Uniform(-6, 0));
      const Eigen::Vector3d turn = 0.3 * size * Eigen::Vector3d(rng.Normal(), rng.Normal(), 0.1);
      const Rigid3 error = {RotationFromVector(turn), size * Eigen::Vector3d(rng.Normal(), 0.2, 0)};
      if (rng.Uniform() < share_localized) {
        estimated[name] = error * truth[name];
      }
    }
    WritePoses(folder / "truth.txt", truth);
    WritePoses(folder / "estimated.txt", estimated);
    std::string command = "/usr/bin/python3 " + (folder / "evaluate.py").string() + " " +
                          (folder / "truth.txt").string() + " " +
                          (folder / "estimated.txt").string();
    for (const std::string_view threshold : SplitBy(threshold_text, ':')) {
      command += " " + std::string(threshold);
    }
    const std::string output = RunProgram(command);
    std::vector<double> expected;
    for (const std::string_view line : SplitBy(output, '\n')) {
      for (const std::string_view token : SplitTokens(line)) {
        expected.push_back(ParseDouble(token).value());
      }
    }
    const ResultSummary summary =
        Summarize("m", CompareWithGroundTruth(truth, estimated), ParseThresholds(threshold_text));
    ASSERT_EQ(expected.size(), 6u);
    if (std::isinf(expected[0])) {
      EXPECT_EQ(summary.median_position, kInfinity);
      EXPECT_EQ(summary.median_rotation_deg, kInfinity);
    } else {
      EXPECT_NEAR(summary.median_position, expected[0], 1e-12);
      // The arc cosine of the trace is good to 1e-6 deg only.
      EXPECT_NEAR(summary.median_rotation_deg, expected[1], 1e-5);
    }
    for (size_t i = 0; i < 4; ++i) {
      EXPECT_DOUBLE_EQ(summary.recalls_percent[i], expected[2 + i]);
    }
  }
}

}  // namespace
}  // namespace raylift
