// What holds for every data set: what comes out is what was put into its layout.

#include "raylift/datasets/dataset.h"

#include <algorithm>

#include "datasets/test_input.h"
#include "support/test_data.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "raylift/base/error.h"
#include "raylift/io/colmap_model.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

struct Case {
  std::string name;
  Layout (*write)(const fs::path& folder, const LayoutInput& input);
};
void PrintTo(const Case& c, std::ostream* stream) { *stream << c.name; }

class EveryDataset : public ::testing::TestWithParam<Case> {};

INSTANTIATE_TEST_SUITE_P(
    , EveryDataset,
    ::testing::Values(Case{"7scenes", &Write7Scenes}, Case{"12scenes", &Write12Scenes},
                      Case{"cambridge", &WriteCambridge}, Case{"aachen", &WriteAachen},
                      Case{"cmu", &WriteCmu}, Case{"gangnam", &WriteGangnam},
                      Case{"nerfstudio", &WriteNerfstudio}, Case{"tum", &WriteTum},
                      Case{"scannet", &WriteScanNet}, Case{"scannetpp", &WriteScanNetPp},
                      Case{"eth3d", &WriteEth3d}, Case{"lamar", &WriteLamar}),
    [](const auto& test) { return "of_" + test.param.name; });

void ExpectEqual(const Camera& actual, const Camera& expected) {
  ASSERT_EQ(actual.model(), expected.model());
  EXPECT_EQ(actual.width_px(), expected.width_px());
  EXPECT_EQ(actual.height_px(), expected.height_px());
  for (size_t i = 0; i < expected.params().size(); ++i) {
    EXPECT_NEAR(actual.params()[i], expected.params()[i], 1e-9) << i;
  }
}

// The tolerance is that of text with all digits and a few products.
void ExpectImages(std::vector<PosedImage> actual, std::vector<PosedImage> expected) {
  const auto by_name = [](const PosedImage& a, const PosedImage& b) { return a.name < b.name; };
  std::sort(actual.begin(), actual.end(), by_name);
  std::sort(expected.begin(), expected.end(), by_name);
  ASSERT_EQ(actual.size(), expected.size());
  for (size_t i = 0; i < expected.size(); ++i) {
    EXPECT_EQ(actual[i].name, expected[i].name);
    EXPECT_TRUE(IsNearPose(actual[i].cam_from_world, expected[i].cam_from_world, 1e-9, 1e-9))
        << actual[i].name;
    ExpectEqual(actual[i].camera, expected[i].camera);
  }
}

TEST_P(EveryDataset, KeepsEveryPoseCameraAndName) {
  const fs::path folder = TestFolder();
  const Layout layout = GetParam().write(folder / "data", RandomInput());
  ImportOptions options;
  options.query_every = layout.query_every;
  const auto scenes = ImportDataset(GetParam().name, layout.folder, options);
  ASSERT_EQ(scenes.size(), GetParam().name == "scannetpp" ? 2u : 1u);
  EXPECT_THAT(scenes[0].warnings, testing::IsEmpty());
  const fs::path file = WriteImportedScene(folder / "out", scenes[0], GetParam().name);

  const SceneFile scene = ReadSceneFile(file);
  ExpectImages(ReadColmapModel(scene.references).PosedImages(), layout.references);
  const std::vector<Query> queries = ReadQueryList(scene.queries);
  ASSERT_EQ(queries.size(), layout.queries.size());
  for (size_t i = 0; i < queries.size(); ++i) {
    EXPECT_EQ(queries[i].name, layout.queries[i].name);
    ExpectEqual(queries[i].camera, layout.queries[i].camera);
  }
  if (GetParam().name == "aachen") {
    EXPECT_EQ(scene.ground_truth, "");
  } else {
    ExpectImages(ReadColmapModel(scene.ground_truth).PosedImages(), layout.queries);
  }
  EXPECT_TRUE(fs::equivalent(scene.images, layout.images));
  EXPECT_TRUE(fs::equivalent(scene.query_images, layout.query_images));
  EXPECT_EQ(scene.provenance[0], std::pair(std::string("dataset"), GetParam().name));
}

TEST_P(EveryDataset, OtherFoldersAreRefused) {
  const fs::path folder = TestFolder(), empty = folder / "empty", none = folder / "none";
  fs::create_directories(empty);
  EXPECT_TRUE(FailsWithInputError([&] { ImportDataset(GetParam().name, empty); }, {"empty"}));
  EXPECT_TRUE(FailsWithInputError([&] { ImportDataset(GetParam().name, none); }, {"none"}));
}

TEST_P(EveryDataset, OneCameraCanStandForAll) {
  const Layout layout = GetParam().write(TestFolder() / "data", RandomInput());
  ImportOptions options;
  options.query_every = layout.query_every;
  options.camera = Camera(CameraModel::kSimplePinhole, 64, 48, std::vector<double>{60, 32, 24});
  const ImportedScene scene = ImportDataset(GetParam().name, layout.folder, options).at(0);
  for (const Query& query : scene.queries) EXPECT_EQ(query.camera, *options.camera);
  for (const PosedImage& image : scene.references) EXPECT_EQ(image.camera, *options.camera);
}

TEST(Dataset, TheTableHoldsThemAll) {
  EXPECT_EQ(DatasetNames(),
            "7scenes|12scenes|cambridge|aachen|cmu|gangnam|nerfstudio|tum|scannet|scannetpp|"
            "eth3d|lamar");
  EXPECT_THROW(ImportDataset("inloc", TestFolder()), OptionError);
}

TEST(Dataset, SequencesNeedReferencesAndQueries) {
  const Layout layout = WriteScanNet(TestFolder(), RandomInput());
  ImportOptions options;
  options.query_every = 20;
  EXPECT_TRUE(FailsWithInputError([&] { ImportDataset("scannet", layout.folder, options); },
                                  {"7 frames", "query_every = "}));
  options.query_every = 3;
  const ImportedScene scene = ImportDataset("scannet", layout.folder, options).at(0);
  ASSERT_EQ(scene.queries.size(), 2u);
  EXPECT_EQ(scene.queries[0].name, "color/2.jpg");
  EXPECT_EQ(scene.queries[1].name, "color/5.jpg");
  EXPECT_EQ(scene.references.size(), 5u);
}

}  // namespace
}  // namespace raylift
