// --config: any option can stand in a TOML file.

#include "apps/program.h"
#include "support/test_data.h"
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "raylift/base/file.h"

namespace raylift {
namespace {

using Json = nlohmann::json;

std::string Quoted(const std::filesystem::path& path) { return "'" + path.string() + "'"; }

std::string LocalizeKeys(const RoomScene& scene) {
  return "model = " + Quoted(scene.model()) + "\nqueries = " + Quoted(scene.query_list()) +
         "\nfeatures = " + Quoted(scene.features()) + "\nmatches = " + Quoted(scene.matches()) +
         "\npairs = " + Quoted(scene.pairs()) + "\nout = " + Quoted(scene.folder / "out") +
         "\ngeometry = ['mesh:" + scene.mesh().string() + "']\n";
}

Json OptionsOfRun(const RoomScene& scene) {
  return Json::parse(ReadFile(scene.folder / "out" / "options.json"));
}

TEST(ConfigFile, HoldsAnyOptionOfLocalize) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const auto config = scene.folder / "run.toml";
  WriteFile(config, LocalizeKeys(scene) +
                        "# a comment\n"
                        "top-k = 4  # another\n"
                        "alpha = 0.75\n"
                        "quiet = true\n"
                        "method = \"select\"\n");
  const CommandResult result = RunRaylift({"localize", "--config", config});
  EXPECT_TRUE(Succeeds(result));
  EXPECT_EQ(result.out, "");
  const Json options = OptionsOfRun(scene);
  EXPECT_EQ(options["top-k"], 4);
  EXPECT_EQ(options["alpha"], 0.75);
  EXPECT_EQ(options["quiet"], true);
  EXPECT_EQ(options["method"], "select");
  EXPECT_EQ(options["geometry"], Json::array({"mesh:" + scene.mesh().string()}));
  EXPECT_TRUE(HoldsTruePoses(scene.folder / "out" / "poses.txt", scene.queries, 1e-3, 1e-4));
}

TEST(ConfigFile, TheCommandLineWins) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const auto config = scene.folder / "run.toml";
  WriteFile(config, LocalizeKeys(scene) + "top-k = 4\nquiet = true\n");
  const auto out = scene.folder / "elsewhere";
  const CommandResult result = RunRaylift(
      {"localize", "--config=" + config.string(), "--top-k=2", "--out", out, "--quiet=false"});
  EXPECT_TRUE(Succeeds(result));
  EXPECT_NE(result.out, "");
  EXPECT_FALSE(std::filesystem::exists(scene.folder / "out"));
  const Json options = Json::parse(ReadFile(out / "options.json"));
  EXPECT_EQ(options["top-k"], 2);
  EXPECT_EQ(options["quiet"], false);
}

TEST(ConfigFile, ATableOfTheCommandsNameIsForThatCommandAlone) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const auto config = scene.folder / "run.toml";
  WriteFile(config, "quiet = false\n[localize]\n" + LocalizeKeys(scene) +
                        "quiet = true\nwrite-problems = " + Quoted(scene.folder / "problems") +
                        "\n[estimate]\nproblems = [" + Quoted(scene.folder / "problems") +
                        "]\ncsv = " + Quoted(scene.folder / "poses.csv") +
                        "\nposes = " + Quoted(scene.folder / "poses.txt") +
                        "\n[evaluate]\nground-truth = " + Quoted(scene.truth()) + "\nposes = [" +
                        Quoted(scene.folder / "poses.txt") + ", " +
                        Quoted(scene.folder / "out/poses.txt") + "]\nnames = [\"a\", \"b\"]\n");
  const CommandResult localized = RunRaylift({"localize", "--config", config});
  EXPECT_TRUE(Succeeds(localized));
  EXPECT_EQ(localized.out, "");
  EXPECT_TRUE(Succeeds(RunRaylift({"estimate", "--config", config})));
  EXPECT_EQ(Lines(ReadFile(scene.folder / "poses.csv")).size(), 3u);
  const CommandResult table = RunRaylift({"evaluate", "--config", config});
  EXPECT_TRUE(Succeeds(table));
  EXPECT_EQ(Lines(table.out).size(), 3u) << table.out;
  EXPECT_TRUE(Lines(table.out)[2].starts_with("b ")) << table.out;
}

TEST(ConfigFile, UnknownKeysAreNamedWithTheirLine) {
  const auto config = TestFolder() / "run.toml";
  const auto fails = [&](const std::string& text, const std::vector<std::string>& parts) {
    WriteFile(config, text);
    return FailsWith(3, std::vector<std::string>{config.string()} + parts,
                     RunRaylift({"estimate", "x", "--config", config}));
  };
  EXPECT_TRUE(fails("alpha = 0.8\ntopk = 3\n", {"line 2", "\"topk\"", "estimate"}));
  EXPECT_TRUE(fails("top-k = 3\n", {"line 1", "\"top-k\""}));
  EXPECT_TRUE(fails("[estimate]\nmodel = 'm'\n", {"line 2", "\"model\""}));
  EXPECT_TRUE(fails("[estimates]\nalpha = 1\n", {"\"estimates\""}));
  EXPECT_TRUE(fails("config = 'other.toml'\n", {"\"config\""}));
  EXPECT_TRUE(fails("help = true\n", {"\"help\""}));
}

TEST(ConfigFile, MalformedFilesAndValuesAreNamed) {
  const auto config = TestFolder() / "run.toml";
  const auto fails = [&](const std::string& text, const std::vector<std::string>& parts) {
    WriteFile(config, text);
    return FailsWith(3, std::vector<std::string>{config.string()} + parts,
                     RunRaylift({"estimate", "x", "--config", config}));
  };
  EXPECT_TRUE(fails("alpha = 0.8\nmethod = p3p\n", {"line 2"}));
  EXPECT_TRUE(fails("alpha 0.8\n", {"line 1"}));
  EXPECT_TRUE(fails("alpha = 1\nalpha = 2\n", {"line 2"}));
  EXPECT_TRUE(fails("alpha = {a = 1}\n", {"line 1", "alpha"}));
  EXPECT_TRUE(fails("alpha = 1979-05-27\n", {"line 1", "alpha"}));
  EXPECT_TRUE(fails("alpha = 'x'\n", {"--alpha", "x"}));
  EXPECT_TRUE(fails("alpha = [1, 2]\n", {"--alpha"}));
  EXPECT_TRUE(fails("threads = 1.5\n", {"--threads"}));
  EXPECT_TRUE(fails("quiet = 'perhaps'\n", {"--quiet"}));
  EXPECT_TRUE(fails(std::string("alpha = \0", 9), {}));
}

TEST(ConfigFile, ValuesOutOfRangeAreBadOptions) {
  const auto config = TestFolder() / "run.toml";
  WriteFile(config, "method = 'foo'\n");
  EXPECT_TRUE(FailsWith(2, {"--method", "foo"}, RunRaylift({"estimate", "x", "--config", config})));
}

TEST(ConfigFile, AMissingFileExitsWith3) {
  for (const std::string command : {"localize", "estimate", "evaluate"}) {
    EXPECT_TRUE(FailsWith(3, {"/nowhere/run.toml"},
                          RunRaylift({command, "--config", "/nowhere/run.toml"})));
  }
}

TEST(ConfigFile, EffectiveOptionsKeepTheirTypes) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const auto out = scene.folder / "out";
  ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene, out) + Arguments{"--alpha", "1e-1"})));
  const Json options = OptionsOfRun(scene);
  EXPECT_EQ(options["command"], "localize");
  EXPECT_TRUE(options["raylift_version"].is_string());
  EXPECT_TRUE(options["top-k"].is_number_integer());
  EXPECT_TRUE(options["seed"].is_number_unsigned());
  EXPECT_EQ(options["alpha"], 0.1);
  EXPECT_EQ(options["confidence"], 0.9999);
  EXPECT_EQ(options["reprojection-threshold-px"], 8.0);
  EXPECT_EQ(options["quiet"], false);
  EXPECT_TRUE(options["images"].is_null());
  EXPECT_EQ(options["method"], "adaptive");
  EXPECT_EQ(options["model"], scene.model().string());
  EXPECT_TRUE(options["geometry"].is_array());
  EXPECT_FALSE(options.contains("help"));
  EXPECT_FALSE(options.contains("config"));
}

}  // namespace
}  // namespace raylift
