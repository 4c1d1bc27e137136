// localize --continuous on the demo scene with few references: what it gains, and what is left of
// it when it is stopped or killed.

#include <csignal>
#include <map>

#include "apps/program.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <unistd.h>

#include "raylift/base/file.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

// Quick.
const Arguments kFewFeatures = {"--every", "4", "--max-features", "800"};

class Continuous : public ::testing::Test {
 protected:
  Arguments Localize(const fs::path& out, const Arguments& more) const {
    return LocalizeDemo(folder_ / "cache", out) + Arguments{"--quiet"} + more;
  }
  // The lines of what is done; that of the results has the page, which names its folder.
  static std::vector<std::string> Records(const fs::path& out) {
    std::vector<std::string> lines = Lines(ReadFile(out / "manifest.jsonl"));
    std::erase_if(lines, [](const std::string& line) {
      return line.find("index.html") != std::string::npos;
    });
    return lines;
  }
  void ExpectSameRun(const fs::path& a, const fs::path& b) const {
    EXPECT_EQ(ReadFile(a / "poses.txt"), ReadFile(b / "poses.txt"));
    EXPECT_EQ(Diagnostics(a / "queries.jsonl"), Diagnostics(b / "queries.jsonl"));
    EXPECT_EQ(Records(a), Records(b));
  }

  fs::path folder_ = TestFolder();
};

// Until the manifest has so many lines, or the program has ended.
void WaitForLines(pid_t process, const fs::path& manifest, size_t count) {
  while (!HasEnded(process) &&
         (!fs::exists(manifest) || Lines(ReadFile(manifest)).size() < count)) {
    usleep(1000);
  }
}

TEST_F(Continuous, StoppedOrKilledItGoesOnToTheSameBytes) {
  const auto continuous = [this](const fs::path& out, const Arguments& more) {
    return Localize(out,
                    kFewFeatures + Arguments{"--continuous", "--report", out / "report"} + more);
  };
  const fs::path whole = folder_ / "whole";
  ASSERT_TRUE(Succeeds(RunRaylift(continuous(whole, {"--threads", "1"}))));
  for (const int signal : {SIGINT, SIGKILL}) {
    const fs::path out = folder_ / std::to_string(signal);
    const pid_t process = StartRaylift(continuous(out, {"--threads", "2"}));
    WaitForLines(process, out / "manifest.jsonl", 5);  // three queries
    kill(process, signal);
    EXPECT_EQ(WaitFor(process), signal == SIGINT ? 4 : 128 + signal);
    EXPECT_FALSE(fs::exists(out / "poses.txt"));
    ASSERT_TRUE(Succeeds(RunRaylift(continuous(out, {"--resume"}))));
    EXPECT_TRUE(fs::exists(out / "report" / "index.html"));
    ExpectSameRun(whole, out);
  }
  EXPECT_TRUE(FailsWith(3, {"manifest.jsonl", "seed"},
                        RunRaylift(continuous(whole, {"--resume", "--seed", "1"}))));
}

// How many of the demo's queries are within 10 cm and one degree.
size_t CountGoodPoses(const fs::path& out) {
  const ColmapModel truth = ReadColmapModel(DemoFolder() / "ground_truth");
  std::map<std::string, Rigid3> true_poses;
  for (const PosedImage& image : truth.PosedImages()) {
    true_poses.emplace(image.name, image.cam_from_world);
  }
  size_t count = 0;
  for (const NamedPose& pose : ReadPoseFile(out / "poses.txt")) {
    count += IsNearPose(pose.cam_from_world, true_poses.at(pose.name), 1, 0.1) ? 1 : 0;
  }
  return count;
}

TEST_F(Continuous, FewReferencesThatGrowGoFurther) {
  const fs::path alone = folder_ / "alone";
  const fs::path continuous = folder_ / "continuous";
  const Arguments few = {"--every", "3", "--max-features", "4096"};
  ASSERT_TRUE(Succeeds(RunRaylift(Localize(alone, few))));
  ASSERT_TRUE(Succeeds(RunRaylift(Localize(continuous, few + Arguments{"--continuous"}))));
  // 10 and 12 of 12.
  EXPECT_GT(CountGoodPoses(continuous), CountGoodPoses(alone));
}

TEST_F(Continuous, OlderQueriesAreTakenBackwardsInTime) {
  std::string times = "ref/ref_01.jpg 1000\n";
  const auto queries = ReadQueryList(DemoFolder() / "queries.txt");
  for (size_t i = 0; i < queries.size(); ++i) {
    times += queries[i].name + " " + std::to_string(i < 4 ? 100 + i : 2000 - i) + "\n";
  }
  WriteFile(folder_ / "times.txt", times);
  const fs::path out = folder_ / "out";
  ASSERT_TRUE(Succeeds(RunRaylift(Localize(out, {"--continuous", "--times", folder_ / "times.txt",
                                                 "--every", "4", "--max-features", "300"}))));
  std::vector<size_t> places;
  for (const std::string& line : Lines(ReadFile(out / "queries.jsonl"))) {
    places.push_back(nlohmann::json::parse(line)["place_in_order"]);
  }
  EXPECT_EQ(places, (std::vector<size_t>{3, 2, 1, 0, 11, 10, 9, 8, 7, 6, 5, 4}));
}

TEST_F(Continuous, OptionsThatNeedItSaySo) {
  EXPECT_TRUE(FailsWith(2, {"--times needs --continuous"},
                        RunRaylift(Localize(folder_ / "out", {"--times", "t.txt"}))));
  EXPECT_TRUE(FailsWith(2, {"--shard = 1/2", "each query may be a reference of the next"},
                        RunRaylift(Localize(folder_ / "out", {"--continuous", "--shard", "1/2"}))));
  EXPECT_TRUE(
      FailsWith(2, {"--join-max-rotation-sigma-deg = -1"},
                RunRaylift(Localize(folder_ / "out",
                                    {"--continuous", "--join-max-rotation-sigma-deg", "-1"}))));
}

}  // namespace
}  // namespace raylift
