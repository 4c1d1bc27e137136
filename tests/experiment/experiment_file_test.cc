#include <filesystem>

#include "experiment/test_experiments.h"
#include <gmock/gmock.h>

#include "raylift/base/error.h"
#include "raylift/experiment/experiment.h"

namespace raylift {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

const std::string kGrid = "[[grid]]\nscene = \"room\"\n";

std::string ErrorOf(const std::string& text) {
  try {
    ReadText(text);
  } catch (const InputError& error) {
    return error.what();
  }
  return "no error";
}

TEST(ExperimentFile, ReadsScenesInTheirOrderWithPathsRelativeToItself) {
  const Experiment experiment = ReadText(kTwoScenes + kGrid);
  ASSERT_EQ(experiment.scenes.size(), 2u);
  const ExperimentScene& room = experiment.scenes[0];
  const auto folder = experiment.file.parent_path();
  EXPECT_EQ(room.name, "room");
  EXPECT_EQ(room.title, "The room");
  EXPECT_EQ(room.model, folder / "room/model");
  EXPECT_EQ(room.query_images, folder / "room/images");
  EXPECT_EQ(room.thresholds, (std::vector<Threshold>{{0.1, 1}, {0.5, 5}}));
  ASSERT_EQ(room.geometry.size(), 2u);
  EXPECT_EQ(room.geometry[0].specs.at(0),
            "mesh:" + (folder / "room/room.ply").string() + ",back_faces=drop");
  EXPECT_FALSE(room.geometry[0].perturbation);
  EXPECT_EQ(room.geometry[1].title, "noisy depth");
  EXPECT_EQ(room.geometry[1].perturbation->scale_sigma, 0.1);
  EXPECT_EQ(experiment.scenes[1].thresholds, ParseThresholds("7scenes"));
}

TEST(ExperimentFile, TakesFromASceneFileWhatItDoesNotSay) {
  const auto folder = TestFolder();
  WriteFile(folder / "data" / "scene.toml", R"(
format = "raylift-scene/1"
references = "sfm"
images = "photos"
queries = "queries.txt"
groups = "groups.txt"
priors = "priors.txt"
thresholds = "aachen"
[[geometry]]
name = "mesh"
spec = "mesh:a.ply"
[[geometry]]
name = "sfm"
spec = "sfm"
)");
  const std::string text = R"(
[scenes.night]
scene = "data/scene.toml"
group = "night"
[scenes.night.geometry]
mesh = "mesh:b.ply"
[[grid]]
)";
  const ExperimentScene scene = ReadText(text, folder).scenes.front();
  EXPECT_EQ(scene.model, folder / "data/sfm");
  EXPECT_EQ(scene.query_images, folder / "data/photos");
  EXPECT_EQ(scene.groups, folder / "data/groups.txt");
  EXPECT_EQ(scene.priors, folder / "data/priors.txt");
  EXPECT_EQ(scene.group, "night");
  EXPECT_EQ(scene.thresholds, ParseThresholds("aachen"));
  ASSERT_EQ(scene.geometry.size(), 2u);
  EXPECT_EQ(scene.FindGeometry("mesh")->specs.at(0), "mesh:" + (folder / "b.ply").string());
  EXPECT_EQ(scene.FindGeometry("sfm")->specs.at(0), "sfm");
}

TEST(ExperimentFile, VariablesStandForTexts) {
  const std::string scene = R"(
[scenes.a]
model = "${KNOWN}/model"
images = "i"
queries = "${OTHER}/q.txt"
thresholds = "1,1"
)";
  EXPECT_THAT(ErrorOf(scene + "[[grid]]\n"), HasSubstr("scenes.a.queries: ${OTHER} is not set"));
}

TEST(ExperimentFile, ErrorsNameTheKey) {
  const std::string good = kTwoScenes + kGrid;
  EXPECT_EQ(ErrorOf(good), "no error");
  EXPECT_THAT(ErrorOf("title = "), HasSubstr("experiment.toml: line 1"));
  EXPECT_THAT(ErrorOf("[[grid]]\n"), HasSubstr("scenes: is missing"));
  EXPECT_THAT(ErrorOf(kTwoScenes), HasSubstr("grid: is missing"));
  EXPECT_THAT(ErrorOf("titel = \"a\"\n" + good), HasSubstr("line 1: titel: is no key"));
  EXPECT_THAT(ErrorOf("seeds = [-1]\n" + good), HasSubstr("seeds: expected whole numbers"));
  EXPECT_THAT(ErrorOf(good + "methods = \"p3p\"\n"), HasSubstr("grid 1.methods: is no key"));
  EXPECT_THAT(ErrorOf(good + "method = \"p4p\"\n"),
              HasSubstr("grid 1.method: expected p3p|e5p1|d3p1|adaptive"));
  EXPECT_THAT(ErrorOf(good + "every = 0\n"), HasSubstr("grid 1.every: expected numbers of at"));
  EXPECT_THAT(ErrorOf(good + "geometry = \"sfm\"\n"), HasSubstr("found \"sfm\""));
  EXPECT_THAT(ErrorOf(good + "filter = \"2 px\"\n"), HasSubstr("names of [filters]"));
  EXPECT_THAT(ErrorOf(good + "[[table]]\nname = \"a b\"\nrows = \"method\"\n"),
              HasSubstr("table 1.name: expected letters"));
  EXPECT_THAT(ErrorOf(good + "[[table]]\nname = \"a\"\nrows = \"color\"\n"),
              HasSubstr("table 1.rows: expected scene|every|"));
  EXPECT_THAT(ErrorOf(good + "[[claim]]\ntext = \"a\"\nfirst = {method = \"p3p\"}\n"),
              HasSubstr("claim 1.second: is missing"));
  EXPECT_THAT(ErrorOf(good + "[estimator]\nconfidence = 2\n"),
              HasSubstr("estimator.confidence: must lie between 0 and 1, found 2"));
  EXPECT_THAT(ErrorOf(good + "[filters.off]\nmin_views = 2\n"), HasSubstr("filters.off"));
  EXPECT_THAT(ErrorOf("[scenes.a]\nmodel = 3\n"), HasSubstr("scenes.a.model: expected a string"));
}

// The files that come along are read, and their grids, tables and claims fit together.
TEST(ExperimentFile, ReadyExperimentsAreGood) {
  size_t count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(RAYLIFT_EXPERIMENTS_FOLDER)) {
    if (entry.path().extension() != ".toml") continue;
    SCOPED_TRACE(entry.path().filename().string());
    const Experiment experiment = ReadExperiment(
        entry.path(), [](const std::string&) { return std::optional<std::string>("/nowhere"); });
    EXPECT_FALSE(ExpandGrid(experiment).empty());
    EXPECT_FALSE(experiment.tables.empty());
    ++count;
  }
  EXPECT_GE(count, 3u);
}

TEST(ExperimentFile, AGeometryMayBeSeveralSourcesAndWhatIsMadeOfTheirPoints) {
  const auto folder = TestFolder();
  const Experiment experiment = ReadText(kTwoScenes + R"(
[scenes.attic]
model = "attic/model"
images = "attic/images"
queries = "attic/queries.txt"
thresholds = "0.1,1"
[scenes.attic.geometry]
both = { spec = ["sfm", "mesh:a.ply"], mode = "all", candidates = "merge" }
none = { candidates = "triangulate", candidates_error_px = 2 }
[[grid]]
method = "p3p"
)",
                                         folder);
  const ExperimentScene& attic = experiment.scenes.at(2);
  const ExperimentGeometry& both = *attic.FindGeometry("both");
  EXPECT_THAT(both.specs, ElementsAre("sfm", "mesh:" + (folder / "a.ply").string()));
  EXPECT_EQ(both.mode, GeometryMode::kAll);
  EXPECT_EQ(both.candidates.mode, CandidateMode::kMerge);
  const ExperimentGeometry& none = *attic.FindGeometry("none");
  EXPECT_TRUE(none.specs.empty());
  EXPECT_EQ(none.candidates.max_error_px, 2);
  for (const std::string bad : {"{ mode = \"all\" }", "{ spec = \"sfm\", mode = \"some\" }",
                                "{ spec = [\"sfm\", \"mesh:a.ply\"], scale = 1.1 }"}) {
    const std::string text =
        kTwoScenes + "[scenes.hall.geometry]\nx = " + bad + "\n[[grid]]\nmethod = \"p3p\"\n";
    EXPECT_THAT(ErrorOf(text), HasSubstr("scenes.hall.geometry.x")) << bad;
  }
}

}  // namespace
}  // namespace raylift
