#include "jobs/manifest_file.h"

#include <algorithm>
#include <thread>

#include "support/matchers.h"
#include "support/test_data.h"
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

using Strings = std::vector<std::string>;

TEST(ManifestFile, NamesTellTheShard) {
  const fs::path out = TestFolder();
  for (const Shard shard : {Shard{}, Shard{0, 3}, Shard{11, 12}}) {
    EXPECT_EQ(ShardOfManifest(ManifestPath(out, shard)), shard);
    WriteManifestText(ManifestPath(out, shard), "{}", {});
  }
  for (const std::string name :
       {"manifest", "manifest.json", "manifest.3-of-3.jsonl", "manifest.-1-of-3.jsonl",
        "manifest.01-of-3.jsonl", "manifest.0-of-3.jsonl.tmp", "manifest-of-3.jsonl", "a.jsonl"}) {
    EXPECT_FALSE(ShardOfManifest(name)) << name;
    WriteFile(out / name, "");
  }
  EXPECT_EQ(ListManifests(out),
            (std::vector<fs::path>{ManifestPath(out, {0, 3}), ManifestPath(out, {11, 12}),
                                   ManifestPath(out, {})}));
  EXPECT_TRUE(IsManifestOfOtherShard("manifest.0-of-3.jsonl", {1, 3}));
  EXPECT_FALSE(IsManifestOfOtherShard("manifest.1-of-3.jsonl", {1, 3}));
  EXPECT_FALSE(IsManifestOfOtherShard("manifest.0-of-2.jsonl", {1, 3}));
  EXPECT_FALSE(IsManifestOfOtherShard("manifest.jsonl", {}));
}

TEST(ManifestFile, LinesAreThereOnceTheyHaveTheirEnd) {
  const fs::path file = TestFolder() / "manifest.jsonl";
  EXPECT_EQ(ReadManifestText(file).header, "");
  WriteManifestText(file, "header", Strings{"a"});
  ManifestAppender(file).Append("b");
  EXPECT_EQ(ReadManifestText(file).header, "header");
  EXPECT_EQ(ReadManifestText(file).lines, (Strings{"a", "b"}));
  WriteFile(file, "header\na\nb");
  EXPECT_EQ(ReadManifestText(file).lines, Strings{"a"});
  WriteFile(file, "head");
  EXPECT_EQ(ReadManifestText(file).header, "");
}

TEST(ManifestFile, LinesOfAThreadKeepTheirOrder) {
  const fs::path file = TestFolder() / "manifest.jsonl";
  WriteManifestText(file, "header", {});
  constexpr int kThreads = 3, kLines = 100;
  ManifestAppender appender(file);
  std::vector<std::thread> threads;
  for (int t = 0; t < kThreads; ++t) {
    threads.emplace_back([&appender, t] {
      for (int i = 0; i < kLines; ++i) appender.Append(fmt::format("{} {:02}", t, i));
    });
  }
  for (std::thread& thread : threads) thread.join();
  appender.Flush();
  Strings lines = ReadManifestText(file).lines;
  ASSERT_EQ(lines.size(), size_t{kThreads * kLines});
  std::stable_sort(lines.begin(), lines.end(),
                   [](const std::string& a, const std::string& b) { return a[0] < b[0]; });
  EXPECT_TRUE(std::is_sorted(lines.begin(), lines.end()));
}

// As where the disk is full.
TEST(ManifestFile, AFailedWriteEndsFlushAndWhatFollows) {
  const fs::path full = "/dev/full";
  if (!fs::exists(full)) GTEST_SKIP();
  ManifestAppender appender(full);
  appender.Append("a");
  EXPECT_TRUE(FailsWithInputError([&] { appender.Flush(); }, {"/dev/full", "cannot be written"}));
  EXPECT_TRUE(
      FailsWithInputError([&] { appender.Append("b"); }, {"/dev/full", "cannot be written"}));
}

TEST(ManifestFile, OneRunAppendsAtATime) {
  const fs::path file = TestFolder() / "manifest.jsonl";
  WriteManifestText(file, "header", {});
  EXPECT_FALSE(IsBeingAppended(file));
  {
    const ManifestAppender appender(file);
    EXPECT_TRUE(IsBeingAppended(file));
    EXPECT_TRUE(FailsWithInputError([&] { RefuseIfAppended(file); }, {"another run"}));
    EXPECT_TRUE(FailsWithInputError([&] { ManifestAppender{file}; }, {"another run"}));
  }
  EXPECT_FALSE(IsBeingAppended(file));
  RefuseIfAppended(file);
}

}  // namespace
}  // namespace raylift
