// evaluate: the table in its three forms, against either form of ground truth.

#include "apps/program.h"
#include "support/test_data.h"
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> Fields(const std::string& line, const std::string& separators) {
  std::vector<std::string> fields;
  for (const auto field :
       separators == " " ? SplitTokens(line) : SplitBy(line, separators.front())) {
    fields.emplace_back(field);
  }
  return fields;
}

TEST(Evaluate, RecallsAreFullOnTheCleanSceneInAllThreeForms) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  Arguments evaluate = {"evaluate", "--ground-truth", scene.truth(), "--poses"};
  const std::vector<std::string> methods = {"p3p", "e5p1", "adaptive", "select"};
  for (const std::string& method : methods) {
    const fs::path out = scene.folder / method;
    ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene, out) + Arguments{"--method", method})));
    evaluate.push_back(out / "poses.txt");
  }
  const fs::path json_file = scene.folder / "new" / "table.json";
  const fs::path csv_file = scene.folder / "new" / "table.csv";
  const CommandResult result =
      RunRaylift(evaluate + Arguments{"--thresholds", "0.0001,0.001:0.25,2", "--json", json_file,
                                      "--csv", csv_file});
  EXPECT_TRUE(Succeeds(result));

  const auto text = Lines(result.out);
  const auto csv = Lines(ReadFile(csv_file));
  const auto json = nlohmann::json::parse(ReadFile(json_file));
  ASSERT_EQ(text.size(), 5u) << result.out;
  ASSERT_EQ(csv.size(), 5u);
  ASSERT_EQ(json["results"].size(), 4u);
  for (size_t i = 0; i < methods.size(); ++i) {
    const auto row = json["results"][i];
    EXPECT_EQ(row["name"], methods[i]);  // from the folder, as all files are called poses.txt
    EXPECT_EQ(row["recalls_percent"], nlohmann::json::array({100.0, 100.0})) << methods[i];
    EXPECT_EQ(row["localized"], 2);
    // name, uses_ground_truth, queries, localized, unknown, two recalls, two medians
    auto fields = Fields(csv[i + 1], ",");
    ASSERT_EQ(fields.size(), 9u);
    EXPECT_EQ(ParseDouble(fields[7]), row["median_position"].get<double>());
    EXPECT_EQ(ParseDouble(fields[8]), row["median_rotation_deg"].get<double>());
    fields.erase(fields.begin() + 1);
    EXPECT_EQ(Fields(text[i + 1], " "), fields);
  }
}

TEST(Evaluate, APoseFileIsAsGoodAGroundTruthAsAModel) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path poses = scene.folder / "out" / "poses.txt";
  ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene, scene.folder / "out"))));
  std::vector<NamedPose> truth;
  for (const PosedImage& query : scene.queries) {
    truth.push_back({query.name, query.cam_from_world});
  }
  WritePoseFile(scene.folder / "truth.txt", truth);
  const CommandResult by_file =
      RunRaylift({"evaluate", "--ground-truth", scene.folder / "truth.txt", "--poses", poses});
  const CommandResult by_model =
      RunRaylift({"evaluate", "--ground-truth", scene.truth(), "--poses", poses});
  EXPECT_TRUE(Succeeds(by_file));
  EXPECT_TRUE(Succeeds(by_model));
  EXPECT_EQ(by_file.out, by_model.out);
}

TEST(Evaluate, TellsHowWellTheCovariancesFit) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path out = scene.folder / "out";
  ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene, out))));
  const fs::path json_file = scene.folder / "table.json";
  const Arguments evaluate = {"evaluate",        "--ground-truth", scene.truth(), "--poses",
                              out / "poses.txt", "--calibration",  "--json",      json_file};
  const CommandResult result = RunRaylift(evaluate);
  ASSERT_TRUE(Succeeds(result));
  EXPECT_NE(result.out.find("covariances"), std::string::npos);
  const auto row = nlohmann::json::parse(ReadFile(json_file))["results"][0];
  EXPECT_EQ(row["calibration"]["poses"], 2);
  EXPECT_EQ(row["calibration"]["below_3_sigma_percent"], 100);

  const std::string queries = ReadFile(out / "queries.jsonl");
  WriteFile(out / "queries.jsonl", Lines(queries)[0] + "\n{\"covariance\"\n");
  const CommandResult broken = RunRaylift(evaluate);
  EXPECT_EQ(broken.exit_code, 3);
  EXPECT_NE(broken.err.find("queries.jsonl: line 2"), std::string::npos) << broken.err;
  fs::remove(out / "queries.jsonl");
  EXPECT_EQ(RunRaylift(evaluate).exit_code, 3);
}

TEST(Evaluate, MissingQueriesCountAndUnknownOnesAreWarnedAbout) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path poses = scene.folder / "some.txt";
  WritePoseFile(poses, {{scene.queries[0].name, scene.queries[0].cam_from_world},
                        {"other.png", scene.queries[1].cam_from_world}});
  const fs::path json_file = scene.folder / "table.json";
  const CommandResult result = RunRaylift({"evaluate", "--ground-truth", scene.truth(), "--poses",
                                           poses, "--names", "mine", "--json", json_file});
  EXPECT_EQ(result.exit_code, 0);
  ASSERT_EQ(Lines(result.err).size(), 1u) << result.err;
  EXPECT_NE(result.err.find("other.png"), std::string::npos);
  const auto row = nlohmann::json::parse(ReadFile(json_file))["results"][0];
  EXPECT_EQ(row["name"], "mine");
  EXPECT_EQ(row["queries"], 2);
  EXPECT_EQ(row["localized"], 1);
  EXPECT_EQ(row["recalls_percent"], nlohmann::json::array({50.0, 50.0, 50.0}));
  EXPECT_TRUE(row["median_position"].is_null());
  EXPECT_EQ(row["missing_names"], nlohmann::json::array({scene.queries[1].name}));
}

TEST(Evaluate, TellsHowFarTheSceneMovesInTheImages) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path good = scene.folder / "good.txt", one = scene.folder / "one.txt";
  WritePoseFile(good, {{scene.queries[0].name, scene.queries[0].cam_from_world},
                       {scene.queries[1].name, scene.queries[1].cam_from_world}});
  Rigid3 moved = scene.queries[0].cam_from_world;
  moved.translation.x() += 0.05;
  WritePoseFile(one, {{scene.queries[0].name, moved}});
  const fs::path csv = scene.folder / "dcre.csv";
  const CommandResult result =
      RunRaylift({"evaluate", "--ground-truth", scene.truth(), "--poses", good, one, "--geometry",
                  "mesh:" + scene.mesh().string(), "--dcre-csv", csv});
  ASSERT_TRUE(Succeeds(result));
  EXPECT_NE(result.out.find("DCRE"), std::string::npos);
  const auto lines = Lines(ReadFile(csv));
  ASSERT_EQ(lines.size(), 5u);
  const auto exact = Fields(lines[1], ","), wrong = Fields(lines[3], ","),
             lost = Fields(lines[4], ",");
  EXPECT_NEAR(*ParseDouble(exact[4]), 0, 1e-6);
  EXPECT_GT(*ParseDouble(wrong[4]), 0.1);
  EXPECT_LT(*ParseDouble(wrong[4]), 10);
  EXPECT_EQ(lost[4], "");
}

TEST(Evaluate, StepsAreTakenInTheOrderOfTheNumbersInNames) {
  const fs::path folder = TestFolder();
  std::vector<NamedPose> truth, drifting;
  for (int i = 1; i <= 11; ++i) {
    const std::string name = "img_" + std::to_string(i) + ".jpg";
    truth.push_back({name, {Eigen::Quaterniond::Identity(), {1.0 * i, 0, 0}}});
    drifting.push_back({name, {Eigen::Quaterniond::Identity(), {1.5 * i, 0, 0}}});
  }
  WritePoseFile(folder / "truth.txt", truth);
  WritePoseFile(folder / "drifting.txt", drifting);
  const fs::path json = folder / "trajectory.json";
  ASSERT_TRUE(Succeeds(RunRaylift({"evaluate", "--ground-truth", folder / "truth.txt", "--poses",
                                   folder / "drifting.txt", "--trajectory-json", json})));
  const auto errors = nlohmann::json::parse(ReadFile(json)).at(0).at("rpe_position");
  EXPECT_EQ(errors.at("min"), 0.5);
  EXPECT_EQ(errors.at("max"), 0.5);
}

TEST(Evaluate, ChecksSubmissions) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path poses = scene.folder / "poses.txt";
  WritePoseFile(poses, {{scene.queries[0].name, scene.queries[0].cam_from_world}});
  const Arguments check = {"evaluate",  "--poses",          poses,     "--check-submission",
                           "--queries", scene.query_list(), "--model", scene.model()};
  const CommandResult right = RunRaylift(check);
  EXPECT_TRUE(Succeeds(right));
  EXPECT_NE(right.out.find("1 of 2 queries have no pose"), std::string::npos);
  WritePoseFile(poses, {{"unknown.jpg", scene.queries[0].cam_from_world}});
  const CommandResult wrong = RunRaylift(check);
  EXPECT_EQ(wrong.exit_code, 3);
  EXPECT_NE(wrong.err.find("poses.txt: not fit to be handed in (1 problems)"), std::string::npos);
  EXPECT_NE(wrong.out.find("line 1: unknown.jpg is no query"), std::string::npos);
  EXPECT_TRUE(
      FailsWith(2, {"--ground-truth is required"}, RunRaylift({"evaluate", "--poses", poses})));
}

TEST(Evaluate, QuietPrintsNoTable) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path poses = scene.folder / "some.txt";
  WritePoseFile(poses, {{scene.queries[0].name, scene.queries[0].cam_from_world}});
  const CommandResult result =
      RunRaylift({"evaluate", "--ground-truth", scene.truth(), "--poses", poses, "--quiet"});
  EXPECT_TRUE(Succeeds(result));
  EXPECT_EQ(result.out, "");
}

}  // namespace
}  // namespace raylift
