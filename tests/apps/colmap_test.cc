// localize with what COLMAP makes, and for what reads its models. Debian's COLMAP runs here.

#include "apps/program.h"
#include "io/colmap/colmap_database.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

const std::string kColmap = "QT_QPA_PLATFORM=offscreen colmap ";

// Every other photograph of the demo: COLMAP's SIFT takes its time without a GPU.
constexpr size_t kEvery = 2;

std::vector<Query> SomeQueries() {
  const std::vector<Query> all = ReadQueryList(DemoFolder() / "queries.txt");
  std::vector<Query> some;
  for (size_t i = 0; i < all.size(); i += kEvery) some.push_back(all[i]);
  return some;
}

// Features of the photographs, and matches of each query with each reference.
void MakeDatabase(const fs::path& folder, const fs::path& database) {
  std::string images, pairs;
  const std::vector<Query> queries = SomeQueries();
  for (const Query& query : queries) images += query.name + "\n";
  const auto references = ReadColmapModel(DemoFolder() / "model").PosedImages();
  for (size_t i = 0; i < references.size(); i += kEvery) {
    images += references[i].name + "\n";
    for (const Query& query : queries) pairs += query.name + " " + references[i].name + "\n";
  }
  WriteFile(folder / "images.txt", images);
  WriteFile(folder / "pairs.txt", pairs);
  const std::string db = " --database_path " + database.string();
  RunProgram(kColmap + "feature_extractor" + db + " --image_path " +
             (DemoFolder() / "images").string() + " --image_list_path " +
             (folder / "images.txt").string() +
             " --SiftExtraction.use_gpu 0 --SiftExtraction.max_num_features 1500 "
             "--SiftExtraction.first_octave 0");
  RunProgram(kColmap + "matches_importer" + db + " --match_type pairs --match_list_path " +
             (folder / "pairs.txt").string() + " --SiftMatching.use_gpu 0");
}

TEST(Colmap, ItsDatabaseIsAllThatQueriesNeed) {
  if (!HasProgram("colmap")) GTEST_SKIP() << "colmap is not installed";
  const fs::path folder = TestFolder(), database = folder / "database.db";
  MakeDatabase(folder, database);
  WriteQueryList(folder / "queries.txt", SomeQueries());
  const auto localize = [&](const fs::path& out, const Arguments& more) {
    return RunRaylift(Arguments{"localize", "--model", DemoFolder() / "model", "--geometry",
                                "mesh:" + (DemoFolder() / "scene.obj").string(), "--queries",
                                folder / "queries.txt", "--matches", database, "--out", out} +
                      more);
  };
  ASSERT_TRUE(Succeeds(localize(folder / "out", {})));
  std::vector<PosedImage> truth;
  for (const PosedImage& image : ReadColmapModel(DemoFolder() / "ground_truth").PosedImages()) {
    for (const Query& query : SomeQueries()) {
      if (query.name == image.name) truth.push_back(image);
    }
  }
  ASSERT_EQ(truth.size(), 6u);
  // The demo's finest class.
  EXPECT_TRUE(HoldsTruePoses(folder / "out" / "poses.txt", truth, 0.5, 0.05));

  // With a list of pairs, what it lists alone.
  const std::string query = SomeQueries().at(0).name;
  WriteFile(folder / "few.txt",
            query + " " + ColmapDatabase(database).MatchedWith(query).at(0) + "\n");
  ASSERT_EQ(localize(folder / "few", {"--pairs", folder / "few.txt"}).exit_code, 0);
  EXPECT_EQ(Lines(ReadFile(folder / "few" / "poses.txt")).size(), 1u);
}

TEST(Colmap, DatabasesThatCannotServeAreNamed) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const auto run = [&](const Arguments& more) {
    return RunRaylift(Arguments{"localize", "--model", scene.model(), "--geometry",
                                "mesh:" + scene.mesh().string(), "--queries", scene.query_list(),
                                "--out", scene.folder / "out"} +
                      more);
  };
  WriteFile(scene.folder / "empty.db", std::string("SQLite format 3\0", 16));
  EXPECT_TRUE(FailsWith(3, {"empty.db"}, run({"--matches", scene.folder / "empty.db"})));
  EXPECT_TRUE(
      FailsWith(2, {"go together", "database"},
                run({"--matches", scene.folder / "empty.db", "--features", scene.features()})));
}

TEST(Colmap, ReadsTheModelOfReferencesAndQueries) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path out = scene.folder / "out", model = scene.folder / "localized";
  ASSERT_TRUE(
      Succeeds(RunRaylift(LocalizeWithHloc(scene, out) + Arguments{"--write-model", model})));
  const ColmapModel written = ReadColmapModel(model);
  EXPECT_EQ(written.images.size(), scene.references.size() + scene.queries.size());
  for (const PosedImage& image : written.PosedImages()) {
    for (const auto* truth : {&scene.references, &scene.queries}) {
      for (const PosedImage& expected : *truth) {
        if (expected.name != image.name) continue;
        EXPECT_TRUE(IsNearPose(image.cam_from_world, expected.cam_from_world, 1e-3, 1e-4));
        EXPECT_EQ(image.camera, expected.camera) << image.name;
      }
    }
  }
  EXPECT_TRUE(FailsWith(
      2, {"--write-model", "is the folder of --model"},
      RunRaylift(LocalizeWithHloc(scene, out) + Arguments{"--write-model", scene.model()})));
  if (!HasProgram("colmap")) GTEST_SKIP() << "colmap is not installed";
  const std::string analysis =
      RunProgram(kColmap + "model_analyzer --path " + model.string() + " 2>&1");
  EXPECT_NE(analysis.find("Registered images: " + std::to_string(written.images.size())),
            std::string::npos)
      << analysis;
  const fs::path text = scene.folder / "text";
  fs::create_directories(text);
  RunProgram(kColmap + "model_converter --input_path " + model.string() + " --output_path " +
             text.string() + " --output_type TXT");
  const auto back = ReadColmapModel(text).PosedImages();
  const auto images = written.PosedImages();
  ASSERT_EQ(back.size(), images.size());
  for (size_t i = 0; i < back.size(); ++i) {
    EXPECT_EQ(back[i].name, images[i].name);
    EXPECT_EQ(back[i].camera, images[i].camera);
    EXPECT_TRUE(IsNearPose(back[i].cam_from_world, images[i].cam_from_world, 1e-9, 1e-9));
  }
  RunProgram(kColmap + "model_converter --input_path " + model.string() + " --output_path " +
             (scene.folder / "points.ply").string() + " --output_type PLY");
  EXPECT_TRUE(fs::exists(scene.folder / "points.ply"));
}

}  // namespace
}  // namespace raylift
