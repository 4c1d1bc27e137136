// The results of localize in the formats of others.

#include <cstring>

#include "apps/program.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "raylift/base/file.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

class Export : public ::testing::Test {
 protected:
  void SetUp() override { ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene_, run_)))); }
  CommandResult Run(const std::string& format, const fs::path& out, const Arguments& more = {}) {
    return RunRaylift(Arguments{"export", format, run_, "--out", out} + more);
  }

  const RoomScene scene_ = WriteRoomScene(TestFolder());
  const fs::path run_ = scene_.folder / "run";
  const fs::path out_ = scene_.folder / "exported";
};

TEST_F(Export, ColmapIsTheModelThatLocalizeWrites) {
  ASSERT_TRUE(Succeeds(Run("colmap", out_)));
  const fs::path model = scene_.folder / "model_of_localize";
  ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene_, run_) +
                                  Arguments{"--overwrite", "--write-model", model})));
  for (const char* file : {"cameras.bin", "images.bin", "points3D.bin"}) {
    EXPECT_EQ(ReadFile(out_ / file), ReadFile(model / file)) << file;
  }
  EXPECT_TRUE(FailsWith(2, {"--out", "model"}, Run("colmap", scene_.model())));
}

TEST_F(Export, NamesOfSeveralLinesAreToldInOne) {
  Replace(run_ / "queries.jsonl", R"({"name":")", R"({"name":"a\n\u001bb)");
  for (const std::string format : {"kapture", "glb"}) {
    EXPECT_TRUE(FailsWith(3, {"a??b"}, Run(format, out_)));
  }
}

TEST_F(Export, ColmapTakesItsModelAndGivesItBack) {
  if (!HasProgram("colmap")) GTEST_SKIP() << "colmap is not installed";
  const std::string colmap = "QT_QPA_PLATFORM=offscreen colmap ";
  ASSERT_TRUE(Succeeds(Run("colmap", out_)));
  const ColmapModel written = ReadColmapModel(out_);
  const std::string analysis =
      RunProgram(colmap + "model_analyzer --path " + out_.string() + " 2>&1");
  EXPECT_NE(analysis.find(fmt::format("Registered images: {}", written.images.size())),
            std::string::npos)
      << analysis;
  const auto convert = [&](const fs::path& from, const fs::path& to, const std::string& type) {
    RunProgram(fmt::format("{}model_converter --input_path {} --output_path {} --output_type {}",
                           colmap, from.string(), to.string(), type));
  };
  const fs::path text = scene_.folder / "text", back = scene_.folder / "back";
  fs::create_directories(text);
  fs::create_directories(back);
  convert(out_, text, "TXT");
  convert(text, back, "BIN");
  const auto images = written.PosedImages(), again = ReadColmapModel(back).PosedImages();
  ASSERT_EQ(again.size(), images.size());
  for (size_t i = 0; i < images.size(); ++i) {
    EXPECT_EQ(again[i].name, images[i].name);
    EXPECT_EQ(again[i].camera, images[i].camera);
    EXPECT_TRUE(IsNearPose(again[i].cam_from_world, images[i].cam_from_world, 1e-9, 1e-9));
  }
  convert(out_, scene_.folder / "points.ply", "PLY");
  convert(out_, scene_.folder / "model.nvm", "NVM");
  EXPECT_TRUE(ReadFile(scene_.folder / "points.ply").starts_with("ply"));
  EXPECT_TRUE(ReadFile(scene_.folder / "model.nvm").starts_with("NVM_V3"));
}

TEST_F(Export, ListsNameQueriesAsBenchmarksWant) {
  const fs::path list = scene_.folder / "list.txt";
  ASSERT_TRUE(Succeeds(Run("hloc", list)));
  EXPECT_EQ(Lines(ReadFile(list)).at(0).substr(0, 6), "a.png ");
  ASSERT_TRUE(Succeeds(Run("hloc", list, {"--names", "camera"})));
  EXPECT_EQ(Lines(ReadFile(list)).at(0).substr(0, 12), "query/a.png ");
  ASSERT_TRUE(Succeeds(Run("hloc", list, {"--names", "full"})));
  EXPECT_EQ(ReadFile(list), ReadFile(run_ / "poses.txt"));

  const fs::path twice = scene_.folder / "twice.txt";
  WriteFile(twice, "a/1.jpg 1 0 0 0 0 0 0\nb/1.jpg 1 0 0 0 0 0 0\n");
  EXPECT_TRUE(FailsWith(2, {"--names", "1.jpg", "twice"},
                        RunRaylift({"export", "hloc", twice, "--out", list})));
}

TEST_F(Export, TrajectoriesAreInTheOrderOfTime) {
  const fs::path times = scene_.folder / "times.txt", file = scene_.folder / "trajectory.txt";
  WriteFile(times, "query/a.png 12.5\nquery/b.png 3.25\n");
  ASSERT_TRUE(Succeeds(Run("tum", file, {"--times", times})));
  const auto lines = Lines(ReadFile(file));
  ASSERT_EQ(lines.size(), 3u);
  EXPECT_EQ(lines[1].substr(0, 5), "3.25 ");
  EXPECT_EQ(lines[2].substr(0, 5), "12.5 ");
  ASSERT_TRUE(Succeeds(Run("kitti", file, {"--times", times})));
  EXPECT_EQ(Lines(ReadFile(file)).size(), 2u);
  EXPECT_EQ(ReadFile(scene_.folder / "trajectory_images.txt"), "query/b.png\nquery/a.png\n");

  // Names that are numbers are times; a pose file is a run, too.
  const fs::path poses = scene_.folder / "poses.txt";
  WriteFile(poses, "rgb/10.5.png 1 0 0 0 -1 0 0\nrgb/9.75.png 1 0 0 0 0 0 0\n");
  ASSERT_TRUE(Succeeds(RunRaylift({"export", "tum", poses, "--out", file})));
  EXPECT_EQ(Lines(ReadFile(file)).at(2).substr(0, 11), "10.5 1 0 0 ");
}

TEST_F(Export, EveryCameraAndTheMeshAreInTheGlb) {
  const fs::path file = scene_.folder / "scene.glb";
  ASSERT_TRUE(Succeeds(Run("glb", file)));
  const std::string glb = ReadFile(file);
  uint32_t json_size = 0;
  std::memcpy(&json_size, glb.data() + 12, sizeof(json_size));
  const auto json = nlohmann::json::parse(glb.substr(20, json_size));
  std::map<std::string, size_t> children;
  for (const auto& node : json["nodes"]) {
    children[node["name"]] = node.value("children", nlohmann::json::array()).size();
  }
  EXPECT_EQ(children.at("references"), scene_.references.size());
  EXPECT_EQ(children.at("localized"), scene_.queries.size());
  EXPECT_EQ(children.count("geometry"), 1u);
  EXPECT_EQ(children.count("query/a.png"), 1u);
  // A coarser mesh makes a smaller file.
  const fs::path small = scene_.folder / "small.glb";
  ASSERT_TRUE(Succeeds(Run("glb", small, {"--max-triangles", "10"})));
  EXPECT_LT(fs::file_size(small), fs::file_size(file));
  // It is a mesh for Raylift, too.
  EXPECT_TRUE(Succeeds(RunRaylift({"localize", "--model", scene_.model(), "--geometry",
                                   "mesh:" + file.string(), "--queries", scene_.query_list(),
                                   "--features", scene_.features(), "--matches", scene_.matches(),
                                   "--pairs", scene_.pairs(), "--out", scene_.folder / "by_glb"})));
  // Its matrices are float in assimp.
  EXPECT_TRUE(HoldsTruePoses(scene_.folder / "by_glb" / "poses.txt", scene_.queries, 2e-3, 2e-4));
}

TEST_F(Export, KaptureHoldsTheQueries) {
  ASSERT_TRUE(Succeeds(Run("kapture", out_)));
  EXPECT_EQ(FilesBelow(out_),
            (std::vector<std::string>{"sensors/records_camera.txt", "sensors/sensors.txt",
                                      "sensors/trajectories.txt"}));
}

TEST_F(Export, SaysWhatIsMissing) {
  const fs::path poses = run_ / "poses.txt";
  EXPECT_TRUE(FailsWith(2, {"--queries"}, RunRaylift({"export", "kapture", poses, "--out", out_})));
  EXPECT_TRUE(FailsWith(
      2, {"--model"},
      RunRaylift({"export", "colmap", poses, "--queries", scene_.query_list(), "--out", out_})));
  EXPECT_TRUE(FailsWith(2, {"--up", "tum"}, Run("tum", out_, {"--up", "z"})));
  EXPECT_TRUE(FailsWith(2, {"FORMAT", "glb"}, Run("gltf", out_)));
  WriteFile(scene_.folder / "empty.txt", "# none\n");
  EXPECT_TRUE(FailsWith(3, {"no pose"},
                        RunRaylift({"export", "tum", scene_.folder / "empty.txt", "--out", out_})));
  Replace(run_ / "queries.jsonl", "\"verdict\"", "\"verdikt\"");
  EXPECT_TRUE(FailsWith(3, {"queries.jsonl", "line 1"}, Run("tum", out_)));
}

}  // namespace
}  // namespace raylift
