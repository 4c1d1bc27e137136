// localize without --model: references rendered from the mesh.

#include "apps/program.h"
#include "support/test_data.h"
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "raylift/base/file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

class MeshOnly : public ::testing::Test {
 protected:
  Arguments Command(const std::string& out) const {
    return {"localize",       "--geometry",    mesh(),  "--queries",        scene_.query_list(),
            "--query-images", scene_.images(), "--out", scene_.folder / out};
  }
  Arguments Localize(const std::string& out, const Arguments& more = {}) const {
    return Command(out) + Arguments{"--view-up=-y", "--view-kind", "cover", "--views", "20"} + more;
  }
  std::string mesh() const { return "mesh:" + scene_.mesh().string(); }

  RoomScene scene_ = WriteRoomScene(TestFolder(), {.matches = false, .pictures = true});
};

// Succeeds, and warns of one thing alone: rendered references do not tell how noisy matches are.
::testing::AssertionResult SucceedsUncalibrated(CommandResult result) {
  if (result.err.find("`raylift calibrate` learns it") == std::string::npos) {
    return ::testing::AssertionFailure() << "stderr: " << result.err;
  }
  result.err.erase(0, result.err.find('\n') + 1);
  return Succeeds(result);
}

TEST_F(MeshOnly, LocalizesFromAMeshAndQueriesAlone) {
  const CommandResult result = RunRaylift(Localize("out"));
  EXPECT_TRUE(SucceedsUncalibrated(result));
  // A pixel is about 0.2 degrees and 7 mm here.
  EXPECT_TRUE(HoldsTruePoses(scene_.folder / "out" / "poses.txt", scene_.queries, 0.3, 0.02));
  EXPECT_NE(result.out.find("20 views of the mesh (cover), 20 rendered now"), std::string::npos)
      << result.out;
}

TEST_F(MeshOnly, AModelIsSaidToComeFromColmapWhereThereIsNoMesh) {
  Arguments without = Command("out");
  without.erase(without.begin() + 1, without.begin() + 3);
  EXPECT_TRUE(
      FailsWith(2, {"--model is required", "colmap automatic_reconstructor"}, RunRaylift(without)));
  const std::string file = scene_.mesh().string();
  EXPECT_TRUE(FailsWith(2, {"--mesh", "did you mean --geometry mesh:PATH?"},
                        RunRaylift(without + Arguments{"--mesh", file})));
  const Arguments with = without + Arguments{"--geometry", file};
  EXPECT_TRUE(SucceedsUncalibrated(
      RunRaylift(with + Arguments{"--view-up=-y", "--view-kind", "cover", "--views", "20"})));
}

TEST_F(MeshOnly, ASecondRunUsesTheSamePicturesAndAnyThreads) {
  ASSERT_TRUE(
      SucceedsUncalibrated(RunRaylift(Localize("out", {"--rerender", "1", "--threads", "1"}))));
  const std::string poses = ReadFile(scene_.folder / "out" / "poses.txt");
  const fs::path features = scene_.folder / "out" / "cache" / "features.h5";
  const auto time = fs::last_write_time(features);
  const CommandResult again =
      RunRaylift(Localize("out", {"--rerender", "1", "--threads", "4", "--overwrite"}));
  ASSERT_TRUE(SucceedsUncalibrated(again));
  EXPECT_NE(again.out.find(", 0 rendered now"), std::string::npos) << again.out;
  EXPECT_EQ(fs::last_write_time(features), time);
  EXPECT_EQ(ReadFile(scene_.folder / "out" / "poses.txt"), poses);
}

TEST_F(MeshOnly, RerenderWorksWithAModelAndIsCounted) {
  const fs::path out = scene_.folder / "out";
  ASSERT_TRUE(Succeeds(RunRaylift(LocalizeFromImages(scene_, out) + Arguments{"--rerender", "2"})));
  EXPECT_TRUE(HoldsTruePoses(out / "poses.txt", scene_.queries, 0.1, 0.005));
  size_t kept = 0;
  for (const std::string& line : Lines(ReadFile(out / "queries.jsonl"))) {
    const auto query = nlohmann::json::parse(line);
    kept += query.at("rerender_rounds_kept").get<size_t>();
  }
  const auto times = nlohmann::json::parse(Lines(ReadFile(out / "timing.jsonl")).front());
  EXPECT_GT(times.at("milliseconds").at("rerender"), 0);
  EXPECT_EQ(nlohmann::json::parse(ReadFile(out / "summary.json")).at("rerender").at("rounds_kept"),
            kept);
  EXPECT_GT(kept, 0u);
}

TEST_F(MeshOnly, WrongOptionsAreNamed) {
  const auto fails = [&](const Arguments& more, const std::vector<std::string>& parts) {
    return FailsWith(2, parts, RunRaylift(Command("bad") + more));
  };
  EXPECT_TRUE(fails({"--geometry", "depth:maps"}, {"--geometry", "--model", "one mesh:PATH"}));
  EXPECT_TRUE(fails({"--images", "photos"}, {"--images needs --model"}));
  EXPECT_TRUE(fails({"--features", "f.h5", "--matches", "m.h5", "--pairs", "p.txt"},
                    {"--features needs --model"}));
  EXPECT_TRUE(fails({"--views", "0"}, {"--views"}));
  EXPECT_TRUE(fails({"--view-kind", "above"}, {"--view-kind", "auto|inside|around|cover"}));
  EXPECT_TRUE(fails({"--view-size", "640"}, {"--view-size", "WIDTHxHEIGHT"}));
  EXPECT_TRUE(fails({"--view-fov-deg", "180"}, {"--view-fov-deg"}));
  EXPECT_TRUE(fails({"--view-up", "w"}, {"--view-up"}));
  EXPECT_TRUE(fails({"--rerender=-1"}, {"--rerender", "negative"}));
  const Arguments bare = {"localize", "--queries", scene_.query_list(), "--out", scene_.folder};
  EXPECT_TRUE(FailsWith(2, {"--model", "mesh:PATH"}, RunRaylift(bare)));
  EXPECT_TRUE(FailsWith(2, {"--geometry", "depth:maps"},
                        RunRaylift(bare + Arguments{"--geometry", "depth:maps"})));
  EXPECT_TRUE(FailsWith(2, {"--query-images"}, RunRaylift(bare + Arguments{"--geometry", mesh()})));
  const Arguments with_model = bare + Arguments{"--model", scene_.model(), "--rerender", "1"};
  EXPECT_TRUE(FailsWith(
      2, {"--rerender", "mesh:PATH"},
      RunRaylift(with_model + Arguments{"--images", scene_.images(), "--geometry", "sfm"})));
  EXPECT_TRUE(FailsWith(2, {"--rerender", "--query-images"},
                        RunRaylift(with_model + Arguments{"--geometry", mesh(), "--features", "f",
                                                          "--matches", "m", "--pairs", "p"})));
  EXPECT_FALSE(fs::exists(scene_.folder / "bad"));
}

}  // namespace
}  // namespace raylift
