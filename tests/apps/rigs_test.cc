// localize --rigs on the demo scene: rigs of neighboring queries, whose relative poses are those of
// the ground truth.

#include <map>

#include "apps/job_runs.h"
#include "apps/program.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "raylift/base/file.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/query_list.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

class Rigs : public ::testing::Test {
 protected:
  Rigs() {
    for (const PosedImage& image : ReadColmapModel(DemoFolder() / "ground_truth").PosedImages()) {
      truth_.push_back(image);
    }
  }

  // Few references and few features, so that it is quick, and photographs alone often fail.
  Arguments Localize(const fs::path& out, const Arguments& more = {}) const {
    return LocalizeDemo(folder_ / "cache", out) +
           Arguments{"--every", "4", "--max-features", "800", "--quiet"} + more;
  }

  // Each `size` queries that follow each other are a rig. The last one's camera is its reference.
  fs::path RigConfig(size_t size) const {
    Json rigs = Json::array();
    for (size_t first = 0; first < truth_.size(); first += size) {
      Json cameras = Json::array();
      for (size_t i = first; i < first + size; ++i) {
        const PosedImage& reference = truth_[first + size - 1];
        Json camera = {{"image_prefix", truth_[i].name}};
        if (i + 1 == first + size) {
          camera["ref_sensor"] = true;
        } else {
          const Rigid3 pose = truth_[i].cam_from_world * reference.cam_from_world.Inverse();
          const Eigen::Quaterniond& q = pose.rotation;
          camera["cam_from_rig_rotation"] = {q.w(), q.x(), q.y(), q.z()};
          const Eigen::Vector3d& t = pose.translation;
          camera["cam_from_rig_translation"] = {t.x(), t.y(), t.z()};
        }
        cameras.push_back(camera);
      }
      rigs.push_back({{"cameras", cameras}});
    }
    const fs::path file = folder_ / ("rigs_of_" + std::to_string(size) + ".json");
    WriteFile(file, rigs.dump());
    return file;
  }

  std::map<std::string, Rigid3> Poses(const fs::path& out) const {
    std::map<std::string, Rigid3> poses;
    for (const NamedPose& pose : ReadPoseFile(out / "poses.txt")) {
      poses.emplace(pose.name, pose.cam_from_world);
    }
    return poses;
  }
  // Within 10 cm and one degree.
  size_t CountGood(const fs::path& out) const {
    const auto poses = Poses(out);
    size_t count = 0;
    for (const PosedImage& image : truth_) {
      const auto pose = poses.find(image.name);
      count +=
          pose != poses.end() && IsNearPose(pose->second, image.cam_from_world, 1, 0.1) ? 1 : 0;
    }
    return count;
  }

  fs::path folder_ = TestFolder();
  std::vector<PosedImage> truth_;
};

TEST_F(Rigs, AreLocalizedMoreOftenThanTheirPhotographs) {
  ASSERT_EQ(truth_.size(), 12u);
  const fs::path alone = folder_ / "alone";
  ASSERT_TRUE(Succeeds(RunRaylift(Localize(alone))));
  for (const size_t size : {2, 3, 6}) {
    const fs::path out = folder_ / std::to_string(size);
    ASSERT_TRUE(Succeeds(RunRaylift(Localize(out, {"--rigs", RigConfig(size)}))));
    EXPECT_GT(CountGood(out), CountGood(alone)) << size;
  }
}

TEST_F(Rigs, TheirPhotographsHaveOnePoseTogether) {
  const fs::path out = folder_ / "out";
  const fs::path problems = folder_ / "problems";
  ASSERT_TRUE(Succeeds(RunRaylift(
      Localize(out, {"--rigs", RigConfig(4), "--write-problems", problems, "--threads", "2"}))));
  const auto poses = Poses(out);
  ASSERT_EQ(poses.size(), 12u);
  std::vector<std::string> own;
  for (size_t i = 0; i < truth_.size(); ++i) {
    const PosedImage& reference = truth_[i / 4 * 4 + 3];
    if (i % 4 == 3) own.push_back(reference.name + ".json");
    const Rigid3 between = poses.at(truth_[i].name) * poses.at(reference.name).Inverse();
    EXPECT_TRUE(IsNearPose(between, truth_[i].cam_from_world * reference.cam_from_world.Inverse(),
                           1e-5, 1e-6));
  }
  // In the order of the list, which says whose pose was estimated.
  const std::vector<std::string> lines = Lines(ReadFile(out / "queries.jsonl"));
  ASSERT_EQ(lines.size(), 12u);
  for (size_t i = 0; i < lines.size(); ++i) {
    const Json json = Json::parse(lines[i]);
    EXPECT_EQ(json["name"], truth_[i].name);
    EXPECT_EQ(json["rig"], truth_[i / 4 * 4 + 3].name);
  }

  // One problem for each rig, from which `estimate` has the same pose.
  EXPECT_EQ(FilesBelow(problems), own);
  const fs::path csv = folder_ / "estimates.csv";
  ASSERT_TRUE(Succeeds(RunRaylift({"estimate", problems, "--csv", csv, "--quiet"})));
  const std::vector<std::string> rows = Lines(ReadFile(csv));
  ASSERT_EQ(rows.size(), 4u);
  for (size_t i = 1; i < rows.size(); ++i) {
    EXPECT_NE(rows[i].find(",ok,"), std::string::npos) << rows[i];
  }

  // However the work is shared.
  const fs::path shards = folder_ / "shards";
  for (const char* shard : {"1/2", "2/2"}) {
    ASSERT_TRUE(Succeeds(RunRaylift(Localize(shards, {"--rigs", RigConfig(4), "--write-problems",
                                                      folder_ / "again", "--shard", shard}))));
  }
  EXPECT_EQ(ReadFile(out / "poses.txt"), ReadFile(shards / "poses.txt"));
  EXPECT_EQ(ReadFile(out / "queries.jsonl"), ReadFile(shards / "queries.jsonl"));
  EXPECT_EQ(FilesBelow(folder_ / "again"), own);
}

TEST_F(Rigs, OfOneAreQueries) {
  const fs::path alone = folder_ / "alone";
  const fs::path rigs = folder_ / "rigs";
  const auto problems = [](const fs::path& out) { return out.string() + "_problems"; };
  ASSERT_TRUE(Succeeds(RunRaylift(Localize(alone, {"--write-problems", problems(alone)}))));
  ASSERT_TRUE(Succeeds(
      RunRaylift(Localize(rigs, {"--rigs", RigConfig(1), "--write-problems", problems(rigs)}))));
  EXPECT_EQ(ReadFile(alone / "poses.txt"), ReadFile(rigs / "poses.txt"));
  EXPECT_EQ(ReadFile(alone / "queries.jsonl"), ReadFile(rigs / "queries.jsonl"));
  ASSERT_EQ(FilesBelow(problems(alone)), FilesBelow(problems(rigs)));
  for (const std::string& name : FilesBelow(problems(alone))) {
    EXPECT_EQ(ReadFile(fs::path(problems(alone)) / name),
              ReadFile(fs::path(problems(rigs)) / name));
  }
}

TEST_F(Rigs, WhatDoesNotGoWithThemSaysSo) {
  const fs::path config = RigConfig(2);
  for (const Arguments& other : {Arguments{"--continuous"}, Arguments{"--refine-focal"}}) {
    EXPECT_TRUE(
        FailsWith(2, {other[0] + " does not go with --rigs"},
                  RunRaylift(Localize(folder_ / "out", Arguments{"--rigs", config} + other))));
  }
  const fs::path bad = folder_ / "bad.json";
  WriteFile(bad, R"([{"cameras": [{"image_prefix": "query/"}]}])");
  EXPECT_TRUE(FailsWith(3, {"bad.json: [0].cameras[0]", "cam_from_rig_rotation", "missing"},
                        RunRaylift(Localize(folder_ / "out", {"--rigs", bad}))));
}

}  // namespace
}  // namespace raylift
