#include "raylift/jobs/task_job.h"

#include "jobs/file_promises.h"
#include "jobs/manifest_file.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

const std::string kTestHeader = R"({"command":"test","tasks":5,"options":{"seed":0}})";
const std::string kOtherHeader = R"({"command":"test","tasks":5,"options":{"seed":1}})";
const std::vector<std::string> kNames = {"a", "b", "c", "d", "e"};

class TaskJobs : public ::testing::Test {
 protected:
  TaskJob Open(const JobFolder& folder, const std::string& header = kTestHeader) const {
    return {kNames,
            header,
            folder,
            {.results = {"result.txt"},
             .is_readable = [](const std::string& line) { return line != kDamaged; }}};
  }

  // With `file`, the task writes one.
  static void Do(size_t task, TaskJob& job, const fs::path& file = {}) {
    nlohmann::ordered_json line = {{"name", kNames[task]}, {"place", task}, {"key", job.key(task)}};
    if (!file.empty()) {
      WriteFile(file, kNames[task]);
      line["files"] = FilesJson(PromiseFiles(file.parent_path(), {&file, 1}));
    }
    job.Add(task, line.dump());
  }

  // Each of them writes a file of its own.
  void DoMissingWithFiles(TaskJob& job) const {
    for (const size_t task : job.Missing()) Do(task, job, out_ / kNames[task]);
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
  job.Finish(*whole, {});
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
    if (whole) job.Finish(*whole, {});
  }
  EXPECT_EQ(ListManifests(out_), std::vector<fs::path>{out_ / "manifest.jsonl"});
  std::string names;
  for (const std::string& line : ReadManifestText(out_ / "manifest.jsonl").lines) {
    names += line.substr(9, 1);
  }
  EXPECT_EQ(names, "abcde") << "as if one had done them in their order";
}

TEST_F(TaskJobs, DoATaskAgainWhoseFileIsNotAsItWasWritten) {
  {
    TaskJob job = Open({.out = out_});
    job.Begin(std::nullopt);
    DoMissingWithFiles(job);
  }
  fs::remove(out_ / "b");
  WriteFile(out_ / "d", "D");  // of the same size
  TaskJob job = Open({.out = out_, .resume = true});
  EXPECT_EQ(job.Missing(), (std::vector<size_t>{1, 3}));
}

TEST_F(TaskJobs, DoNotEndWithoutTheirFiles) {
  TaskJob job = Open({.out = out_});
  job.Begin(std::nullopt);
  DoMissingWithFiles(job);
  fs::remove(out_ / "b");
  EXPECT_TRUE(FailsWithInputError([&] { job.Whole(); }, {"1 of 5 files", "b is missing"}));
}

TEST_F(TaskJobs, DoNotCountWhatCannotBeKept) {
  TaskJob job = Open({.out = out_});
  job.Begin(std::nullopt);
  Do(0, job);
  EXPECT_EQ(job.Missing(), (std::vector<size_t>{1, 2, 3, 4}));
  const nlohmann::ordered_json line = {
      {"name", "b"},
      {"place", 1},
      {"key", job.key(1)},
      {"files", FilesJson(std::vector{PromisedFile{.path = "manifest.jsonl/b"}})}};
  job.Add(1, line.dump());
  EXPECT_TRUE(FailsWithInputError([&] { job.Missing(); }, {"manifest.jsonl/b", "be synced"}));
  EXPECT_TRUE(FailsWithInputError([&] { Do(2, job); }, {"manifest.jsonl/b", "be synced"}));
}

TEST_F(TaskJobs, DoNotEndWithoutTheirManifest) {
  TaskJob job = Open({.out = out_, .shard = {0, 2}});
  job.Begin(std::nullopt);
  DoMissing(job);
  fs::remove_all(out_);
  EXPECT_TRUE(FailsWithInputError([&] { job.Whole(); }, {"manifest.0-of-2.jsonl", "removed"}));
}

TEST_F(TaskJobs, PromiseTheirResults) {
  TaskJob job = Open({.out = out_});
  job.Begin(std::nullopt);
  DoMissingWithFiles(job);
  const std::vector<fs::path> results = {out_ / "result.txt", out_ / "options.json"};
  EXPECT_TRUE(FailsWithInputError([&] { job.Finish(*job.Whole(), results); }, {"result.txt"}));
}

TEST_F(TaskJobs, AreVerified) {
  const std::vector<fs::path> results = {out_ / "result.txt", out_ / "options.json"};
  {
    TaskJob job = Open({.out = out_});
    job.Begin(std::nullopt);
    DoMissingWithFiles(job);
    for (const fs::path& file : results) WriteFile(file, "result");
    job.Finish(*job.Whole(), results);
  }
  const Verification good = VerifyFiles(out_, 1);
  EXPECT_EQ(good.tasks, 5u);
  EXPECT_EQ(good.files, 7u);
  EXPECT_TRUE(good.faults.empty());
  WriteFile(out_ / "options.json", "other threads");
  WriteFile(out_ / "result.txt", "RESULT");
  fs::remove(out_ / "c");
  const Verification bad = VerifyFiles(out_, 1);
  ASSERT_EQ(bad.faults.size(), 2u);
  EXPECT_EQ(bad.faults[0].file + " " + bad.faults[0].what, "c is missing");
  EXPECT_EQ(bad.faults[1].file + " " + bad.faults[1].what, "result.txt has other contents");
}

// A name of bytes that are no UTF-8, and a folder beside the job's that a link stands for.
TEST(FilePromises, HoldForAnyName) {
  const fs::path folder = TestFolder();
  const fs::path elsewhere = folder / "far/away";
  fs::create_directories(elsewhere);
  fs::create_directories(folder / "job");
  fs::create_directory_symlink(elsewhere, folder / "link");
  const std::vector<fs::path> files = {folder / "job/\xff.txt", folder / "link/b.txt"};
  for (const fs::path& file : files) WriteFile(file, "x");
  const std::string line =
      nlohmann::ordered_json{{"files", FilesJson(PromiseFiles(folder / "job", files))}}.dump();
  EXPECT_EQ(FilesOfLine(line).size(), 2u);
  EXPECT_TRUE(KeepsPromise(folder / "job", line, FileCheck::kContents)) << line;
  fs::create_directories(folder / "other");
  EXPECT_TRUE(KeepsPromise(folder / "other", InFolder(line, folder / "job", folder / "other"),
                           FileCheck::kContents));
  fs::remove(elsewhere / "b.txt");
  EXPECT_FALSE(KeepsPromise(folder / "job", line, FileCheck::kSizes));
}

}  // namespace
}  // namespace raylift
