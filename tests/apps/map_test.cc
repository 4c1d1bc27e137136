// raylift map: a scene in one file, in which localize finds the same poses.

#include <csignal>

#include "apps/program.h"
#include "base/rng.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>
#include <unistd.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

class Map : public ::testing::Test {
 protected:
  // Of depth maps of the room, a float each.
  void SetUp() override {
    ASSERT_TRUE(Succeeds(RunRaylift({"perturb", "--model", scene_.model(), "--geometry",
                                     "mesh:" + scene_.mesh().string(), "--out", maps_})));
  }

  Arguments Pack(const char* action = "pack", const Arguments& more = {}) const {
    return Arguments{"map",           action,         map_,
                     "--model",       scene_.model(), "--images",
                     scene_.images(), "--quiet",      "--geometry",
                     Depth(),         "--cache",      scene_.folder / "cache"} +
           more;
  }
  std::string Depth() const { return "depth:" + maps_.string(); }
  Arguments Localize(const std::string& out, const Arguments& scene) const {
    return Arguments{"localize", "--queries",         scene_.query_list(),
                     "--quiet",  "--query-images",    scene_.images(),
                     "--out",    scene_.folder / out, "--no-doctor"} +
           scene;
  }
  bool IsRight(const std::string& out) const {
    return HoldsTruePoses(scene_.folder / out / "poses.txt", scene_.queries, 0.3, 0.02);
  }

  RoomScene scene_ = WriteRoomScene(TestFolder(), {.matches = false, .pictures = true});
  fs::path maps_ = scene_.folder / "maps";
  fs::path map_ = scene_.folder / "room.raymap";
};

TEST_F(Map, LocalizeFindsTheSamePosesInIt) {
  for (const char* descriptors : {"exact", "bytes", "compact"}) {
    ASSERT_TRUE(Succeeds(RunRaylift(Pack("pack", {"--descriptors", descriptors}))));
    ASSERT_TRUE(Succeeds(RunRaylift(Localize(descriptors, {"--scene", map_}))));
    EXPECT_TRUE(IsRight(descriptors)) << descriptors;
  }
}

TEST_F(Map, WhatIsKnownOfTheSceneIsKept) {
  const fs::path from_files = scene_.folder / "files";
  ASSERT_TRUE(Succeeds(RunRaylift(Localize(
      "files", {"--model", scene_.model(), "--geometry", Depth(), "--images", scene_.images()}))));
  ASSERT_TRUE(Succeeds(
      RunRaylift(Pack("pack", {"--scene-calibration", from_files / "scene_calibration.json"}))));
  ASSERT_TRUE(Succeeds(RunRaylift(Localize("map", {"--scene", map_}))));
  EXPECT_TRUE(IsRight("map"));
  EXPECT_EQ(ReadFile(scene_.folder / "map/scene_calibration.json"),
            ReadFile(from_files / "scene_calibration.json"));
  // A part of which more is known does not pass for the whole.
  const fs::path half = scene_.folder / "half.raymap";
  ASSERT_TRUE(
      Succeeds(RunRaylift({"map", "pack", half, "--model", scene_.model(), "--images",
                           scene_.images(), "--geometry", Depth(), "--every", "2", "--quiet"})));
  const CommandResult added = RunRaylift({"map", "add", half, "--scene", map_, "--quiet"});
  EXPECT_EQ(added.exit_code, 0);
  EXPECT_NE(added.err.find("--scene-calibration"), std::string::npos) << added.err;
  EXPECT_EQ(Lines(RunRaylift({"map", "list", half}).out).size(), scene_.references.size());
  EXPECT_NE(ReadFile(map_).find("calibration.json"), std::string::npos);
  EXPECT_EQ(ReadFile(half).find("calibration.json"), std::string::npos);
  EXPECT_TRUE(
      FailsWith(2, {"--align-depth", "packed map"},
                RunRaylift(Localize("align", {"--scene", map_, "--align-depth", "scale"}))));
}

TEST_F(Map, WhatDoesNotFitIsRefused) {
  ASSERT_TRUE(Succeeds(RunRaylift(Pack("pack", {"--every", "2"}))));
  const std::string half = ReadFile(map_);
  EXPECT_TRUE(FailsWith(
      3, {"room.raymap", "first_sample_px=0"},
      RunRaylift({"map", "add", map_, "--model", scene_.model(), "--images", scene_.images(),
                  "--geometry", Depth() + ",first_sample_px=0", "--quiet"})));
  EXPECT_EQ(ReadFile(map_), half);
  // A part of a map has its features and needs no photographs.
  const fs::path part = scene_.folder / "part.raymap";
  ASSERT_TRUE(
      Succeeds(RunRaylift({"map", "pack", part, "--scene", map_, "--every", "2", "--quiet"})));
  EXPECT_EQ(Lines(RunRaylift({"map", "list", part}).out).size(), 2u);
  // Features of other programs are not those of queries here.
  ASSERT_TRUE(Succeeds(
      RunRaylift({"map", "pack", part, "--model", scene_.model(), "--geometry", Depth(), "--every",
                  "2", "--quiet", "--features", scene_.folder / "cache/features.h5"})));
  EXPECT_TRUE(FailsWith(3, {"part.raymap", "features.h5", "RootSIFT"},
                        RunRaylift(Localize("other", {"--scene", part}))));
  EXPECT_TRUE(FailsWith(3, {"part.raymap", "features.h5", "rootsift"},
                        RunRaylift({"map", "add", part, "--model", scene_.model(), "--images",
                                    scene_.images(), "--geometry", Depth(), "--quiet"})));
}

TEST_F(Map, GrowsAndShrinksToTheSameBytes) {
  ASSERT_TRUE(Succeeds(RunRaylift(Pack())));
  const std::string whole = ReadFile(map_);
  ASSERT_TRUE(Succeeds(RunRaylift(Pack("pack", {"--every", "2"}))));
  const std::string half = ReadFile(map_);
  ASSERT_TRUE(Succeeds(RunRaylift(Pack("add"))));
  EXPECT_EQ(ReadFile(map_), whole);
  const CommandResult list = RunRaylift({"map", "list", map_});
  ASSERT_TRUE(Succeeds(list));
  const std::vector<std::string> names = Lines(list.out);
  ASSERT_EQ(names.size(), scene_.references.size());
  ASSERT_TRUE(Succeeds(RunRaylift({"map", "remove", map_, names[1], names[3], names[5]})));
  EXPECT_EQ(ReadFile(map_), half);
}

TEST_F(Map, KilledFiftyTimesItIsTheFormerOrTheNewOne) {
  ASSERT_TRUE(Succeeds(RunRaylift(Pack())));
  const std::string whole = ReadFile(map_);
  ASSERT_TRUE(Succeeds(RunRaylift(Pack("pack", {"--every", "2"}))));
  const std::string half = ReadFile(map_);
  Rng rng = TestRng();
  int former = 0, kills = 0;
  for (int i = 0; i < 50; ++i) {
    WriteFile(map_, half);
    const pid_t process = StartRaylift(Pack("add"));
    usleep(rng.UniformIndex(10'000 * static_cast<uint64_t>(1 + i)));
    kill(process, SIGKILL);
    kills += WaitFor(process) == 128 + SIGKILL ? 1 : 0;
    const std::string found = ReadFile(map_);
    former += found == half ? 1 : 0;
    ASSERT_TRUE(found == half || found == whole) << i;
  }
  EXPECT_GT(kills, 10);
  EXPECT_GT(former, 10);
}

TEST_F(Map, OptionsThatDoNotGoTogether) {
  EXPECT_TRUE(FailsWith(2, {"NAMES"}, RunRaylift({"map", "remove", map_})));
  EXPECT_TRUE(
      FailsWith(2, {"map list takes no NAMES"}, RunRaylift({"map", "list", map_, "a.jpg"})));
  EXPECT_TRUE(FailsWith(2, {"--model is required"}, RunRaylift({"map", "pack", map_})));
  EXPECT_TRUE(FailsWith(
      2, {"--images or --features"},
      RunRaylift({"map", "pack", map_, "--model", scene_.model(), "--geometry", Depth()})));
  EXPECT_TRUE(FailsWith(2, {"no depth"},
                        RunRaylift({"map", "pack", map_, "--model", scene_.model(), "--geometry",
                                    "sfm", "--images", scene_.images()})));
  EXPECT_TRUE(FailsWith(3, {"room.raymap"}, RunRaylift({"map", "list", map_})));
  EXPECT_TRUE(FailsWith(3, {"packed map"}, RunRaylift({"map", "list", scene_.query_list()})));
}

}  // namespace
}  // namespace raylift
