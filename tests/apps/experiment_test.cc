// A whole experiment by the program: its files, what is not done again, and the same bytes.

#include <set>

#include "apps/program.h"
#include "support/test_data.h"
#include <gmock/gmock.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

fs::path WriteExperiment(const RoomScene& scene) {
  fs::path file = scene.folder / "experiment.toml";
  WriteFile(file, R"(
seeds = [0, 1]
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
filter = ["off", "auto"]
method = ["p3p", "e5p1", "adaptive", "select", "oracle"]
[[table]]
name = "methods"
rows = ["method", "filter"]
columns = ["geometry", "every"]
[[figure]]
name = "thinning"
panels = "geometry"
lines = ["method", "filter"]
[[claim]]
text = "Adaptive is not worse"
relation = "not_worse"
first = { method = "adaptive" }
second = { method = ["p3p", "e5p1"] }
)");
  return file;
}

std::map<std::string, std::string> Tables(const fs::path& folder) {
  std::map<std::string, std::string> contents;
  for (const std::string& file : FilesBelow(folder)) {
    if (file != "options.json") contents[file] = ReadFile(folder / file);
  }
  return contents;
}

TEST(Experiment, MakesItsTablesOnceAndTheSameForAnyThreads) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path file = WriteExperiment(scene), out = scene.folder / "out";
  const CommandResult first = RunRaylift({"experiment", file, "--out", out, "--threads", "1"});
  ASSERT_TRUE(Succeeds(first));
  EXPECT_THAT(first.out, HasSubstr("44 cells estimated, 0 were there"));
  const std::string table = ReadFile(out / "tables" / "methods.csv");
  EXPECT_THAT(table, HasSubstr("\nP3P,off,100.0,100.0,0.0,0.0\n"));
  EXPECT_THAT(table, HasSubstr("\nE5+1,,100.0,100.0,100.0,100.0\n"));
  EXPECT_THAT(
      ReadFile(out / "claims.md"),
      ::testing::AllOf(HasSubstr("Adaptive is not worse"),
                       ::testing::ContainsRegex("[|] (shown|holds|noise|contradicted) [|]\n")));
  EXPECT_THAT(ReadFile(out / "index.html"), HasSubstr("\"experiment\""));

  const auto contents = Tables(out);
  const CommandResult second = RunRaylift({"experiment", file, "--out", out});
  EXPECT_THAT(second.out, HasSubstr("0 cells estimated, 44 were there"));
  EXPECT_EQ(Tables(out), contents);

  // Some cells are lost: they alone are made again.
  const std::string lost = FilesBelow(out / "cells").front();
  fs::remove(out / "cells" / lost);
  const CommandResult third = RunRaylift({"experiment", file, "--out", out, "--threads", "4"});
  EXPECT_THAT(third.out, HasSubstr("1 cells estimated, 43 were there"));
  EXPECT_EQ(Tables(out), contents);
}

TEST(Experiment, ADryRunListsTheGridAndWhatIsMissing) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path file = WriteExperiment(scene), out = scene.folder / "out";
  fs::remove(scene.folder / "room.obj");
  const CommandResult result = RunRaylift({"experiment", file, "--out", out, "--dry-run"});
  ASSERT_TRUE(Succeeds(result));
  EXPECT_THAT(result.out, HasSubstr("scene=room every=2 method=e5p1\n"));
  EXPECT_THAT(result.out, HasSubstr("missing: " + scene.mesh().string()));
  EXPECT_FALSE(fs::exists(out));
  EXPECT_TRUE(FailsWith(3, {"experiment.toml", "room.obj does not exist"},
                        RunRaylift({"experiment", file, "--out", out})));
}

TEST(Experiment, ScenesWithoutGroundTruthLeavePosesForAServer) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path file = WriteExperiment(scene), out = scene.folder / "out";
  Replace(file, "ground_truth = \"truth\"\n", "");
  Replace(file, "seeds = [0, 1]", "seeds = 0");
  ASSERT_TRUE(Succeeds(RunRaylift({"experiment", file, "--out", out})));
  EXPECT_TRUE(HoldsTruePoses(out / "submissions" / "room" / "every1-e5p1-seed0.txt", scene.queries,
                             1e-3, 1e-4));
  EXPECT_THAT(ReadFile(out / "tables" / "methods.md"), HasSubstr("| E5+1 |  | - | - | - | - |"));
}

TEST(Experiment, LocalizedQueriesJoinTheReferencesOfAContinuousScene) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path file = WriteExperiment(scene), out = scene.folder / "out";
  Replace(file, "model = ", "continuous = true\nmodel = ");
  Replace(file, "every = [1, 2]", "geometry = \"mesh\"");
  Replace(file, "seeds = [0, 1]", "seeds = 0");
  const CommandResult result = RunRaylift({"experiment", file, "--out", out});
  ASSERT_TRUE(Succeeds(result));
  EXPECT_THAT(result.out, HasSubstr("7 cells estimated"));  // Select is estimated, too
  EXPECT_THAT(ReadFile(out / "tables" / "methods.csv"), HasSubstr("\nAdaptive,off,100.0\n"));
  EXPECT_TRUE(fs::is_empty(out / "cache" / "continuous"));
}

TEST(Experiment, ReadyExperimentsAreListed) {
  const fs::path folder = RAYLIFT_EXPERIMENTS_FOLDER;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.path().extension() != ".toml") continue;
    EXPECT_TRUE(Succeeds(RunRaylift({"experiment", entry.path(), "--datasets", "/nowhere", "--out",
                                     "/nowhere/out", "--dry-run"})))
        << entry.path();
  }
}

}  // namespace
}  // namespace raylift
