// localize with hloc's files: the same results however it runs, and complete output.

#include <algorithm>
#include <map>

#include "apps/program.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <sys/stat.h>
#include <unistd.h>

#include "raylift/base/file.h"
#include "raylift/io/pose_problem_json.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

TEST(Localize, FindsTheTruePosesByEveryMethod) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  for (const std::string method :
       {"p3p", "e5p1", "d3p1", "adaptive", "select", "hybrid_ransac", "hloc"}) {
    const fs::path out = scene.folder / method;
    ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene, out) + Arguments{"--method", method})));
    EXPECT_TRUE(HoldsTruePoses(out / "poses.txt", scene.queries, 1e-3, 1e-4)) << method;
  }
}

TEST(Localize, WhatIsKnownOfAQueryIsPartOfItsProblem) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path priors = scene.folder / "priors.txt";
  const fs::path problems = scene.folder / "problems";
  const Eigen::Vector3d center = scene.queries[0].cam_from_world.OriginInSource();
  WriteFile(priors, fmt::format("{0} position {1} {2} {3} 0.5\n{0} gravity 0 1 0 2\n",
                                scene.queries[0].name, center.x(), center.y(), center.z()));
  const Arguments with_priors =
      LocalizeWithHloc(scene, scene.folder / "out") +
      Arguments{"--priors", priors, "--write-problems", problems, "--overwrite"};
  ASSERT_TRUE(Succeeds(RunRaylift(with_priors)));
  EXPECT_TRUE(HoldsTruePoses(scene.folder / "out" / "poses.txt", scene.queries, 1e-3, 1e-4));
  std::map<std::string, PosePriors> written;
  for (const fs::path& file : ListPoseProblems(problems)) {
    const PoseProblem problem = ReadPoseProblem(file).problem;
    written[problem.name] = problem.priors;
  }
  const PosePriors& known = written.at(scene.queries[0].name);
  EXPECT_LT((known.position.value().position - center).norm(), 1e-12);
  EXPECT_EQ(known.gravity.value().down_in_world, Eigen::Vector3d(0, 0, -1));
  EXPECT_TRUE(written.at(scene.queries[1].name).empty());

  WriteFile(priors, "another.jpg position 0 0 0 1\n");
  EXPECT_TRUE(
      FailsWith(3, {priors.string(), "knows none of the 2 queries"}, RunRaylift(with_priors)));
}

// A city model says what its coordinates are, here less an origin; a place in other ones is led there.
TEST(Localize, TheGeometrysFilesMaySayWhatTheCoordinatesAre) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path city = scene.folder / "a.city.json", priors = scene.folder / "priors.txt",
                 problems = scene.folder / "problems", out = scene.folder / "out";
  WriteFile(city, R"({"type":"CityJSON","version":"2.0","transform":{"scale":[1,1,1],)"
                  R"("translate":[500000,5900000,0]},"metadata":{"referenceSystem":)"
                  R"("https://www.opengis.net/def/crs/EPSG/0/25832"},"CityObjects":{"a":{"type":)"
                  R"("Building","geometry":[{"type":"MultiSurface","lod":"2.2","boundaries":)"
                  R"([[[0,1,2]]]}]}},"vertices":[[0,0,1],[9,0,1],[9,9,1]]})");
  // The central meridian of zone 32 has the easting 500000.
  WriteFile(priors, scene.queries[0].name + " position 9 53.2 12 1 crs=EPSG:4258\n");
  const Arguments command =
      LocalizeWithHloc(scene, out) +
      Arguments{"--geometry", "mesh:" + city.string() + ",shift=-500000/-5900000/0"} +
      Arguments{"--priors", priors, "--no-doctor"} +
      Arguments{"--write-problems", problems, "--overwrite"};
  ASSERT_TRUE(Succeeds(RunRaylift(command)));
  EXPECT_NE(ReadFile(out / "options.json").find("\"crs\": \"EPSG:25832@500000,5900000,0\""),
            std::string::npos);
  const auto easting = [&] {
    for (const fs::path& file : ListPoseProblems(problems)) {
      const PoseProblem problem = ReadPoseProblem(file).problem;
      if (problem.name == scene.queries[0].name)
        return problem.priors.position.value().position.x();
    }
    return 1e9;
  };
  EXPECT_NEAR(easting(), 0, 1e-3);
  const CommandResult elsewhere =
      RunRaylift(command + Arguments{"--crs", "EPSG:25833@500000,5900000,0"});
  EXPECT_EQ(elsewhere.exit_code, 0);
  EXPECT_NE(elsewhere.err.find("the world's coordinates are EPSG:25833@500000,5900000,0, but those "
                               "of mesh:"),
            std::string::npos)
      << elsewhere.err;
  // What the priors say goes before what a file says.
  WriteFile(priors, "* world_crs EPSG:32632@500000,5900000,0\n" + ReadFile(priors));
  ASSERT_TRUE(Succeeds(RunRaylift(command)));
  EXPECT_NEAR(easting(), 0, 1e-3);
  EXPECT_TRUE(FailsWith(2, {"--priors", "exif", "needs --crs"},
                        RunRaylift(LocalizeWithHloc(scene, out) + Arguments{"--priors", "exif"})));
}

TEST(Localize, AlignmentByEdgesNeedsAPoseOfEachQuery) {
  const RoomScene scene = WriteRoomScene(TestFolder(), {.pictures = true});
  const fs::path priors = scene.folder / "priors.txt";
  WriteFile(priors, fmt::format("{} pose 1 0 0 0 0 0 0 1 5\n", scene.queries[0].name));
  const Arguments alone = {
      "localize",       "--align",      "edges", "--queries",           scene.query_list(),
      "--query-images", scene.images(), "--out", scene.folder / "edges"};
  const Arguments with_mesh = alone + Arguments{"--geometry", "mesh:" + scene.mesh().string()};
  EXPECT_TRUE(FailsWith(2, {"--align edges needs one --geometry mesh:PATH"}, RunRaylift(alone)));
  EXPECT_TRUE(FailsWith(2, {"--align edges needs --priors"}, RunRaylift(with_mesh)));
  EXPECT_TRUE(FailsWith(3, {priors.string(), "expected a pose", scene.queries[1].name},
                        RunRaylift(with_mesh + Arguments{"--priors", priors})));
}

TEST(Localize, APhotographThatIsListedByItsNameAloneHasAnUnknownFocalLength) {
  const RoomScene scene = WriteRoomScene(TestFolder(), {.pictures = true});
  const fs::path out = scene.folder / "out";
  std::string names;
  for (const PosedImage& query : scene.queries) names += query.name + '\n';
  WriteFile(scene.query_list(), names);
  EXPECT_TRUE(FailsWith(3, {"queries.txt", "line 1"}, RunRaylift(LocalizeWithHloc(scene, out))));
  const CommandResult run =
      RunRaylift(LocalizeWithHloc(scene, out) + Arguments{"--query-images", scene.images()});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NE(run.err.find("the cameras of 2 of 2 photographs are not known"), std::string::npos);
  EXPECT_TRUE(HoldsTruePoses(out / "poses.txt", scene.queries, 0.5, 0.05));
  EXPECT_NE(ReadFile(out / "queries.jsonl").find("refined_camera"), std::string::npos);
}

TEST(Localize, AFolderOfPhotographsStandsForItsList) {
  const RoomScene scene = WriteRoomScene(TestFolder(), {.pictures = true});
  const fs::path out = scene.folder / "out";
  Arguments localize = LocalizeWithHloc(scene, out);
  for (std::string& argument : localize) {
    if (argument == scene.query_list()) argument = scene.images() / "query";
  }
  const CommandResult run = RunRaylift(localize + Arguments{"--query-images", scene.images()});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_TRUE(HoldsTruePoses(out / "poses.txt", scene.queries, 0.5, 0.05));
}

TEST(Localize, E5p1NeedsNoGeometry) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path out = scene.folder / "out";
  EXPECT_TRUE(
      Succeeds(RunRaylift({"localize", "--method", "e5p1", "--model", scene.model(), "--queries",
                           scene.query_list(), "--features", scene.features(), "--matches",
                           scene.matches(), "--pairs", scene.pairs(), "--out", out})));
  EXPECT_TRUE(HoldsTruePoses(out / "poses.txt", scene.queries, 1e-3, 1e-4));
}

TEST(Localize, WritesTheSameBytesForAnyThreadsAndOrderOfQueries) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path one = scene.folder / "one";
  const fs::path four = scene.folder / "four";
  const fs::path turned = scene.folder / "turned";
  ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene, one) + Arguments{"--threads", "1"})));
  ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene, four) + Arguments{"--threads", "4"})));
  EXPECT_EQ(ReadFile(one / "poses.txt"), ReadFile(four / "poses.txt"));
  EXPECT_EQ(Diagnostics(one / "queries.jsonl"), Diagnostics(four / "queries.jsonl"));

  auto queries = ReadQueryList(scene.query_list());
  std::reverse(queries.begin(), queries.end());
  WriteQueryList(scene.query_list(), queries);
  ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene, turned) + Arguments{"--threads", "4"})));
  EXPECT_EQ(PoseLines(one / "poses.txt"), PoseLines(turned / "poses.txt"));
  EXPECT_EQ(Diagnostics(one / "queries.jsonl"), Diagnostics(turned / "queries.jsonl"));
  EXPECT_TRUE(ReadFile(turned / "poses.txt").starts_with(queries.front().name + " "));
}

TEST(Localize, OneQueryAloneGetsTheSamePose) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene, scene.folder / "both"))));
  const auto queries = ReadQueryList(scene.query_list());
  WriteQueryList(scene.query_list(), {queries[1]});
  ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene, scene.folder / "alone"))));
  EXPECT_EQ(PoseLines(scene.folder / "both" / "poses.txt").at(queries[1].name),
            PoseLines(scene.folder / "alone" / "poses.txt").at(queries[1].name));
}

TEST(Localize, LeavesExactlyTheFilesItPromises) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path out = scene.folder / "new" / "deep" / "out";
  ASSERT_TRUE(Succeeds(
      RunRaylift(LocalizeWithHloc(scene, out) + Arguments{"--write-problems", out / "problems"})));
  EXPECT_EQ(FilesBelow(out),
            (std::vector<std::string>{"manifest.jsonl", "options.json", "poses.txt",
                                      "problems/query/a.png.json", "problems/query/b.png.json",
                                      "queries.jsonl", "scene_calibration.json", "summary.json",
                                      "timing.jsonl"}));
}

TEST(Localize, SummaryCountsQueries) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path out = scene.folder / "out";
  ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene, out) + Arguments{"--every", "2"})));
  const auto summary = nlohmann::json::parse(ReadFile(out / "summary.json"));
  EXPECT_EQ(summary["queries"], 2);
  EXPECT_EQ(summary["localized"], 2);
  EXPECT_EQ(summary["references"], 3);
  EXPECT_EQ(summary["medians"]["retrieved"], 3);
  EXPECT_EQ(summary["warnings"], nlohmann::json::array());
  ASSERT_EQ(summary["geometry"].size(), 1u);
  EXPECT_EQ(summary["geometry"][0]["spec"], "mesh:" + scene.mesh().string());
  EXPECT_TRUE(summary["geometry"][0]["interpretation"].get<std::string>().ends_with(" triangles"));
}

TEST(Localize, AsksSeveralGeometriesInOrder) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const auto run = [&](const std::string& mode) {
    const fs::path out = scene.folder / mode;
    EXPECT_TRUE(
        Succeeds(RunRaylift(LocalizeWithHloc(scene, out) +
                            Arguments{"--geometry", "mesh:" + scene.mesh().string() + ",far=3",  //
                                      "--geometry-mode", mode})));
    EXPECT_TRUE(HoldsTruePoses(out / "poses.txt", scene.queries, 1e-3, 1e-4));
    const auto summary = nlohmann::json::parse(ReadFile(out / "summary.json"));
    EXPECT_EQ(summary["geometry"].size(), 2u);
    EXPECT_EQ(nlohmann::json::parse(ReadFile(out / "options.json"))["geometry-mode"], mode);
    return nlohmann::json::parse(Lines(ReadFile(out / "queries.jsonl")).at(0));
  };
  // The first knows all there is, the second, the same mesh up to a depth of 3, a part of it.
  const auto first = run("first");
  const auto all = run("all");
  const size_t matched = first["matched"];
  EXPECT_EQ(first["points_by_geometry"], (std::vector<size_t>{matched, 0}));
  EXPECT_EQ(all["points_by_geometry"][0], matched);
  const size_t of_second = all["points_by_geometry"][1];
  EXPECT_GT(of_second, 0u);
  EXPECT_LT(of_second, matched);
  EXPECT_EQ(all["hit"], matched);
  EXPECT_EQ(all["consistent"], matched + of_second);
}

TEST(Localize, StdoutHoldsResultsAndQuietNothing) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const CommandResult loud = RunRaylift(LocalizeWithHloc(scene, scene.folder / "out"));
  EXPECT_TRUE(Succeeds(loud));  // no progress on a stderr that is no terminal
  const std::vector<std::string> lines = Lines(loud.out);
  ASSERT_EQ(lines.size(), 2u) << loud.out;
  EXPECT_NE(lines[0].find(" s to read"), std::string::npos) << loud.out;
  EXPECT_TRUE(lines[1].starts_with("localized 2 of 2 queries against 6 references")) << loud.out;
  const std::vector<std::string> times = Lines(ReadFile(scene.folder / "out/timing.jsonl"));
  ASSERT_EQ(times.size(), 3u);
  const auto query = nlohmann::json::parse(times[0]);
  EXPECT_GT(query.at("milliseconds").at("estimate"), 0);
  const auto run = nlohmann::json::parse(times[2]);
  double stages = 0;
  for (const auto& seconds : run.at("stage_seconds")) stages += seconds.get<double>();
  EXPECT_NEAR(run.at("seconds"), stages, 1e-9);
  EXPECT_GT(run.at("thread_seconds").at("estimate"), 0);
  const CommandResult quiet =
      RunRaylift(LocalizeWithHloc(scene, scene.folder / "quiet") + Arguments{"--quiet"});
  EXPECT_TRUE(Succeeds(quiet));
  EXPECT_EQ(quiet.out, "");
}

TEST(Localize, AnOutFolderThatCannotBeWrittenIsNamedBeforeAnyWork) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path blocked = scene.folder / "blocked";
  WriteFile(blocked, "a file, no folder");
  EXPECT_TRUE(FailsWith(5, {blocked.string()}, RunRaylift(LocalizeWithHloc(scene, blocked))));
  EXPECT_TRUE(
      FailsWith(5, {blocked.string()}, RunRaylift(LocalizeWithHloc(scene, blocked / "out"))));
  EXPECT_TRUE(FailsWith(5, {blocked.string()},
                        RunRaylift(LocalizeWithHloc(scene, scene.folder / "out") +
                                   Arguments{"--write-problems", blocked})));
  EXPECT_FALSE(fs::exists(scene.folder / "out" / "queries.jsonl"));
  if (geteuid() == 0) {
    return;  // who may write everywhere
  }
  fs::create_directories(scene.folder / "closed");
  chmod((scene.folder / "closed").c_str(), 0500);
  EXPECT_TRUE(FailsWith(5, {(scene.folder / "closed").string()},
                        RunRaylift(LocalizeWithHloc(scene, scene.folder / "closed"))));
}

TEST(Localize, QueriesThatDifferByExtensionOnlyKeepTheirProblemsApart) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  std::string list = ReadFile(scene.query_list());
  auto queries = ReadQueryList(scene.query_list());
  queries.push_back({"query/a.jpg", queries[0].camera});
  queries.push_back({"/query/../../c.png", queries[0].camera});
  WriteQueryList(scene.query_list(), queries);
  const fs::path problems = scene.folder / "out" / "problems";
  const CommandResult result = RunRaylift(LocalizeWithHloc(scene, scene.folder / "out") +
                                          Arguments{"--write-problems", problems});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(FilesBelow(problems),
            (std::vector<std::string>{"query/a.jpg.json", "query/a.png.json", "query/b.png.json",
                                      "query/c.png.json"}));
}

TEST(Localize, NamesThatAreNotUtf8AreResultsAllTheSame) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  auto queries = ReadQueryList(scene.query_list());
  queries.push_back({"query/caf\xe9.png", queries[0].camera});
  WriteQueryList(scene.query_list(), queries);
  const CommandResult result = RunRaylift(LocalizeWithHloc(scene, scene.folder / "out"));
  EXPECT_TRUE(Succeeds(result));
  EXPECT_EQ(Diagnostics(scene.folder / "out" / "queries.jsonl").size(), 3u);
}

TEST(Localize, AGeoreferencedSceneGivesTheSamePosesMoved) {
  const fs::path folder = TestFolder();
  const Eigen::Vector3d offset(4e5, 5e6, 300);
  const RoomScene near = WriteRoomScene(folder / "near");
  const RoomScene far = WriteRoomScene(folder / "far", {.offset = offset});
  for (const std::string method :
       {"p3p", "e5p1", "d3p1", "adaptive", "select", "hybrid_ransac", "hloc"}) {
    std::vector<std::vector<NamedPose>> poses;
    for (const RoomScene* scene : {&near, &far}) {
      const fs::path out = scene->folder / method;
      ASSERT_TRUE(
          Succeeds(RunRaylift(LocalizeWithHloc(*scene, out) + Arguments{"--method", method})));
      poses.push_back(ReadPoseFile(out / "poses.txt"));
      ASSERT_EQ(poses.back().size(), 2u);
    }
    for (size_t i = 0; i < 2; ++i) {
      Rigid3 moved = poses[0][i].cam_from_world;
      moved.translation -= moved.rotation * offset;
      // 1e-6 of the room's 6 units, and that as an angle.
      EXPECT_TRUE(IsNearPose(poses[1][i].cam_from_world, moved, 6e-5, 6e-6))
          << method << " " << poses[0][i].name;
    }
  }
}

TEST(Localize, PicturesAreDrawnBesideTheMesh) {
  const RoomScene scene = WriteRoomScene(TestFolder(), {.pictures = true});
  const fs::path out = scene.folder / "out";
  ASSERT_TRUE(Succeeds(RunRaylift(LocalizeWithHloc(scene, out) +
                                  Arguments{"--pictures", "1", "--images", scene.images()})));
  EXPECT_EQ(FilesBelow(out / "pictures"), std::vector<std::string>{"query/a.png.jpg"});
}

}  // namespace
}  // namespace raylift
