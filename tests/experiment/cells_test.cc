#include <filesystem>
#include <fstream>

#include "experiment/test_experiments.h"
#include <gmock/gmock.h>

#include "raylift/base/error.h"
#include "raylift/experiment/experiment.h"
#include "raylift/experiment/run_cells.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

// Files in the places of kTwoScenes' room.
void WriteRoomFiles(const fs::path& folder) {
  for (const char* file :
       {"room/model/images.txt", "room/images/a.jpg", "room/truth/images.txt", "room/room.ply"}) {
    WriteFile(folder / file, "some bytes");
  }
  WriteFile(folder / "room/queries.txt",
            "a.jpg PINHOLE 640 480 500 500 320 240\nb.jpg PINHOLE 640 480 500 500 320 240\n");
}

struct Planned {
  Experiment experiment;
  std::vector<Cell> cells;
};

Planned Plan(const std::string& top = "seeds = [0, 7]\n") {
  Planned planned;
  planned.experiment = ReadText(top + kTwoScenes + R"(
[[grid]]
scene = "room"
every = [1, 5]
method = ["p3p", "e5p1"]
)");
  WriteRoomFiles(planned.experiment.file.parent_path());
  const std::vector<Setting> settings = ExpandGrid(planned.experiment);
  planned.cells = ListCells(planned.experiment, settings);
  return planned;
}

std::set<std::string> Keys(const std::vector<Cell>& cells) {
  std::set<std::string> keys;
  for (const Cell& cell : cells) keys.insert(cell.Key());
  return keys;
}

TEST(Cells, EachSettingAndSeedIsOneOfItsOwn) {
  const Planned planned = Plan();
  EXPECT_EQ(planned.cells.size(),
            2u * 2u * 3u);  // seeds, subsamplings, P3P by two geometries and E5+1
  EXPECT_EQ(Keys(planned.cells).size(), planned.cells.size());
  EXPECT_EQ(planned.cells[0].end, 2u);  // queries
}

TEST(Cells, KeysFollowTheInputsContentsAlone) {
  const Planned before = Plan();
  EXPECT_EQ(Keys(before.cells), Keys(Plan().cells));
  const fs::path folder = before.experiment.file.parent_path();
  WriteFile(folder / "room/room.ply", "other data");
  const auto settings = ExpandGrid(before.experiment);
  const std::vector<Cell> after = ListCells(before.experiment, settings);
  for (size_t i = 0; i < after.size(); ++i) {
    // E5+1 knows no mesh.
    const bool same = after[i].setting.Is(Method::kE5p1);
    EXPECT_EQ(after[i].Key() == before.cells[i].Key(), same) << after[i].setting.Name();
  }
}

TEST(Cells, KeysFollowTheOptions) {
  const auto before = Keys(Plan().cells);
  for (const std::string& key : Keys(Plan("[estimator]\nmax_iterations = 500\n").cells)) {
    EXPECT_FALSE(before.contains(key));
  }
}

TEST(Cells, AllOffsetsAreCellsOfTheirOwn) {
  const Planned planned = Plan("offsets = \"all\"\n");
  EXPECT_EQ(planned.cells.size(), (1u + 5u) * 3u);  // 1/1 and 1/5, P3P by two geometries and E5+1
  EXPECT_EQ(Keys(planned.cells).size(), planned.cells.size());
}

TEST(Cells, MissingInputsAreFound) {
  const Planned planned = Plan();
  const auto settings = ExpandGrid(planned.experiment);
  EXPECT_TRUE(MissingInputs(planned.experiment, settings).empty());
  const fs::path mesh = planned.experiment.file.parent_path() / "room/room.ply";
  fs::remove(mesh);
  EXPECT_THAT(MissingInputs(planned.experiment, settings), ::testing::ElementsAre(mesh));
  EXPECT_THROW(ListCells(planned.experiment, settings), InputError);
}

TEST(Cells, AGroupIsAPartOfTheQueries) {
  ExperimentScene scene;
  scene.queries = TestFolder() / "queries.txt";
  scene.groups = TestFolder() / "groups.txt";
  WriteFile(scene.queries,
            "a.jpg PINHOLE 640 480 500 500 320 240\nb.jpg PINHOLE 640 480 500 500 320 240\n");
  WriteFile(scene.groups, "a.jpg day\nb.jpg night\n");
  EXPECT_EQ(QueriesOf(scene).size(), 2u);
  scene.group = "night";
  ASSERT_EQ(QueriesOf(scene).size(), 1u);
  EXPECT_EQ(QueriesOf(scene).front().name, "b.jpg");
  scene.group = "dusk";
  EXPECT_THROW(QueriesOf(scene), InputError);
}

QueryOutcome SomeOutcome(const std::string& name) {
  QueryOutcome outcome;
  outcome.name = name;
  outcome.cam_from_world = Rigid3{Eigen::Quaterniond(0.5, 0.5, -0.5, 0.5), {0.1, 1e-17, -3}};
  outcome.inliers_2d2d = 12;
  outcome.matches_2d2d = 20;
  outcome.solver = Solver::kE5p1;
  return outcome;
}

TEST(CellStore, ReadsBackWhatItWrote) {
  const CellStore store(TestFolder() / "cells");
  Cell cell{RoomSetting(1, "mesh", Method::kP3p), 3, 0, 0, 2, R"({"every":"1"})"};
  QueryOutcome failed;
  failed.name = "b";
  failed.reason = "too few matches";
  const std::vector<QueryOutcome> outcomes = {SomeOutcome("a"), failed};
  EXPECT_FALSE(store.Has(cell));
  store.Write(cell, outcomes);
  ASSERT_TRUE(store.Has(cell));
  EXPECT_EQ(*store.Read(cell), outcomes);
  EXPECT_EQ(store.Read(cell)->front().cam_from_world->translation.y(), 1e-17);
  cell.inputs = R"({"every":"2"})";
  EXPECT_FALSE(store.Has(cell));
}

TEST(CellStore, ADamagedFileCountsAsNotThere) {
  const fs::path folder = TestFolder() / "cells";
  const CellStore store(folder);
  const Cell cell{RoomSetting(1, "mesh", Method::kP3p), 3, 0, 0, 1, "{}"};
  store.Write(cell, std::vector{SomeOutcome("a")});
  const fs::path file = folder / (cell.Key() + ".json");
  const std::string good = ReadFile(file);
  for (const std::string& bad : {std::string(), good.substr(0, good.size() / 2), std::string("[]"),
                                 std::string(R"({"inputs":{},"outcomes":[]})")}) {
    WriteFile(file, bad);
    EXPECT_FALSE(store.Has(cell)) << bad;
  }
}

}  // namespace
}  // namespace raylift
