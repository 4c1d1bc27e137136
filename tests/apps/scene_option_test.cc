// --scene: a scene file says what the options do not.

#include "apps/program.h"
#include "support/test_data.h"
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "raylift/base/file.h"
#include "raylift/io/query_list.h"
#include "raylift/io/scene_file.h"

namespace raylift {
namespace {

using Json = nlohmann::json;

std::filesystem::path WriteScene(const RoomScene& room) {
  SceneFile scene;
  scene.name = "room";
  scene.references = room.model();
  scene.queries = room.query_list();
  scene.ground_truth = room.truth();
  scene.thresholds = "cambridge";
  scene.groups = room.folder / "groups.txt";
  WriteGroups(scene.groups, {{room.queries[0].name, "day"}, {room.queries[1].name, "night"}});
  scene.geometries = {{"near", "mesh:" + room.mesh().string() + ",far=50"},
                      {"all", "mesh:" + room.mesh().string()}};
  std::filesystem::path file = room.folder / "scene.toml";
  WriteSceneFile(file, scene);
  return file;
}

Arguments Localize(const RoomScene& room, const std::filesystem::path& scene) {
  return {"localize",     "--scene", scene,        "--features", room.features(),    "--matches",
          room.matches(), "--pairs", room.pairs(), "--out",      room.folder / "out"};
}

Json EffectiveOptions(const RoomScene& room) {
  return Json::parse(ReadFile(room.folder / "out" / "options.json"));
}

TEST(SceneOption, LocalizesAndEvaluates) {
  const RoomScene room = WriteRoomScene(TestFolder());
  const auto scene = WriteScene(room);
  ASSERT_TRUE(Succeeds(RunRaylift(Localize(room, scene))));
  const Json options = EffectiveOptions(room);
  EXPECT_EQ(options["model"], room.model().string());
  EXPECT_EQ(options["queries"], room.query_list().string());
  EXPECT_EQ(options["geometry"], Json::array({"mesh:" + room.mesh().string() + ",far=50"}));
  EXPECT_EQ(options["images"], nullptr);

  const auto poses = room.folder / "out" / "poses.txt";
  EXPECT_TRUE(HoldsTruePoses(poses, room.queries, 1e-3, 1e-4));
  const auto csv = room.folder / "table.csv";
  const CommandResult table =
      RunRaylift({"evaluate", "--scene", scene, "--poses", poses, "--csv", csv});
  ASSERT_TRUE(Succeeds(table));
  const auto lines = Lines(ReadFile(csv));
  ASSERT_EQ(lines.size(), 4u);
  EXPECT_TRUE(lines[1].starts_with("out,false,2,2,0,100")) << lines[1];
  EXPECT_TRUE(lines[2].starts_with("out[day],false,1,1,0,100")) << lines[2];
  EXPECT_TRUE(lines[3].starts_with("out[night],false,1,1,0,100")) << lines[3];
}

TEST(SceneOption, OptionsWinAndGeometriesHaveNames) {
  const RoomScene room = WriteRoomScene(TestFolder());
  const auto scene = WriteScene(room);
  const auto other = room.folder / "other.txt";
  WriteQueryList(other, {ReadQueryList(room.query_list())[0]});
  const auto config = room.folder / "run.toml";
  WriteFile(config, "geometry = 'all'\nscene = '" + scene.string() + "'\n");
  Arguments arguments = Localize(room, scene) + Arguments{"--queries", other, "--config", config};
  arguments.erase(arguments.begin() + 1, arguments.begin() + 3);  // the scene of the config file
  ASSERT_TRUE(Succeeds(RunRaylift(arguments)));
  const Json options = EffectiveOptions(room);
  EXPECT_EQ(options["queries"], other.string());
  EXPECT_EQ(options["geometry"], Json::array({"mesh:" + room.mesh().string()}));
  EXPECT_EQ(Lines(ReadFile(room.folder / "out" / "poses.txt")).size(), 1u);
}

TEST(SceneOption, OtherCommandsTakeWhatTheyCanUse) {
  const RoomScene room = WriteRoomScene(TestFolder());
  const auto scene = WriteScene(room);
  EXPECT_TRUE(
      Succeeds(RunRaylift({"render", "--scene", scene, "--geometry", "all", "--every", "3",
                           "--every-offset", "2", "--out", room.folder / "rendered", "--quiet"})));
  EXPECT_TRUE(std::filesystem::exists(room.folder / "rendered/depth/ref/05.npy"));
  EXPECT_FALSE(std::filesystem::exists(room.folder / "rendered/depth/ref/00.npy"));
  EXPECT_TRUE(Succeeds(RunRaylift({"compare", "--scene", scene, "--truth", "all", "--max-side",
                                   "32", "--out", room.folder / "comparison"})));
}

TEST(SceneOption, WrongScenesAreNamed) {
  const RoomScene room = WriteRoomScene(TestFolder());
  const auto scene = room.folder / "scene.toml";
  WriteFile(scene, "format = 'raylift-scene/1'\nmodel = 'a'\n");
  EXPECT_TRUE(FailsWith(3, {"scene.toml: line 2", "\"model\" is no key"},
                        RunRaylift(Localize(room, scene))));
  WriteFile(scene, "format = 'raylift-scene/1'\n");
  EXPECT_TRUE(FailsWith(2, {"--queries"}, RunRaylift(Localize(room, scene))));
  const CommandResult truth =
      RunRaylift({"evaluate", "--scene", scene, "--poses", room.query_list()});
  EXPECT_TRUE(FailsWith(2, {"--ground-truth is required"}, truth));
  EXPECT_TRUE(FailsWith(2, {"--every-offset = 2: must be below --every, 2"},
                        RunRaylift(LocalizeWithHloc(room, room.folder / "out") +
                                   Arguments{"--every", "2", "--every-offset", "2"})));
}

}  // namespace
}  // namespace raylift
