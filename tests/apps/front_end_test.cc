// localize from images alone: determinism and the cache of features.

#include <algorithm>
#include <chrono>
#include <span>

#include "apps/program.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/query_list.h"
#include "raylift/views/rendered_references.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

class FrontEnd : public ::testing::Test {
 protected:
  CommandResult Run(const std::string& out, const Arguments& more = {}) const {
    return RunRaylift(LocalizeFromImages(scene_, scene_.folder / out) +
                      Arguments{"--cache", cache_} + more);
  }
  fs::file_time_type FeaturesTime() const { return fs::last_write_time(cache_ / "features.h5"); }
  std::string Poses(const std::string& out) const {
    return ReadFile(scene_.folder / out / "poses.txt");
  }
  std::map<std::string, std::string> QueryDiagnostics(const std::string& out) const {
    return Diagnostics(scene_.folder / out / "queries.jsonl");
  }

  RoomScene scene_ = WriteRoomScene(TestFolder(), {.matches = false, .pictures = true});
  fs::path cache_ = scene_.folder / "cache";
};

TEST_F(FrontEnd, LocalizesFromImagesAlone) {
  const CommandResult result = RunRaylift(LocalizeFromImages(scene_, scene_.folder / "out"));
  EXPECT_TRUE(Succeeds(result));
  // A pixel is about 0.2 degrees and 7 mm here; SIFT is good for a fraction of it.
  EXPECT_TRUE(HoldsTruePoses(scene_.folder / "out" / "poses.txt", scene_.queries, 0.3, 0.02));
  std::vector<std::string> files = FilesBelow(scene_.folder / "out");
  // The words and the vectors, named by what they were made from.
  EXPECT_EQ(std::erase_if(files, [](const auto& f) { return f.starts_with("cache/vlad/"); }), 2u);
  EXPECT_EQ(files, (std::vector<std::string>{"cache/features.h5", "cache/features.inputs.txt",
                                             "cache/pairs.txt", "manifest.jsonl", "options.json",
                                             "poses.txt", "queries.jsonl", "scene_calibration.json",
                                             "summary.json", "timing.jsonl"}));
}

TEST_F(FrontEnd, ReferencesAreLocalizedByEachOther) {
  const fs::path out = scene_.folder / "out";
  const Arguments command = {"localize",
                             "--model",
                             scene_.model(),
                             "--images",
                             scene_.images(),
                             "--geometry",
                             "mesh:" + scene_.mesh().string(),
                             "--leave-one-out",
                             "--out",
                             out,
                             "--quiet"};
  ASSERT_TRUE(Succeeds(RunRaylift(command)));
  EXPECT_TRUE(HoldsTruePoses(out / "poses.txt", scene_.references, 0.3, 0.02));
  for (const std::string& line : Lines(ReadFile(out / "cache" / "pairs.txt"))) {
    const size_t space = line.find(' ');
    EXPECT_NE(line.substr(0, space), line.substr(space + 1));
  }
  // Whatever reads the run knows what the queries were.
  EXPECT_TRUE(Succeeds(RunRaylift({"export", "kapture", out, "--out", scene_.folder / "kapture"})));
  EXPECT_TRUE(FailsWith(2, {"--queries does not go with --leave-one-out"},
                        RunRaylift(command + Arguments{"--queries", scene_.query_list()})));
}

TEST_F(FrontEnd, WritesTheSameBytesForAnyThreadsAndOrderOfQueries) {
  ASSERT_TRUE(Succeeds(Run("one", {"--threads", "1"})));
  const std::string features = ReadFile(cache_ / "features.h5");
  fs::remove_all(cache_);
  ASSERT_TRUE(Succeeds(Run("four", {"--threads", "4"})));
  EXPECT_EQ(Poses("one"), Poses("four"));
  EXPECT_EQ(QueryDiagnostics("one"), QueryDiagnostics("four"));

  fs::remove_all(cache_);
  auto queries = ReadQueryList(scene_.query_list());
  std::reverse(queries.begin(), queries.end());
  WriteQueryList(scene_.query_list(), queries);
  ASSERT_TRUE(Succeeds(Run("turned")));
  EXPECT_EQ(PoseLines(scene_.folder / "one" / "poses.txt"),
            PoseLines(scene_.folder / "turned" / "poses.txt"));
  EXPECT_EQ(QueryDiagnostics("one"), QueryDiagnostics("turned"));
}

TEST_F(FrontEnd, ASecondRunStartsFromTheCache) {
  ASSERT_TRUE(Succeeds(Run("first")));
  const auto time = FeaturesTime();
  ASSERT_TRUE(Succeeds(Run("second", {"--top-k", "10", "--max-ratio", "0.8"})));
  EXPECT_EQ(FeaturesTime(), time);
  EXPECT_EQ(Poses("first"), Poses("second"));
  EXPECT_EQ(QueryDiagnostics("first"), QueryDiagnostics("second"));
}

TEST_F(FrontEnd, AChangedImageIsExtractedAgain) {
  ASSERT_TRUE(Succeeds(Run("first")));
  const auto time = FeaturesTime();
  const fs::path a = scene_.images() / "query/a.png";
  const fs::path b = scene_.images() / "query/b.png";
  fs::rename(a, scene_.folder / "old.png");
  fs::copy_file(b, a);
  ASSERT_TRUE(Succeeds(Run("changed")));
  EXPECT_NE(FeaturesTime(), time);
  // The two queries are the same picture now.
  const auto poses = ReadPoseFile(scene_.folder / "changed" / "poses.txt");
  ASSERT_EQ(poses.size(), 2u);
  EXPECT_LT(
      (poses[0].cam_from_world.OriginInSource() - poses[1].cam_from_world.OriginInSource()).norm(),
      0.02);
}

TEST_F(FrontEnd, AFileTouchedLaterIsExtractedAgain) {
  ASSERT_TRUE(Succeeds(Run("first")));
  const auto time = FeaturesTime();
  const fs::path a = scene_.images() / "query/a.png";
  fs::last_write_time(a, fs::last_write_time(a) + std::chrono::seconds(1));
  ASSERT_TRUE(Succeeds(Run("second")));
  EXPECT_NE(FeaturesTime(), time);
  EXPECT_EQ(Poses("first"), Poses("second"));
}

TEST_F(FrontEnd, AChangedOptionIsExtractedAgain) {
  ASSERT_TRUE(Succeeds(Run("first")));
  const auto time = FeaturesTime();
  const std::string inputs = ReadFile(cache_ / "features.inputs.txt");
  ASSERT_TRUE(Succeeds(Run("fewer", {"--max-features", "300"})));
  EXPECT_NE(FeaturesTime(), time);
  EXPECT_NE(ReadFile(cache_ / "features.inputs.txt"), inputs);
  EXPECT_NE(QueryDiagnostics("first"), QueryDiagnostics("fewer"));
}

TEST_F(FrontEnd, FeaturesWithoutTheirListOfInputsAreNotUsed) {
  ASSERT_TRUE(Succeeds(Run("first")));
  WriteFile(cache_ / "features.h5", "the rest of a run that was killed");
  fs::remove(cache_ / "features.inputs.txt");
  ASSERT_TRUE(Succeeds(Run("second")));
  EXPECT_EQ(Poses("first"), Poses("second"));
}

TEST(Panorama, IsLocalizedAmongPerspectiveReferences) {
  const fs::path demo = DemoFolder(), folder = TestFolder();
  const fs::path mesh = demo / "scene.obj";
  const double size[] = {1536, 768};
  const Rigid3 pose = ReadColmapModel(demo / "ground_truth").PosedImages()[3].cam_from_world;
  const ColmapModel truth =
      MakeSampledModel({CameraModel::kEquirectangular, 1536, 768, size}, std::span(&pose, 1), 1);
  WriteColmapModel(folder / "truth", truth, ColmapForm::kText);
  PosedImage query = truth.PosedImages().front();
  query.name = fs::path(query.name).replace_extension(".png");
  ASSERT_TRUE(Succeeds(RunRaylift(
      {"render", "--model", folder / "truth", "--geometry", "mesh:" + mesh.string(), "--products",
       "color", "--supersampling", "2", "--out", folder / "rendered", "--quiet"})));
  WriteQueryList(folder / "queries.txt", {{query.name, query.camera}});
  ASSERT_TRUE(Succeeds(RunRaylift(
      {"localize", "--model", demo / "model", "--images", demo / "images", "--every", "2",
       "--geometry", "mesh:" + mesh.string(), "--queries", folder / "queries.txt", "--query-images",
       folder / "rendered" / "color", "--out", folder / "out", "--quiet"})));
  EXPECT_TRUE(HoldsTruePoses(folder / "out" / "poses.txt", {query}, 0.1, 0.01));
}

}  // namespace
}  // namespace raylift
