// localize as a job: it is stopped and killed, goes on, and shares its work, and its results are
// those of one run that was left alone.

#include <csignal>

#include "apps/job_runs.h"
#include "apps/program.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

class LocalizeJob : public ::testing::Test {
 protected:
  // The demo scene with few references and features, so that it is quick.
  Arguments Localize(const fs::path& out, const Arguments& more = {}) const {
    return LocalizeDemo(folder_ / "cache", out) +
           Arguments{"--every", "4", "--max-features", "500", "--quiet"} + more;
  }

  // What a run that is left alone leaves.
  fs::path Whole(const Arguments& more = {}) const {
    const fs::path whole = folder_ / "whole";
    EXPECT_TRUE(Succeeds(RunRaylift(Localize(whole, more))));
    EXPECT_EQ(CountDone(whole), 12u);
    return whole;
  }

  static void ExpectSame(const fs::path& a, const fs::path& b) {
    EXPECT_EQ(ReadFile(a / "poses.txt"), ReadFile(b / "poses.txt"));
    EXPECT_EQ(ReadFile(a / "queries.jsonl"), ReadFile(b / "queries.jsonl"));
    EXPECT_EQ(ReadFile(a / "manifest.jsonl"), ReadFile(b / "manifest.jsonl"));
    EXPECT_EQ(ReadFile(a / "summary.json"), ReadFile(b / "summary.json"));
    EXPECT_EQ(FilesBelow(a), FilesBelow(b));
  }

  void InterruptAtRandom(const Arguments& more, int default_rounds) {
    const fs::path whole = Whole(more);
    raylift::InterruptAtRandom(
        {.command =
             [&](const fs::path& out) { return Localize(out, more + Arguments{"--resume"}); },
         .tasks = 12,
         .start_microseconds = 400'000,  // the scene is opened or learned from
         .task_microseconds = 20'000,
         .result = "poses.txt",
         .expect_whole = [&](const fs::path& out) { ExpectSame(whole, out); }},
        folder_, default_rounds, TestRng());
  }

  fs::path folder_ = TestFolder();
};

TEST_F(LocalizeJob, FindsWhatShardsOfPrepareHaveMade) {
  const fs::path whole = Whole();
  fs::remove_all(folder_ / "cache");
  Arguments prepare = Localize(folder_ / "result");
  prepare.front() = "prepare";
  prepare.erase(std::find(prepare.begin(), prepare.end(), "--quiet"));
  const CommandResult first = RunRaylift(prepare + Arguments{"--shard", "1/2"});
  EXPECT_NE(first.out.find("features of 18 images: 9 extracted now, 9 missing"), std::string::npos)
      << first.out << first.err;
  const CommandResult second = RunRaylift(prepare + Arguments{"--shard", "2/2"});
  EXPECT_NE(second.out.find("features of 18 images: 9 extracted now, 0 missing"), std::string::npos)
      << second.out << second.err;
  EXPECT_TRUE(fs::exists(folder_ / "cache/features.h5"));
  EXPECT_FALSE(fs::exists(folder_ / "cache/parts"));
  EXPECT_TRUE(Succeeds(RunRaylift(Localize(folder_ / "result"))));
  ExpectSame(whole, folder_ / "result");
}

TEST_F(LocalizeJob, InterruptedAtRandomItEndsWithTheSameBytes) { InterruptAtRandom({}, 6); }

TEST_F(LocalizeJob, InterruptedAtRandomWhileItRendersAgainItEndsWithTheSameBytes) {
  InterruptAtRandom({"--rerender", "1", "--filter", "auto"}, 2);
}

TEST_F(LocalizeJob, ASignalKeepsWhatIsDone) {
  const fs::path whole = Whole();
  for (const int signal : {SIGINT, SIGTERM}) {
    const fs::path out = folder_ / std::to_string(signal);
    EXPECT_EQ(Interrupt(Localize(out, {"--threads", "1"}), out, signal, 2, 0), 4);
    const size_t done = CountDone(out);
    EXPECT_GE(done, 2u);
    EXPECT_LT(done, 12u);
    EXPECT_FALSE(fs::exists(out / "poses.txt"));
    ASSERT_TRUE(Succeeds(RunRaylift(Localize(out, {"--resume"}))));
    ExpectSame(whole, out);
  }
}

TEST_F(LocalizeJob, ALineThatWasCutOffIsDoneAgain) {
  const fs::path whole = Whole();
  const fs::path out = folder_ / "out";
  const std::string text = ReadFile(whole / "manifest.jsonl");
  const size_t last = text.rfind("{\"name\"");
  const size_t facts = text.find("{\"scene\"");
  for (const size_t size : {last + 1, text.size() - 1, text.find('\n', facts) + 100, facts + 100,
                            facts, facts - 1, size_t{5}}) {
    fs::remove_all(out);
    WriteFile(out / "manifest.jsonl", text.substr(0, size));
    ASSERT_TRUE(Succeeds(RunRaylift(Localize(out, {"--resume"}))));
    ExpectSame(whole, out);
  }
}

TEST_F(LocalizeJob, AFormerRunIsReplacedOnlyWhereThatIsAskedFor) {
  const fs::path whole = Whole();
  const std::string before = ReadFile(whole / "queries.jsonl");
  const std::string manifest = ReadFile(whole / "manifest.jsonl");
  const std::string timing = ReadFile(whole / "timing.jsonl");
  EXPECT_TRUE(FailsWith(2, {"--overwrite", "--resume", whole.string(), "former run"},
                        RunRaylift(Localize(whole))));
  EXPECT_TRUE(FailsWith(2, {"--overwrite", "--resume"},
                        RunRaylift(Localize(whole, {"--overwrite", "--resume"}))));
  EXPECT_TRUE(FailsWith(2, {"former run"}, RunRaylift(Localize(whole, {"--continuous"}))));
  EXPECT_EQ(ReadFile(whole / "queries.jsonl"), before);
  ASSERT_TRUE(Succeeds(RunRaylift(Localize(whole, {"--resume"}))));
  EXPECT_EQ(ReadFile(whole / "queries.jsonl"), before);
  EXPECT_EQ(ReadFile(whole / "manifest.jsonl"), manifest);
  EXPECT_EQ(ReadFile(whole / "timing.jsonl"), timing);
  ASSERT_TRUE(Succeeds(RunRaylift(Localize(whole, {"--overwrite"}))));
  EXPECT_EQ(ReadFile(whole / "manifest.jsonl"), manifest);
  EXPECT_NE(ReadFile(whole / "timing.jsonl"), timing);
  EXPECT_EQ(ReadFile(whole / "queries.jsonl"), before);
}

TEST_F(LocalizeJob, ARunOfOtherOptionsOrInputsDoesNotGoOn) {
  const fs::path whole = Whole();
  const std::string queries = ReadFile(DemoFolder() / "queries.txt");
  WriteFile(folder_ / "queries.txt", queries.substr(0, queries.rfind("query/")));
  const auto fails = [&](const Arguments& more, const std::vector<std::string>& parts) {
    return FailsWith(3, parts, RunRaylift(Localize(whole, Arguments{"--resume"} + more)));
  };
  EXPECT_TRUE(fails({"--seed", "7"}, {"manifest.jsonl", "options/seed: 0 there, 7 here"}));
  EXPECT_TRUE(fails({"--write-problems", folder_ / "problems"}, {"options/write-problems"}));
  Arguments moved = Localize(whole, {"--resume"});
  moved[6] += ",shift=0/0/1";
  EXPECT_TRUE(FailsWith(3, {"options/geometry"}, RunRaylift(moved)));
  Arguments fewer = Localize(whole, {"--resume"});
  fewer[8] = folder_ / "queries.txt";
  EXPECT_TRUE(FailsWith(3, {"tasks: 12 there, 11 here"}, RunRaylift(fewer)));
  // Threads change nothing.
  EXPECT_TRUE(Succeeds(RunRaylift(Localize(whole, {"--resume", "--threads", "3"}))));
}

TEST_F(LocalizeJob, AnotherMeshUnderTheSameNameIsAnotherInput) {
  const RoomScene scene = WriteRoomScene(folder_ / "scene");
  const RoomScene other = WriteRoomScene(folder_ / "other", {.offset = {0.5, 0, 0}});
  const Arguments command = LocalizeWithHloc(scene, folder_ / "out") + Arguments{"--resume"};
  ASSERT_TRUE(Succeeds(RunRaylift(command)));
  EXPECT_TRUE(Succeeds(RunRaylift(command)));
  const std::string pairs = ReadFile(scene.pairs());
  WriteFile(scene.pairs(), pairs + "\n");
  EXPECT_TRUE(FailsWith(3, {"inputs/pairs"}, RunRaylift(command)));
  WriteFile(scene.pairs(), pairs);
  WriteFile(scene.mesh(), ReadFile(other.mesh()));
  EXPECT_TRUE(FailsWith(3, {"inputs/geometry 1"}, RunRaylift(command)));
}

TEST_F(LocalizeJob, AFullDiskNamesTheFileAndTheRestIsResumed) {
  const fs::path whole = Whole();
  const fs::path out = folder_ / "out";
  // No file may be larger than 16 kB, which the manifest is in the end.
  ASSERT_GT(fs::file_size(whole / "manifest.jsonl"), 16u * 1024);
  const CommandResult full = RunProcess(WithFullDisk(32, Localize(out)));
  EXPECT_TRUE(FailsWith(5, {(out / "manifest.jsonl").string(), "cannot be written"}, full));
  EXPECT_GT(CountDone(out), 0u);
  EXPECT_LT(CountDone(out), 12u);
  ASSERT_TRUE(Succeeds(RunRaylift(Localize(out, {"--resume"}))));
  ExpectSame(whole, out);
}

TEST_F(LocalizeJob, ThePageIsThatOfOneRunWhoeverEndsIt) {
  const fs::path out = folder_ / "out", page = folder_ / "page";
  const Arguments localize = Localize(out, {"--report", page});
  ASSERT_TRUE(Succeeds(RunRaylift(localize)));
  const std::string whole = ReadFile(page / "index.html");
  const auto begin_anew = [&] {
    fs::remove_all(out);
    fs::remove_all(page);
  };
  begin_anew();
  EXPECT_EQ(Interrupt(localize + Arguments{"--threads", "1"}, out, SIGTERM, 2, 0), 4);
  ASSERT_TRUE(Succeeds(RunRaylift(localize + Arguments{"--resume"})));
  EXPECT_EQ(ReadFile(page / "index.html"), whole);
  begin_anew();
  for (const std::string shard : {"1/2", "2/2"}) {
    EXPECT_FALSE(fs::exists(page / "index.html"));
    ASSERT_TRUE(Succeeds(RunRaylift(localize + Arguments{"--shard", shard})));
  }
  EXPECT_EQ(ReadFile(page / "index.html"), whole);
}

TEST_F(LocalizeJob, AFileThatIsLostIsMissedAndMadeAgain) {
  const fs::path problems = folder_ / "problems";
  const Arguments localize = Localize(folder_ / "out", {"--write-problems", problems});
  ASSERT_TRUE(Succeeds(RunRaylift(localize)));
  const auto whole = FilesBelow(problems);
  ASSERT_EQ(whole.size(), 12u);
  EXPECT_TRUE(Succeeds(RunRaylift({"verify", folder_ / "out"})));
  const std::string lost = ReadFile(problems / whole.front());
  fs::remove(problems / whole.front());
  fs::remove(folder_ / "out/depth_alignment.jsonl");
  fs::remove(folder_ / "out/summary.json");
  const CommandResult verified = RunRaylift({"verify", folder_ / "out"});
  EXPECT_EQ(verified.exit_code, 3);
  for (const std::string& file : {whole.front(), std::string("summary.json")}) {
    EXPECT_NE(verified.out.find(file + " is missing\n"), std::string::npos) << verified.out;
  }
  ASSERT_TRUE(Succeeds(RunRaylift(localize + Arguments{"--resume"})));
  EXPECT_EQ(ReadFile(problems / whole.front()), lost);
  EXPECT_TRUE(Succeeds(RunRaylift({"verify", folder_ / "out"})));
}

TEST_F(LocalizeJob, AFolderThatIsRemovedInMidRunIsAnError) {
  for (const std::string removed_is : {"beside", "out"}) {
    const fs::path out = folder_ / removed_is / "out";
    const fs::path removed = removed_is == "out" ? out : folder_ / "problems";
    const Arguments command =
        Localize(out, {"--threads", "1", "--write-problems", removed / "problems"});
    EXPECT_EQ(RemoveMidway(command, out, 2, removed), 5) << removed;
  }
}

TEST_F(LocalizeJob, ShardsSideBySideAreOneRun) {
  const fs::path whole = Whole();
  const fs::path out = folder_ / "out";
  std::vector<pid_t> shards;
  for (const std::string shard : {"1/3", "2/3", "3/3"}) {
    shards.push_back(StartRaylift(Localize(out, {"--shard", shard})));
  }
  for (const pid_t shard : shards) EXPECT_EQ(WaitFor(shard), 0);
  ExpectSame(whole, out);
  EXPECT_TRUE(FailsWith(2, {"former run"}, RunRaylift(Localize(out, {"--shard", "1/3"}))));
  ASSERT_TRUE(Succeeds(RunRaylift(Localize(out, {"--shard", "1/3", "--resume"}))));
  ExpectSame(whole, out);
}

TEST_F(LocalizeJob, StatusTellsWhichShardsAreLeft) {
  const fs::path out = folder_ / "out";
  EXPECT_TRUE(FailsWith(3, {out.string(), "no manifest"}, RunRaylift({"status", out})));
  ASSERT_TRUE(Succeeds(RunRaylift(Localize(out, {"--shard", "1/4"}))));
  const Arguments third = Localize(out, {"--shard", "2/4", "--threads", "1"});
  Interrupt(third, out, SIGKILL, 4, 0);
  const CommandResult status = RunRaylift({"status", out});
  EXPECT_EQ(status.exit_code, 4);
  EXPECT_NE(status.out.find("shard 1/4: 3 of 3, done"), std::string::npos) << status.out;
  // It may have done another one before it was killed.
  const size_t done = CountDone(out);
  ASSERT_TRUE(done == 4 || done == 5) << done;
  const std::string stopped = "shard 2/4: " + std::to_string(done - 3) + " of 3, stopped or failed";
  EXPECT_NE(status.out.find(stopped), std::string::npos) << status.out;
  EXPECT_NE(status.out.find("--array=0,2-3 with --shard auto/4"), std::string::npos) << status.out;
  const std::string left = std::to_string(12 - done) + " of 12 are not done";
  EXPECT_NE(status.err.find(left), std::string::npos) << status.err;
  for (const std::string shard : {"0/4", "2/4", "3/4"}) {
    ASSERT_TRUE(Succeeds(RunRaylift(Localize(out, {"--shard", shard, "--resume"}))));
  }
  EXPECT_TRUE(Succeeds(RunRaylift({"status", out})));
  ExpectSame(Whole(), out);
}

TEST_F(LocalizeJob, PartsInFoldersOfTheirOwnAreMerged) {
  const fs::path whole = Whole();
  const fs::path out = folder_ / "out";
  Arguments merge = {"merge", out};
  for (const std::string shard : {"0/3", "1/3", "2/3"}) {
    const fs::path part = folder_ / ("part" + shard.substr(0, 1));
    if (shard == "2/3") {
      EXPECT_TRUE(FailsWith(4, {"4 of 12 queries"}, RunRaylift(merge)));
    }
    ASSERT_TRUE(Succeeds(RunRaylift(Localize(part, {"--shard", shard}))));
    merge.push_back(part);
  }
  EXPECT_FALSE(fs::exists(out / "poses.txt"));
  const CommandResult merged = RunRaylift(merge);
  ASSERT_TRUE(Succeeds(merged));
  EXPECT_TRUE(merged.out.starts_with("merged 3 parts: localized ")) << merged.out;
  ExpectSame(whole, out);
  // What is merged can go on as if it had not been shared.
  ASSERT_TRUE(Succeeds(RunRaylift(Localize(out, {"--resume"}))));
  ExpectSame(whole, out);

  ASSERT_TRUE(Succeeds(RunRaylift(Localize(folder_ / "other", {"--seed", "1"}))));
  EXPECT_TRUE(FailsWith(3, {(folder_ / "other").string(), "options/seed: 0 there, 1 here"},
                        RunRaylift({"merge", out, folder_ / "other"})));
  EXPECT_TRUE(FailsWith(3, {folder_.string(), "no manifest"}, RunRaylift({"merge", folder_})));
}

}  // namespace
}  // namespace raylift
