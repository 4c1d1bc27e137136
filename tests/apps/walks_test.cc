// localize --odometry on the demo scene, with few references and features, so that photographs
// alone often fail.

#include <map>

#include "apps/program.h"
#include "io/scene/trajectory_file.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "raylift/base/file.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/query_list.h"
#include "raylift/io/scene_file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr double kScale = 0.3;  // odometry's units per scene unit

class Walks : public ::testing::Test {
 protected:
  // The true motion, seen from another origin, as a TUM trajectory, and the times.
  Walks() : truth_(ReadColmapModel(DemoFolder() / "ground_truth").PosedImages()) {
    Rng rng = TestRng();
    const Rigid3 world_from_odometry = RandomRigid3(rng, 50);
    std::vector<TimedPose> poses;
    std::map<std::string, double> times;
    for (size_t i = 0; i < truth_.size(); ++i) {
      Rigid3 pose = truth_[i].cam_from_world * world_from_odometry;
      pose.translation *= kScale;
      poses.push_back({10 + 0.5 * static_cast<double>(i), pose});
      times[truth_[i].name] = poses.back().time_s + 0.1;
    }
    WriteTumTrajectory(folder_ / "odometry.txt", poses);
    WriteTimes(folder_ / "times.txt", times);
  }

  Arguments Localize(const fs::path& out, const Arguments& more = {}) const {
    return LocalizeDemo(folder_ / "cache", out) +
           Arguments{"--every", "4", "--max-features", "500"} + more;
  }

  Arguments Odometry() const {
    return {"--odometry", folder_ / "odometry.txt", "--odometry-scale", "unknown",
            "--times",    folder_ / "times.txt"};
  }

  const fs::path folder_ = TestFolder();
  std::vector<PosedImage> truth_;
};

TEST_F(Walks, PhotographsWithoutAPoseGetTheWalks) {
  const fs::path alone = folder_ / "alone";
  ASSERT_TRUE(Succeeds(RunRaylift(Localize(alone, {"--quiet"}))));
  ASSERT_LT(PoseLines(alone / "poses.txt").size(), truth_.size());
  const fs::path out = folder_ / "walk";
  const CommandResult result = RunRaylift(Localize(out, Odometry() + Arguments{"--threads", "1"}));
  ASSERT_TRUE(Succeeds(result));
  EXPECT_TRUE(HoldsTruePoses(out / "poses.txt", truth_, 0.5, 0.1));
  EXPECT_NE(result.out.find(" rescued, "), std::string::npos) << result.out;

  const Json walk = Json::parse(ReadFile(out / "walk.json"));
  EXPECT_NEAR(walk.at("odometry").at("scale").get<double>() * kScale, 1, 0.02);
  EXPECT_GT(walk.at("photographs").at("rescued"), 0);
  size_t rematched = 0;
  for (const auto& [name, line] : Diagnostics(out / "queries.jsonl")) {
    const Json json = Json::parse(line);
    rematched += json.at("walk").at("rematched").get<bool>() ? 1 : 0;
    EXPECT_EQ(json.at("status"), "ok");
    EXPECT_EQ(json.at("walk").at("role") == "rescued",
              json.at("walk").at("single_cam_from_world").is_null());
  }
  EXPECT_GT(rematched, 0U);
  const auto trajectory = ReadTumTrajectory(out / "trajectory.txt");
  ASSERT_EQ(trajectory.size(), truth_.size());
  for (size_t i = 0; i < truth_.size(); ++i) {
    EXPECT_TRUE(IsNearPose(trajectory[i].cam_from_world, truth_[i].cam_from_world, 0.5, 0.1));
  }
  EXPECT_EQ(Lines(ReadFile(out / "trajectory_covariance.txt")).size(), truth_.size() + 1);

  // A run that is done takes its odometry afterwards, with the same bytes by any number of threads.
  ASSERT_TRUE(Succeeds(RunRaylift(Localize(alone, Odometry() + Arguments{"--resume", "--quiet"}))));
  for (const char* name :
       {"poses.txt", "queries.jsonl", "summary.json", "walk.json", "trajectory_covariance.txt"}) {
    EXPECT_EQ(ReadFile(alone / name), ReadFile(out / name)) << name;
  }

  // Photographs are not localized again where that is not wanted.
  ASSERT_TRUE(Succeeds(
      RunRaylift(Localize(alone, Odometry() + Arguments{"--resume", "--quiet", "--no-rematch"}))));
  EXPECT_EQ(ReadFile(alone / "queries.jsonl").find("\"rematched\":true"), std::string::npos);

  // Without odometry, nothing of the walk stays; what is merged says that it has none.
  ASSERT_TRUE(Succeeds(RunRaylift(Localize(alone, {"--resume", "--quiet"}))));
  for (const char* name : {"walk.json", "trajectory.txt", "trajectory_covariance.txt"}) {
    EXPECT_FALSE(fs::exists(alone / name)) << name;
  }
  const CommandResult merged = RunRaylift({"merge", folder_ / "merged", out});
  EXPECT_EQ(merged.exit_code, 0);
  EXPECT_NE(merged.err.find("the walk is not smoothed by merge"), std::string::npos) << merged.err;
}

TEST_F(Walks, AListHasSeveral) {
  // The first half and the second one, each with an odometry of its own unit.
  std::string queries = ReadFile(DemoFolder() / "queries.txt");
  for (size_t i = 0; i < truth_.size(); ++i) {
    const std::string file = fs::path(truth_[i].name).filename();
    const std::string name = (i < 6 ? "first/" : "second/") + file;
    fs::create_directories((folder_ / name).parent_path());
    fs::create_symlink(DemoFolder() / "images" / truth_[i].name, folder_ / name);
    queries.replace(queries.find(truth_[i].name), truth_[i].name.size(), name);
    truth_[i].name = name;
  }
  WriteFile(folder_ / "queries.txt", queries);
  auto poses = ReadTumTrajectory(folder_ / "odometry.txt");
  for (TimedPose& pose : poses) pose.cam_from_world.translation *= 10;
  WriteTumTrajectory(folder_ / "other.txt", poses);
  WriteFile(folder_ / "walks.txt", "walk first odometry.txt\nwalk second other.txt times.txt\n");

  const fs::path out = folder_ / "out";
  const Arguments alone =
      Arguments{"localize", "--model", DemoFolder() / "model", "--images",
                DemoFolder() / "images"} +
      Arguments{"--geometry", "mesh:" + (DemoFolder() / "scene.obj").string()} +
      Arguments{"--queries", folder_ / "queries.txt", "--query-images", folder_} +
      Arguments{"--every", "4", "--max-features", "500", "--cache", folder_ / "cache"} +
      Arguments{"--out", out, "--report", out / "page"};
  const Arguments localize =
      alone + Arguments{"--odometry", folder_ / "walks.txt", "--odometry-scale", "unknown",
                        "--times",    folder_ / "times.txt"};
  const CommandResult result = RunRaylift(localize);
  ASSERT_TRUE(Succeeds(result));
  EXPECT_NE(result.out.find("; second/: odometry's scale "), std::string::npos) << result.out;
  EXPECT_TRUE(HoldsTruePoses(out / "poses.txt", truth_, 0.5, 0.1));
  const Json walks = Json::parse(ReadFile(out / "walk.json")).at("walks");
  for (size_t k = 0; k < 2; ++k) {
    const double scale = walks.at(k).at("odometry").at("scale");
    EXPECT_NEAR(scale * kScale * (k == 0 ? 1 : 10), 1, 0.02);
    const auto trajectory = ReadTumTrajectory(out / walks.at(k).at("trajectory"));
    ASSERT_EQ(trajectory.size(), 6U);
    EXPECT_TRUE(
        IsNearPose(trajectory[1].cam_from_world, truth_[6 * k + 1].cam_from_world, 0.5, 0.1));
  }
  EXPECT_TRUE(fs::exists(out / "trajectory_covariance_2.txt"));

  // What was of a walk that is no longer in the list goes.
  WriteFile(folder_ / "walks.txt", "walk first odometry.txt\n");
  const CommandResult less = RunRaylift(localize + Arguments{"--resume", "--quiet"});
  EXPECT_EQ(less.exit_code, 0);
  EXPECT_NE(less.err.find("walks.txt: 6 of 12 photographs are of no walk"), std::string::npos)
      << less.err;
  EXPECT_TRUE(fs::exists(out / "trajectory_1.txt"));
  EXPECT_FALSE(fs::exists(out / "trajectory_2.txt"));
  // Nothing goes where the command is refused.
  WriteFile(folder_ / "walks.txt", "walk third odometry.txt\n");
  EXPECT_EQ(RunRaylift(localize + Arguments{"--overwrite"}).exit_code, 3);
  EXPECT_TRUE(fs::exists(out / "trajectory_1.txt"));
  ASSERT_TRUE(Succeeds(RunRaylift(alone + Arguments{"--overwrite", "--quiet"})));
  EXPECT_FALSE(fs::exists(out / "trajectory_covariance_1.txt"));
}

TEST_F(Walks, OnlineKnowsThePastAlone) {
  const fs::path out = folder_ / "online";
  ASSERT_TRUE(Succeeds(RunRaylift(Localize(out, Odometry() + Arguments{"--online", "--quiet"}))));
  const auto lines = Diagnostics(out / "queries.jsonl");
  const Json first = Json::parse(lines.at(truth_[0].name));
  EXPECT_EQ(first.at("walk").at("role"), "alone");
  // The last one knows the whole walk, but for what is localized again by it.
  ASSERT_TRUE(Succeeds(
      RunRaylift(Localize(out, Odometry() + Arguments{"--resume", "--quiet", "--no-rematch"}))));
  const std::string& last = truth_.back().name;
  EXPECT_EQ(Json::parse(lines.at(last)).at("covariance"),
            Json::parse(Diagnostics(out / "queries.jsonl").at(last)).at("covariance"));
}

TEST_F(Walks, OfAnotherPlaceIsNotInTheMap) {
  // Each photograph's motion is another's.
  auto poses = ReadTumTrajectory(folder_ / "odometry.txt");
  for (size_t i = 0; i < poses.size(); ++i) {
    Rng rng(i);
    poses[i].cam_from_world = RandomRigid3(rng, 10);
  }
  WriteTumTrajectory(folder_ / "odometry.txt", poses);
  const fs::path out = folder_ / "elsewhere";
  ASSERT_TRUE(Succeeds(RunRaylift(Localize(out, Odometry() + Arguments{"--quiet"}))));
  const Json walk = Json::parse(ReadFile(out / "walk.json"));
  EXPECT_EQ(walk.at("photographs").at("rescued"), 0);
}

TEST_F(Walks, BadOptionsAndFilesAreRefusedBeforeTheWork) {
  const fs::path out = folder_ / "refused";
  const auto fails = [&](int code, const Arguments& more, const std::vector<std::string>& parts) {
    return FailsWith(code, parts, RunRaylift(Localize(out, more)));
  };
  const fs::path odometry = folder_ / "odometry.txt";
  EXPECT_TRUE(fails(2, {"--online"}, {"--online needs --odometry"}));
  EXPECT_TRUE(fails(2, {"--odometry-scale", "unknown"}, {"--odometry-scale needs --odometry"}));
  EXPECT_TRUE(
      fails(2, {"--times", folder_ / "times.txt"}, {"--times needs --continuous or --odometry"}));
  EXPECT_TRUE(fails(2, Odometry() + Arguments{"--continuous"},
                    {"--continuous does not go with --odometry"}));
  EXPECT_TRUE(fails(3, {"--odometry", folder_ / "none.txt"}, {"none.txt", "no such file"}));
  EXPECT_TRUE(fails(3, {"--odometry", odometry}, {"odometry.txt", "neither a list of times"}));
  WriteFile(odometry, "1 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n");
  EXPECT_TRUE(fails(3, Odometry(), {"odometry.txt", "line 2", "expected a time after 1"}));
  EXPECT_FALSE(fs::exists(out / "poses.txt"));
}

TEST_F(Walks, PerturbMakesOdometryAndEvaluateJudgesTrajectories) {
  const fs::path made = folder_ / "made";
  ASSERT_TRUE(Succeeds(RunRaylift({"perturb", "--model", DemoFolder() / "ground_truth", "--walk",
                                   "--out", made, "--drift", "0.01", "--turn-drift-deg", "0.2"})));
  const auto odometry = ReadTumTrajectory(made / "odometry.txt");
  ASSERT_EQ(odometry.size(), truth_.size());
  EXPECT_EQ(ReadTimes(made / "times.txt").at(truth_[3].name), odometry[3].time_s);
  std::vector<NamedPose> poses;
  for (size_t i = 0; i < truth_.size(); ++i) {
    poses.push_back({truth_[i].name, odometry[i].cam_from_world * truth_[0].cam_from_world});
  }
  WritePoseFile(folder_ / "drifting.txt", poses);
  const fs::path json = folder_ / "trajectory.json";
  const CommandResult result = RunRaylift(
      {"evaluate", "--ground-truth", DemoFolder() / "ground_truth", "--poses",
       folder_ / "drifting.txt", "--times", made / "times.txt", "--trajectory-json", json});
  ASSERT_TRUE(Succeeds(result));
  EXPECT_NE(result.out.find("ape_rotation_deg"), std::string::npos) << result.out;
  const Json errors = Json::parse(ReadFile(json)).at(0);
  EXPECT_EQ(errors.at("ape_position").at("min"), 0);
  // Steps err by drift alone, poses by what it adds up to.
  EXPECT_LT(errors.at("rpe_position").at("rmse"), errors.at("ape_position").at("rmse"));

  const fs::path short_times = folder_ / "short.txt";
  WriteFile(short_times, truth_[0].name + " 1\n");
  for (const Arguments& command :
       {Arguments{"perturb", "--model", DemoFolder() / "ground_truth", "--walk", "--out", made},
        Arguments{"evaluate", "--ground-truth", DemoFolder() / "ground_truth", "--poses",
                  folder_ / "drifting.txt", "--trajectory-json", json}}) {
    EXPECT_TRUE(FailsWith(3, {"short.txt", "the time of " + truth_[1].name + " is missing"},
                          RunRaylift(command + Arguments{"--times", short_times})));
  }
  EXPECT_TRUE(
      FailsWith(2, {"--geometry is required (or --walk)"},
                RunRaylift({"perturb", "--model", DemoFolder() / "ground_truth", "--out", made})));
  EXPECT_TRUE(FailsWith(2, {"--drift", "must not be negative"},
                        RunRaylift({"perturb", "--model", DemoFolder() / "ground_truth", "--walk",
                                    "--out", made, "--drift", "-1"})));
}

TEST_F(Walks, OdometryOfOtherUnitsIsPointedOut) {
  const fs::path out = folder_ / "units";
  const CommandResult result = RunRaylift(Localize(
      out, {"--odometry", folder_ / "odometry.txt", "--times", folder_ / "times.txt", "--quiet"}));
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_NE(result.err.find("--odometry-scale unknown finds it"), std::string::npos) << result.err;
}

}  // namespace
}  // namespace raylift
