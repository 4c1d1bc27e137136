// Inputs that never end, signals at any time, and the limits that a shell sets.

#include <csignal>

#include "apps/job_runs.h"
#include "apps/program.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>
#include <sys/stat.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

Arguments InShell(const std::string& script, const Arguments& command) {
  return Arguments{"/bin/bash", "-c", script, "bash", RAYLIFT_PROGRAM} + command;
}

Arguments Localize(const fs::path& out, const fs::path& mesh, const fs::path& queries) {
  return {"localize",
          "--model",
          DemoFolder() / "model",
          "--images",
          DemoFolder() / "images",
          "--geometry",
          "mesh:" + mesh.string(),
          "--queries",
          queries,
          "--out",
          out,
          "--quiet"};
}

TEST(Limits, InputsThatNeverEndAreRefused) {
  const fs::path folder = TestFolder();
  for (const char* name : {"pipe", "pipe.obj", "pipe.ply", "pipe.glb", "pipe.dae"}) {
    ASSERT_EQ(mkfifo((folder / name).c_str(), 0600), 0);
  }
  const fs::path mesh = DemoFolder() / "scene.obj";
  EXPECT_TRUE(FailsWith(3, {"pipe: expected a file, found a pipe"},
                        RunRaylift(Localize(folder / "out", mesh, folder / "pipe"))));
  EXPECT_TRUE(FailsWith(3, {"/dev/zero: expected a file, found a device"},
                        RunRaylift(Localize(folder / "out", mesh, "/dev/zero"))));
  for (const char* name : {"pipe.obj", "pipe.ply", "pipe.glb", "pipe.dae"}) {
    EXPECT_TRUE(FailsWith(
        3, {name, "expected a file"},
        RunRaylift(Localize(folder / "out", folder / name, DemoFolder() / "queries.txt"))));
  }
}

Arguments Evaluate() { return {"evaluate", "--ground-truth", DemoFolder() / "ground_truth"}; }

// A list may come from a shell's pipe.
TEST(Limits, ListsOfAShellAreRead) {
  const CommandResult result = RunProcess(
      InShell("exec \"$@\" --poses <(echo query/query_01.jpg 1 0 0 0 0 0 0)", Evaluate()));
  EXPECT_EQ(result.exit_code, 0) << result.err;
}

// It waits for what never comes.
TEST(Limits, ASignalEndsWhatDoesNotHeedIt) {
  const CommandResult result = RunProcess(
      InShell("exec 3< <(sleep 30); \"$@\" --poses /dev/fd/3 & sleep 1; kill -TERM $!; wait $!",
              Evaluate()));
  EXPECT_TRUE(FailsWith(4, {"stopped by a signal"}, result));
}

TEST(Limits, ASignalEndsEveryCommandInGoodOrder) {
  const fs::path folder = TestFolder();
  const fs::path out = folder / "colored.ply";
  EXPECT_EQ(Terminate(StartRaylift({"color", DemoFolder() / "scene.obj", "--model",
                                    DemoFolder() / "model", "--images", DemoFolder() / "images",
                                    "--out", out})),
            4);
  EXPECT_FALSE(fs::exists(out));
  EXPECT_EQ(Terminate(StartRaylift({"merge", folder / "none"})), 4);
  EXPECT_EQ(
      Terminate(StartRaylift({"export", "tum", folder / "none", "--out", folder / "poses.tum"})),
      4);
}

TEST(Limits, ASmallStackIsAnError) {
  EXPECT_TRUE(
      FailsWith(6, {"stack"}, RunProcess(InShell("ulimit -s 64; exec \"$@\"", {"--version"}))));
}

}  // namespace
}  // namespace raylift
