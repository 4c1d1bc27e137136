// experiment as a job: it is stopped and killed, goes on, and shares its work, and its results are
// those of one run that was left alone.

#include "apps/job_runs.h"
#include "apps/program.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gmock/gmock.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class ExperimentJob : public ::testing::Test {
 protected:
  void SetUp() override {
    WriteRoomScene(folder_);
    WriteFile(file_, R"(
seeds = [0, 1, 2]
[scenes.room]
model = "model"
queries = "queries.txt"
ground_truth = "truth"
features = "features.h5"
matches = "matches.h5"
pairs = "pairs.txt"
thresholds = "0.01,0.1"
[scenes.room.geometry]
mesh = "mesh:room.obj"
worse = { spec = "mesh:room.obj", scale = 1.2 }
[[grid]]
every = [1, 2]
method = ["p3p", "e5p1", "adaptive", "oracle"]
[[table]]
name = "methods"
rows = ["method"]
columns = ["geometry", "every"]
)");
  }

  Arguments Experiment(const fs::path& out, const Arguments& more = {}) const {
    return Arguments{"experiment", file_, "--quiet", "--out", out} + more;
  }

  fs::path Whole() const {
    const fs::path whole = folder_ / "whole";
    EXPECT_TRUE(Succeeds(RunRaylift(Experiment(whole))));
    EXPECT_EQ(CountDone(whole), kCells);
    return whole;
  }

  // All files; those of depth that is made worse, which other machines make again, are of the
  // cache.
  static std::map<std::string, std::string> Contents(const fs::path& folder) {
    std::map<std::string, std::string> contents;
    for (const std::string& file : FilesBelow(folder)) {
      const bool is_result = file != "options.json" && !file.starts_with("cache");
      if (is_result) contents[file] = ReadFile(folder / file);
    }
    return contents;
  }

  static constexpr size_t kCells = 30;  // E5+1 has no geometry
  fs::path folder_ = TestFolder();
  fs::path file_ = folder_ / "experiment.toml";
};

TEST_F(ExperimentJob, InterruptedAtRandomItEndsWithTheSameBytes) {
  const auto whole = Contents(Whole());
  InterruptAtRandom({.command = [&](const fs::path& out) { return Experiment(out, {"--resume"}); },
                     .tasks = kCells,
                     .start_microseconds = 100'000,
                     .task_microseconds = 20'000,
                     .result = "index.html",
                     .expect_whole = [&](const fs::path& out) { EXPECT_EQ(Contents(out), whole); }},
                    folder_, 4, TestRng());
}

TEST_F(ExperimentJob, ShardsSideBySideAreOneRun) {
  const auto whole = Contents(Whole());
  const fs::path out = folder_ / "out";
  std::vector<pid_t> shards;
  for (const std::string shard : {"1/3", "2/3", "3/3"}) {
    shards.push_back(StartRaylift(Experiment(out, {"--shard", shard})));
  }
  for (const pid_t shard : shards) EXPECT_EQ(WaitFor(shard), 0);
  EXPECT_EQ(Contents(out), whole);
}

TEST_F(ExperimentJob, PartsInFoldersOfTheirOwnAreMerged) {
  const auto whole = Contents(Whole());
  const fs::path out = folder_ / "out", first = folder_ / "first", second = folder_ / "second";
  ASSERT_TRUE(Succeeds(RunRaylift(Experiment(first, {"--shard", "1/2"}))));
  EXPECT_FALSE(fs::exists(first / "results.csv"));
  const CommandResult status = RunRaylift({"status", first});
  EXPECT_EQ(status.exit_code, 4);
  EXPECT_THAT(status.out, HasSubstr("shard 1/2: 15 of 15, done"));
  EXPECT_TRUE(FailsWith(4, {"15 of 30 cells are not done"}, RunRaylift({"merge", out, first})));
  ASSERT_TRUE(Succeeds(RunRaylift(Experiment(second, {"--shard", "2/2"}))));
  ASSERT_TRUE(Succeeds(RunRaylift({"merge", out, first, second})));
  EXPECT_EQ(Contents(out), whole);
  EXPECT_TRUE(Succeeds(RunRaylift({"status", out})));

  Replace(file_, "scale = 1.2", "scale = 1.3");
  EXPECT_TRUE(FailsWith(3, {"manifest.1-of-2.jsonl", "others now", "inputs/cells"},
                        RunRaylift({"merge", folder_ / "other", first, second})));
}

TEST_F(ExperimentJob, AFullDiskNamesTheFileAndTheRestIsDoneLater) {
  const fs::path whole = Whole(), out = folder_ / "out";
  ASSERT_GT(fs::file_size(whole / "manifest.jsonl"), 2u * 1024);
  const CommandResult full = RunProcess(WithFullDisk(4, Experiment(out)));
  EXPECT_EQ(full.exit_code, 5) << full.err;
  EXPECT_THAT(full.err, HasSubstr("cannot be written"));
  ASSERT_TRUE(Succeeds(RunRaylift(Experiment(out, {"--resume"}))));
  EXPECT_EQ(Contents(out), Contents(whole));
}

TEST_F(ExperimentJob, AFolderThatCannotBeWrittenIsNamed) {
  const fs::path below_file = file_ / "out";
  EXPECT_TRUE(FailsWith(5, {file_.string()}, RunRaylift(Experiment(below_file))));
}

TEST_F(ExperimentJob, OverwriteEstimatesAllCellsAnew) {
  const fs::path out = Whole();
  const auto whole = Contents(out);
  const CommandResult again = RunRaylift({"experiment", file_, "--out", out});
  EXPECT_THAT(again.out, HasSubstr("0 cells estimated, 30 were there"));
  const CommandResult anew = RunRaylift({"experiment", file_, "--out", out, "--overwrite"});
  EXPECT_THAT(anew.out, HasSubstr("30 cells estimated, 0 were there"));
  EXPECT_EQ(Contents(out), whole);
}

}  // namespace
}  // namespace raylift
