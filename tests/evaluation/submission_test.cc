#include "evaluation/submission.h"

#include "support/test_data.h"
#include <gmock/gmock.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const std::vector<std::string> kQueries = {"day/a.jpg", "day/b.jpg", "night/b.jpg", "night/c.jpg"};

SubmissionReport Check(const std::string& text, const std::vector<Eigen::Vector3d>& centers = {}) {
  const auto file = TestFolder() / "submission.txt";
  WriteFile(file, text);
  return CheckSubmission(file, kQueries, centers);
}

TEST(Submission, ACorrectOneHasNoProblems) {
  const SubmissionReport report = Check(
      "a.jpg 1 0 0 0 1 2 3\n"
      "day/b.jpg 0 1 0 0 1 2 3\n"
      "night/b.jpg 0.6 0 0.8 0 1 2 3\n"
      "c.jpg 1 0 0 0 1 2 3");
  EXPECT_THAT(report.problems, IsEmpty());
  EXPECT_THAT(report.missing, IsEmpty());
  EXPECT_EQ(report.num_poses, 4u);
}

TEST(Submission, NamesEveryProblemWithItsLine) {
  const SubmissionReport report = Check(
      "a.jpg 1 0 0 0 1 2 3\n"
      "day/a.jpg 1 0 0 0 1 2 3\n"
      "b.jpg 1 0 0 0 1 2 3\n"
      "x.jpg 1 0 0 0 1 2 3\n"
      "c.jpg 2 0 0 0 1 2 3\n"
      "day/b.jpg 1 0 0 0 nan 2 3\n"
      "night/b.jpg 1 0 0 0 1 2\n");
  EXPECT_THAT(report.problems,
              ElementsAre("line 2: day/a.jpg stands twice (also in line 1)",
                          "line 3: b.jpg is the end of several queries' names",
                          "line 4: x.jpg is no query", "line 5: the quaternion has length 2, not 1",
                          "line 6: expected a finite number, found \"nan\"",
                          "line 7: expected name qw qx qy qz tx ty tz, found 7 fields"));
  EXPECT_THAT(report.missing, ElementsAre("night/b.jpg"));
  EXPECT_THAT(report.remarks, ElementsAre(HasSubstr("1 of 4 queries have no pose")));
}

TEST(Submission, PosesOfTheWrongDirectionLieOutsideOfTheScene) {
  const std::vector<Eigen::Vector3d> centers = {{99, 0, 0}, {101, 2, 1}};
  // Looking along x from (100, 1, 0.5): world to camera t = -R c.
  const std::string right = "day/a.jpg 0.7071067811865476 0 0.7071067811865476 0 -0.5 -1 100\n";
  const std::string wrong = "day/a.jpg 0.7071067811865476 0 -0.7071067811865476 0 100 1 0.5\n";
  EXPECT_THAT(Check(right, centers).problems, IsEmpty());
  EXPECT_THAT(Check(wrong, centers).problems, ElementsAre(HasSubstr("invert them")));
}

TEST(Submission, AMissingFileIsAnInputError) {
  EXPECT_THROW(CheckSubmission("/nowhere/submission.txt", kQueries, {}), InputError);
}

}  // namespace
}  // namespace raylift
