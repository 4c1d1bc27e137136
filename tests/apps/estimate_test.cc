// estimate: the pose problems that localize wrote give localize's poses.

#include <map>
#include <string>

#include "apps/program.h"
#include "support/test_data.h"
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

const std::string kCsvHeader =
    "name,method,status,qw,qx,qy,qz,tx,ty,tz,inliers_2d3d,inliers_2d2d,iterations,solver,time_ms,"
    "verdict,confidence,rotation_sigma_deg,position_sigma";

// localize with a method, then estimate on the problems it wrote.
void ExpectSamePoses(const RoomScene& scene, const Arguments& localize, const Arguments& options,
                     const std::string& label) {
  const fs::path out = scene.folder / label;
  const Arguments arguments =
      localize + options + Arguments{"--out", out, "--write-problems", out / "problems"};
  ASSERT_TRUE(Succeeds(RunRaylift(arguments))) << label;
  const fs::path csv = out / "poses.csv";
  const fs::path poses = out / "again.txt";
  ASSERT_TRUE(
      Succeeds(RunRaylift(Arguments{"estimate", out / "problems", "--csv", csv, "--poses", poses,
                                    "--scene-calibration", out / "scene_calibration.json"} +
                          options)))
      << label;
  EXPECT_EQ(ReadFile(out / "poses.txt"), ReadFile(poses)) << label;

  const auto rows = Lines(ReadFile(csv));
  ASSERT_EQ(rows.size(), 3u) << label;
  EXPECT_EQ(rows[0], kCsvHeader);
  const auto lines = PoseLines(poses);
  for (size_t i = 1; i < rows.size(); ++i) {
    const auto fields = SplitBy(rows[i], ',');
    ASSERT_EQ(fields.size(), 19u) << rows[i];
    EXPECT_EQ(fields[2], "ok");
    std::string line(fields[0]);
    for (size_t k = 3; k < 10; ++k) line += " " + std::string(fields[k]);
    EXPECT_EQ(line, lines.at(std::string(fields[0])));
  }
}

Arguments WithoutOut(Arguments arguments) {
  arguments.resize(arguments.size() - 2);
  return arguments;
}

TEST(Estimate, ProblemsThatLocalizeWroteGiveItsPosesByteForByte) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const Arguments localize = WithoutOut(LocalizeWithHloc(scene, ""));
  for (const std::string method :
       {"p3p", "e5p1", "d3p1", "adaptive", "select", "hybrid_ransac", "hloc"}) {
    ExpectSamePoses(scene, localize, {"--method", method, "--seed", "3"}, method);
  }
  for (const std::string score : {"sum_inl", "sum_inl_rat", "mult_inl", "sum_msac", "mult_msac"}) {
    for (const std::string lo : {"hybrid", "split"}) {
      ExpectSamePoses(scene, localize, {"--score", score, "--lo", lo}, score + "_" + lo);
    }
  }
}

TEST(Estimate, ProblemsFromTheFrontEndGiveItsPosesByteForByte) {
  const RoomScene scene = WriteRoomScene(TestFolder(), {.matches = false, .pictures = true});
  const Arguments localize =
      WithoutOut(LocalizeFromImages(scene, "")) + Arguments{"--cache", scene.folder / "cache"};
  for (const std::string method :
       {"p3p", "e5p1", "d3p1", "adaptive", "select", "hybrid_ransac", "hloc"}) {
    ExpectSamePoses(scene, localize, {"--method", method}, method);
  }
}

TEST(Estimate, FilteredProblemsGiveTheSamePosesToo) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path out = scene.folder / "out";
  ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene, out) +
                                  Arguments{"--filter", "fixed", "--filter-min-views", "2",
                                            "--write-problems", out / "problems"})));
  ASSERT_TRUE(Succeeds(RunRaylift({"estimate", out / "problems", "--poses", out / "again.txt"})));
  EXPECT_EQ(ReadFile(out / "poses.txt"), ReadFile(out / "again.txt"));
}

TEST(Estimate, ProblemsWithoutAPoseHaveARowWithTheReason) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  WriteFile(scene.pairs(), "query/a.png ref/00.png\nquery/a.png ref/01.png\n");
  const fs::path out = scene.folder / "out";
  ASSERT_TRUE(Succeeds(
      RunRaylift(LocalizeWithHloc(scene, out) + Arguments{"--write-problems", out / "problems"})));
  const fs::path csv = out / "poses.csv";
  const CommandResult result =
      RunRaylift({"estimate", out / "problems", "--csv", csv, "--poses", out / "again.txt"});
  EXPECT_TRUE(Succeeds(result));
  EXPECT_NE(result.out.find("no pose: query/b.png: "), std::string::npos) << result.out;
  const auto rows = Lines(ReadFile(csv));
  ASSERT_EQ(rows.size(), 3u);
  const auto fields = SplitBy(rows[2], ',');
  EXPECT_EQ(fields[0], "query/b.png");
  EXPECT_NE(fields[2], "ok");
  EXPECT_NE(fields[2], "");
  for (size_t i = 3; i < 10; ++i) EXPECT_EQ(fields[i], "");
  EXPECT_EQ(ReadFile(out / "poses.txt"), ReadFile(out / "again.txt"));
}

TEST(Estimate, PosesDoNotDependOnThreadsOrCompany) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path problems = scene.folder / "problems";
  ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene, scene.folder / "out") +
                                  Arguments{"--write-problems", problems})));
  const auto estimate = [&](const Arguments& more) {
    const fs::path poses = scene.folder / "poses.txt";
    EXPECT_TRUE(Succeeds(RunRaylift(Arguments{"estimate", "--poses", poses} + more)));
    return PoseLines(poses);
  };
  const auto one = estimate({problems, "--threads", "1"});
  EXPECT_EQ(one.size(), 2u);
  EXPECT_EQ(one, estimate({problems, "--threads", "4"}));
  EXPECT_EQ(one, estimate({problems / "query/b.png.json", problems / "query/a.png.json"}));
  EXPECT_EQ(one.at("query/b.png"), estimate({problems / "query/b.png.json"}).at("query/b.png"));
}

TEST(Estimate, SaysAsMuchOfAPoseAsLocalizeDoes) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path out = scene.folder / "out";
  ASSERT_TRUE(Succeeds(
      RunRaylift(LocalizeWithHloc(scene, out) + Arguments{"--write-problems", out / "problems"})));
  const fs::path json = scene.folder / "again.json";
  ASSERT_TRUE(Succeeds(RunRaylift({"estimate", out / "problems", "--json", json})));
  std::map<std::string, nlohmann::json> localized;
  const std::string diagnostics = ReadFile(out / "queries.jsonl");
  for (const auto& line : Lines(diagnostics)) {
    const auto query = nlohmann::json::parse(line);
    localized[query.at("name")] = query;
  }
  const auto estimates = nlohmann::json::parse(ReadFile(json));
  ASSERT_EQ(estimates.size(), 2u);
  for (const auto& estimate : estimates) {
    const auto& query = localized.at(estimate.at("name"));
    for (const std::string member :
         {"verdict", "confidence", "keypoints", "inlier_keypoints", "score_2d3d", "score_2d2d",
          "noise", "covariance", "position_sigma", "rotation_sigma_deg", "refined_value"}) {
      EXPECT_EQ(estimate.at(member), query.at(member)) << member;
    }
    EXPECT_EQ(estimate.at("verdict"), "localized");
  }
}

TEST(Estimate, APoseFileTakesANameOnce) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path problems = scene.folder / "problems";
  ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene, scene.folder / "out") +
                                  Arguments{"--write-problems", problems})));
  const fs::path poses = scene.folder / "poses.txt";
  EXPECT_TRUE(FailsWith(3, {"query/a.png", "twice"},
                        RunRaylift({"estimate", problems, problems, "--poses", poses})));
  EXPECT_FALSE(fs::exists(poses));
}

TEST(Estimate, AJobGoesOnWithTheSameCalibrationWhereverItIs) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path out = scene.folder / "out";
  ASSERT_TRUE(Succeeds(
      RunRaylift(LocalizeWithHloc(scene, out) + Arguments{"--write-problems", out / "problems"})));
  const fs::path calibration = scene.folder / "calibration.json";
  const auto estimate = [&](const fs::path& calibrated) {
    return RunRaylift({"estimate", out / "problems", "--out", scene.folder / "estimates",
                       "--resume", "--scene-calibration", calibrated});
  };
  EXPECT_TRUE(Succeeds(estimate(out / "scene_calibration.json")));
  WriteFile(calibration, ReadFile(out / "scene_calibration.json"));
  EXPECT_TRUE(Succeeds(estimate(calibration)));
  WriteFile(calibration,
            R"({"format": "raylift-scene-calibration/1", "by": "queries", "depth": [],)"
            R"("geometry_noise": null, "match_noise": null})");
  EXPECT_TRUE(
      FailsWith(3, {"other options or inputs", "scene-calibration"}, estimate(calibration)));
}

TEST(Estimate, QuietPrintsNothing) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path problems = scene.folder / "problems";
  ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene, scene.folder / "out") +
                                  Arguments{"--write-problems", problems})));
  const CommandResult loud = RunRaylift({"estimate", problems});
  EXPECT_TRUE(Succeeds(loud));
  EXPECT_EQ(loud.out, "adaptive: 2 of 2 problems have a pose\n");
  const CommandResult quiet = RunRaylift({"estimate", problems, "--quiet"});
  EXPECT_TRUE(Succeeds(quiet));
  EXPECT_EQ(quiet.out, "");
}

TEST(Estimate, OutputThatCannotBeWrittenIsNamed) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path problems = scene.folder / "problems";
  ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene, scene.folder / "out") +
                                  Arguments{"--write-problems", problems})));
  EXPECT_TRUE(
      FailsWith(5, {problems.string()}, RunRaylift({"estimate", problems, "--csv", problems})));
  const fs::path below_file = scene.mesh() / "poses.txt";
  EXPECT_TRUE(FailsWith(5, {scene.mesh().string()},
                        RunRaylift({"estimate", problems, "--poses", below_file})));
}

}  // namespace
}  // namespace raylift
