// localize --matches with a folder that holds a file of each pair.

#include "apps/program.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

class PairFolder : public ::testing::Test {
 protected:
  CommandResult Run(const fs::path& out, const Arguments& more = {}) const {
    return RunRaylift(Arguments{"localize", "--model", scene_.model(), "--geometry",
                                "mesh:" + scene_.mesh().string(), "--queries", scene_.query_list(),
                                "--matches", folder_, "--out", out} +
                      more);
  }

  const RoomScene scene_ = WriteRoomScene(TestFolder());
  const fs::path folder_ = scene_.folder / "matches";
};

// What hloc's files hold, written by numpy as others would.
constexpr const char* kScript = R"(
import h5py, numpy as np, os, sys
features, matches, pairs, folder = sys.argv[1:]
os.makedirs(folder)
features, matches = h5py.File(features, 'r'), h5py.File(matches, 'r')
for line in open(pairs):
    names = line.split()
    flat = [name.replace('/', '-') for name in names]
    of_query = matches[flat[0]][flat[1]]['matches0'][()].astype(int)
    matched = np.flatnonzero(of_query >= 0)
    pixels = [features[name]['keypoints'][()] for name in names]
    np.savez(os.path.join(folder, '__'.join(flat)), mkpts0=pixels[0][matched],
             mkpts1=pixels[1][of_query[matched]], scores=np.ones(len(matched)), names=names)
)";

TEST_F(PairFolder, GivesThePosesOfHlocsFiles) {
  try {
    RunProgram("/usr/bin/python3 -c 'import h5py, numpy' 2>&1");
  } catch (const std::exception&) {
    GTEST_SKIP() << "python3 with numpy and h5py is not on this machine";
  }
  const fs::path script = scene_.folder / "script.py";
  WriteFile(script, kScript);
  RunProgram("/usr/bin/python3 " + script.string() + " " + scene_.features().string() + " " +
             scene_.matches().string() + " " + scene_.pairs().string() + " " + folder_.string());
  const fs::path by_h5 = scene_.folder / "h5", by_folder = scene_.folder / "npz";
  ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene_, by_h5))));
  ASSERT_TRUE(Succeeds(Run(by_folder, {"--pairs", scene_.pairs()})));
  EXPECT_EQ(ReadFile(by_folder / "poses.txt"), ReadFile(by_h5 / "poses.txt"));
  EXPECT_EQ(Diagnostics(by_folder / "queries.jsonl"), Diagnostics(by_h5 / "queries.jsonl"));

  // Without a list of pairs all are there, but their order is by the matches.
  ASSERT_TRUE(Succeeds(Run(scene_.folder / "ranked")));
  EXPECT_TRUE(HoldsTruePoses(scene_.folder / "ranked/poses.txt", scene_.queries, 1e-3, 1e-4));

  // Another origin of pixels is another input.
  EXPECT_TRUE(
      FailsWith(3, {"first-pixel"},
                Run(by_folder, {"--pairs", scene_.pairs(), "--first-pixel", "0.5", "--resume"})));
  // And so are other files.
  fs::remove(folder_ / "query-a.png__ref-00.png.npz");
  EXPECT_TRUE(
      FailsWith(3, {"inputs/matches"}, Run(by_folder, {"--pairs", scene_.pairs(), "--resume"})));
}

TEST_F(PairFolder, OptionsThatDoNotFitAreRefused) {
  const fs::path out = scene_.folder / "out";
  fs::create_directories(folder_);
  EXPECT_TRUE(FailsWith(3, {folder_.string(), "QUERY__"}, Run(out)));
  EXPECT_TRUE(
      FailsWith(2, {"--first-pixel = 2", "between 0 and 1"}, Run(out, {"--first-pixel", "2"})));
  EXPECT_TRUE(FailsWith(2, {"--cell-px = -1"}, Run(out, {"--cell-px", "-1"})));
  EXPECT_TRUE(FailsWith(2, {"go together", "folder of pairs"},
                        Run(out, {"--features", scene_.features()})));
  EXPECT_TRUE(FailsWith(2, {"--cell-px", "folder of pairs"},
                        RunRaylift(LocalizeWithHloc(scene_, out) + Arguments{"--cell-px", "4"})));
  // All of hloc's matches have the score 1 here.
  EXPECT_TRUE(
      Succeeds(RunRaylift(LocalizeWithHloc(scene_, out) + Arguments{"--min-match-score", "0.5"})));
}

}  // namespace
}  // namespace raylift
