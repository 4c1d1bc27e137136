#include "jobs/job_status.h"

#include "jobs/manifest_file.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

namespace fs = std::filesystem;
using State = ShardStatus::State;

const std::string kHeader = R"({"command":"render","tasks":7})";

void WritePart(const fs::path& out, const Shard& shard, int first, int count) {
  std::vector<std::string> lines;
  for (int i = 0; i < count; ++i) {
    lines.push_back(R"({"name":")" + std::to_string(first + i) + "\"}");
  }
  WriteManifestText(ManifestPath(out, shard), kHeader, lines);
}

TEST(JobStatus, CountsTheTasksOfEachShard) {
  const fs::path out = TestFolder();
  WritePart(out, {1, 4}, 0, 2);
  WritePart(out, {2, 4}, 2, 1);
  const ManifestAppender appender(ManifestPath(out, {2, 4}));
  WritePart(out, {3, 4}, 3, 0);
  const JobStatus status = ReadJobStatus(out);
  EXPECT_EQ(status.command, "render");
  EXPECT_EQ(status.tasks, 7u);
  EXPECT_EQ(status.done, 3u);
  EXPECT_FALSE(status.IsComplete());
  std::vector<State> states;
  std::vector<size_t> tasks;
  for (const ShardStatus& shard : status.shards) {
    states.push_back(shard.state);
    tasks.push_back(shard.tasks);
  }
  EXPECT_EQ(tasks, (std::vector<size_t>{2, 2, 2, 1}));
  EXPECT_EQ(states,
            (std::vector<State>{State::kNotBegun, State::kDone, State::kRunning, State::kStopped}));
  EXPECT_EQ(ShardsToSubmit(status), "0,3");
}

TEST(JobStatus, AWholeJobIsOneShard) {
  const fs::path out = TestFolder();
  WritePart(out, {}, 0, 6);
  EXPECT_FALSE(ReadJobStatus(out).IsComplete());
  EXPECT_EQ(ReadJobStatus(out).shards.size(), 1u);
  WritePart(out, {}, 0, 7);
  EXPECT_TRUE(ReadJobStatus(out).IsComplete());
  EXPECT_EQ(ShardsToSubmit(ReadJobStatus(out)), "");
}

TEST(JobStatus, NoJobAndPartsOfDifferentOnesAreNamed) {
  const fs::path out = TestFolder();
  EXPECT_TRUE(FailsWithInputError([&] { ReadJobStatus(out); }, {out.string(), "no manifest"}));
  WritePart(out, {0, 2}, 0, 1);
  WriteManifestText(ManifestPath(out, {1, 2}), R"({"command":"render","tasks":8})", {});
  EXPECT_TRUE(FailsWithInputError([&] { ReadJobStatus(out); }, {"1-of-2", "another job"}));
  WriteManifestText(ManifestPath(out, {1, 3}), kHeader, {});
  fs::remove(ManifestPath(out, {1, 2}));
  EXPECT_TRUE(FailsWithInputError([&] { ReadJobStatus(out); }, {"1-of-3", "another job"}));
  fs::remove_all(out);
  WriteManifestText(ManifestPath(out, {}), "{}", {});
  EXPECT_TRUE(FailsWithInputError([&] { ReadJobStatus(out); }, {"manifest.jsonl", "header"}));
}

}  // namespace
}  // namespace raylift
