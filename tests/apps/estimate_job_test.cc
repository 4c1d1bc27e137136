// estimate as a job: it is stopped and killed, goes on, and shares its work, and its results are
// those of one run that was left alone.

#include "apps/job_runs.h"
#include "apps/program.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

class EstimateJob : public ::testing::Test {
 protected:
  // The demo's problems, of few references and features, so that it is quick.
  void SetUp() override {
    ASSERT_TRUE(Succeeds(RunRaylift(LocalizeDemo(folder_ / "cache", folder_ / "localized") +
                                    Arguments{"--every", "4", "--max-features", "500", "--quiet",
                                              "--write-problems", problems_})));
  }

  Arguments Estimate(const fs::path& out, const Arguments& more = {}) const {
    return Arguments{"estimate", problems_, "--repeat", "3", "--quiet", "--out", out} + more;
  }

  // What a run that is left alone leaves.
  fs::path Whole() const {
    const fs::path whole = folder_ / "whole";
    EXPECT_TRUE(Succeeds(RunRaylift(Estimate(whole))));
    EXPECT_EQ(CountDone(whole), 12u);
    return whole;
  }

  // Of a file that --csv has made.
  static std::string WithoutTimes(const fs::path& csv) {
    std::string rows;
    for (const std::string& line : Lines(ReadFile(csv))) {
      auto fields = SplitBy(line, ',');
      EXPECT_EQ(fields.size(), 19u) << line;
      fields.erase(fields.begin() + 14);
      rows += fmt::format("{}\n", fmt::join(fields, ","));
    }
    return rows;
  }

  static void ExpectSame(const fs::path& a, const fs::path& b) {
    EXPECT_EQ(ReadFile(a / "poses.txt"), ReadFile(b / "poses.txt"));
    for (const char* file : {"estimates.csv", "estimates.json", "manifest.jsonl"}) {
      EXPECT_EQ(ReadFile(a / file), ReadFile(b / file));
    }
    EXPECT_EQ(FilesBelow(a), FilesBelow(b));
  }

  fs::path folder_ = TestFolder();
  fs::path problems_ = folder_ / "problems";
};

TEST_F(EstimateJob, ItsFilesAreThoseWithoutOut) {
  const fs::path whole = Whole();
  ASSERT_TRUE(Succeeds(RunRaylift({"estimate", problems_, "--csv", folder_ / "a.csv", "--json",
                                   folder_ / "a.json", "--poses", folder_ / "a.txt"})));
  EXPECT_EQ(ReadFile(folder_ / "a.txt"), ReadFile(whole / "poses.txt"));
  EXPECT_EQ(WithoutTimes(folder_ / "a.csv"), ReadFile(whole / "estimates.csv"));
  EXPECT_EQ(JsonWithoutTimes(folder_ / "a.json"), JsonWithoutTimes(whole / "estimates.json"));
}

TEST_F(EstimateJob, InterruptedAtRandomItEndsWithTheSameBytes) {
  const fs::path whole = Whole();
  InterruptAtRandom({.command = [&](const fs::path& out) { return Estimate(out, {"--resume"}); },
                     .tasks = 12,
                     .start_microseconds = 100'000,
                     .task_microseconds = 20'000,
                     .result = "estimates.json",
                     .expect_whole = [&](const fs::path& out) { ExpectSame(whole, out); }},
                    folder_, 4, TestRng());
}

TEST_F(EstimateJob, ASignalWithoutAFolderSaysHowToKeepWhatIsDone) {
  const fs::path csv = folder_ / "a.csv";
  EXPECT_EQ(4, Terminate(StartRaylift(
                   {"estimate", problems_, "--csv", csv, "--repeat", "100000", "--threads", "1"})));
  EXPECT_FALSE(fs::exists(csv));
}

TEST_F(EstimateJob, AFormerRunIsReplacedOnlyWhereThatIsAskedFor) {
  const fs::path whole = Whole();
  const std::string before = ReadFile(whole / "timing.jsonl");
  EXPECT_TRUE(FailsWith(2, {"--overwrite", "resume", whole.string(), "former run"},
                        RunRaylift(Estimate(whole))));
  EXPECT_TRUE(FailsWith(3, {"manifest.jsonl", "options/seed: 0 there, 7 here"},
                        RunRaylift(Estimate(whole, {"--resume", "--seed", "7"}))));
  EXPECT_EQ(ReadFile(whole / "timing.jsonl"), before);
  ASSERT_TRUE(Succeeds(RunRaylift(Estimate(whole, {"--resume"}))));
  EXPECT_EQ(ReadFile(whole / "timing.jsonl"), before) << "not even the times are others";
  ASSERT_TRUE(Succeeds(RunRaylift(Estimate(whole, {"--overwrite", "--seed", "7"}))));
  EXPECT_NE(ReadFile(whole / "timing.jsonl"), before);
  const fs::path problem = problems_ / "query/query_01.jpg.json";
  WriteFile(problem, ReadFile(problem) + "\n");
  EXPECT_TRUE(FailsWith(3, {"inputs/problems: \"12 "},
                        RunRaylift(Estimate(whole, {"--resume", "--seed", "7"}))));
}

TEST_F(EstimateJob, OptionsThatNeedAFolderOfTheirOwnAreTold) {
  for (const std::string option : {"--resume", "--overwrite", "--shard=1/2"}) {
    EXPECT_TRUE(FailsWith(2, {"--out"}, RunRaylift({"estimate", problems_, option}))) << option;
  }
  EXPECT_TRUE(FailsWith(2, {"folder of the problems"}, RunRaylift(Estimate(problems_ / "out"))));
  EXPECT_TRUE(FailsWith(3, {"query_01.jpg.json", "twice"},
                        RunRaylift(Estimate(folder_ / "out", {problems_}))));
}

TEST_F(EstimateJob, AFullDiskNamesTheFileAndTheRestIsResumed) {
  const fs::path whole = Whole();
  const fs::path out = folder_ / "out";
  ASSERT_GT(fs::file_size(whole / "manifest.jsonl"), 8u * 1024);
  EXPECT_TRUE(FailsWith(5, {(out / "manifest.jsonl").string(), "cannot be written"},
                        RunProcess(WithFullDisk(16, Estimate(out)))));
  EXPECT_GT(CountDone(out), 0u);
  EXPECT_LT(CountDone(out), 12u);
  ASSERT_TRUE(Succeeds(RunRaylift(Estimate(out, {"--resume"}))));
  ExpectSame(whole, out);
}

TEST_F(EstimateJob, ShardsSideBySideOrInFoldersOfTheirOwnAreOneRun) {
  const fs::path whole = Whole();
  const fs::path out = folder_ / "out";
  std::vector<pid_t> shards;
  for (const std::string shard : {"1/3", "2/3", "3/3"}) {
    shards.push_back(StartRaylift(Estimate(out, {"--shard", shard})));
  }
  for (const pid_t shard : shards) EXPECT_EQ(WaitFor(shard), 0);
  ExpectSame(whole, out);

  const fs::path merged = folder_ / "merged";
  Arguments merge = {"merge", merged};
  for (const std::string shard : {"0/2", "1/2"}) {
    const fs::path part = folder_ / ("part" + shard.substr(0, 1));
    ASSERT_TRUE(Succeeds(RunRaylift(Estimate(part, {"--shard", shard}))));
    merge.push_back(part);
    if (shard == "1/2") continue;
    EXPECT_TRUE(FailsWith(4, {"6 of 12 problems"}, RunRaylift(merge)));
    const CommandResult status = RunRaylift({"status", part});
    EXPECT_EQ(status.exit_code, 4);
    EXPECT_NE(status.out.find("shard 1/2: 0 of 6, nothing done yet"), std::string::npos)
        << status.out;
  }
  ASSERT_TRUE(Succeeds(RunRaylift(merge)));
  ExpectSame(whole, merged);
  EXPECT_TRUE(Succeeds(RunRaylift({"status", merged})));
  ASSERT_TRUE(Succeeds(RunRaylift(Estimate(merged, {"--resume"}))));
  ExpectSame(whole, merged);
}

TEST_F(EstimateJob, ShardsOfOtherMachinesAreMergedWithAWarning) {
  Arguments merge = {"merge", folder_ / "merged"};
  for (const std::string shard : {"0/2", "1/2"}) {
    const fs::path part = folder_ / ("part" + shard.substr(0, 1));
    ASSERT_TRUE(Succeeds(RunRaylift(Estimate(part, {"--shard", shard}))));
    merge.push_back(part);
  }
  Replace(folder_ / "part1/manifest.1-of-2.jsonl", R"({"instructions":")",
          R"({"instructions":"another machine's, not )");
  const CommandResult result = RunRaylift(merge);
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_NE(result.err.find("machines whose vector instructions differ (another machine's"),
            std::string::npos)
      << result.err;
  EXPECT_EQ(ReadFile(Whole() / "manifest.jsonl"), ReadFile(folder_ / "merged/manifest.jsonl"));
}

}  // namespace
}  // namespace raylift
