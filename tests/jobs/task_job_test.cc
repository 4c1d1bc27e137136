#include "raylift/jobs/task_job.h"

#include "jobs/manifest_file.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

const std::string kHeader = R"({"command":"test","tasks":5,"options":{"seed":0}})";
const std::string kOtherHeader = R"({"command":"test","tasks":5,"options":{"seed":1}})";
const std::vector<std::string> kNames = {"a", "b", "c", "d", "e"};

class TaskJobs : public ::testing::Test {
 protected:
  TaskJob Open(const JobFolder& folder, const std::string& header = kHeader) const {
    return {kNames,
            header,
            folder,
            {.results = {"result.txt"},
             .is_readable = [](const std::string& line) { return line != kDamaged; }}};
  }

  static void Do(size_t task, TaskJob& job) {
    job.Add(task, R"({"name":")" + kNames[task] + R"(","place":)" + std::to_string(task) +
                      R"(,"key":")" + job.key(task) + "\"}");
  }

  // Those that are missing, but for the last `but`.
  static void DoMissing(TaskJob& job, size_t but = 0) {
    const std::vector<size_t> missing = job.Missing();
    for (size_t i = 0; i + but < missing.size(); ++i) Do(missing[i], job);
  }

  static inline const std::string kDamaged = R"({"name":"damaged","place":0,"key":"0"})";
  fs::path out_ = TestFolder();
};

TEST_F(TaskJobs, GoOnWhereTheyWere) {
  {
    TaskJob job = Open({.out = out_});
    EXPECT_EQ(job.Missing(), (std::vector<size_t>{0, 1, 2, 3, 4}));
    job.Begin(R"({"fact":1})");
    DoMissing(job, 2);
    EXPECT_FALSE(job.Whole());
  }
  EXPECT_THROW(Open({.out = out_}), OptionError) << "neither resume nor overwrite";
  EXPECT_TRUE(FailsWithInputError([&] { Open({.out = out_, .resume = true}, kOtherHeader); },
                                  {"manifest.jsonl", "options/seed: 0 there, 1 here"}));
  const fs::path manifest = out_ / "manifest.jsonl";
  WriteFile(manifest, ReadFile(manifest) + kDamaged + "\nno JSON\n{\"name\":\"d\",\"pla");
  TaskJob job = Open({.out = out_, .resume = true});
  EXPECT_EQ(job.manifest().facts, R"({"fact":1})");
  EXPECT_EQ(job.Missing(), (std::vector<size_t>{3, 4}));
  job.Begin(job.manifest().facts);
  DoMissing(job);
  const auto whole = job.Whole();
  ASSERT_TRUE(whole);
  EXPECT_EQ(whole->records.size(), 5u);
  job.Finish(*whole);
  EXPECT_EQ(ReadManifestText(manifest).lines.size(), 6u);
}

TEST_F(TaskJobs, OverwriteTakesNothingOverAndRemovesOldResults) {
  {
    TaskJob job = Open({.out = out_});
    job.Begin(std::nullopt);
    DoMissing(job);
    WriteFile(out_ / "result.txt", "old");
  }
  TaskJob job = Open({.out = out_, .overwrite = true}, kOtherHeader);
  EXPECT_EQ(job.Missing().size(), 5u);
  EXPECT_TRUE(fs::exists(out_ / "result.txt")) << "until the new run has begun";
  job.Begin(std::nullopt);
  EXPECT_FALSE(fs::exists(out_ / "result.txt"));
}

TEST_F(TaskJobs, ShardsOfOneFolderMakeAWholeOne) {
  for (int i = 2; i >= 0; --i) {
    TaskJob job = Open({.out = out_, .shard = {i, 3}});
    EXPECT_EQ(job.Missing().size(), i == 2 ? 1u : 2u);
    job.Begin(std::nullopt);
    DoMissing(job);
    const auto whole = job.Whole();
    EXPECT_EQ(whole.has_value(), i == 0);
    if (whole) job.Finish(*whole);
  }
  EXPECT_EQ(ListManifests(out_), std::vector<fs::path>{out_ / "manifest.jsonl"});
  std::string names;
  for (const std::string& line : ReadManifestText(out_ / "manifest.jsonl").lines) {
    names += line.substr(9, 1);
  }
  EXPECT_EQ(names, "abcde") << "as if one had done them in their order";
}

}  // namespace
}  // namespace raylift
