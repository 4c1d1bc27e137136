// raylift views: poses on a mesh, ready for render.

#include <algorithm>

#include "apps/job_runs.h"
#include "apps/program.h"
#include "io/scene/trajectory_file.h"
#include "support/test_data.h"
#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include "raylift/base/file.h"
#include "raylift/io/colmap_model.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

class Views : public ::testing::Test {
 protected:
  Views() : demo_(DemoFolder()) {}

  Arguments Command() const {
    return {"views", "--geometry", "mesh:" + (demo_ / "scene.obj").string(), "--out", out_};
  }

  fs::path demo_;
  fs::path folder_ = TestFolder();
  fs::path out_ = folder_ / "views";
};

TEST_F(Views, OfTheDemoSeeItsCourtyardAndCanBeRendered) {
  const CommandResult result =
      RunRaylift(Command() + Arguments{"--count", "20", "--size", "80x60", "--preview"});
  ASSERT_TRUE(Succeeds(result));
  EXPECT_THAT(result.out, ::testing::HasSubstr("up is (0.000, 0.000, 1.000)"));
  EXPECT_EQ(ReadColmapModel(out_).images.size(), 20u);
  EXPECT_TRUE(fs::exists(out_ / "preview.png"));
  for (const PosedImage& image : ReadColmapModel(out_).PosedImages()) {
    const Eigen::Vector3d eye = image.cam_from_world.OriginInSource();
    EXPECT_NEAR(eye.z(), 1.6, 0.2) << image.name;  // the ground is at 0, with a kerb
    EXPECT_GT(std::min(eye.x(), eye.y()), 0) << image.name;
    EXPECT_LT(eye.x(), 16) << image.name;
    EXPECT_LT(eye.y(), 12) << image.name;
  }
  const fs::path rendered = folder_ / "rendered";
  ASSERT_TRUE(Succeeds(RunRaylift({"render", "--geometry", "mesh:" + (demo_ / "scene.obj").string(),
                                   "--model", out_, "--out", rendered})));
  const auto summary = nlohmann::json::parse(ReadFile(rendered / "summary.json"));
  EXPECT_GT(summary.at("coverage"), 0.8);
  EXPECT_GT(summary.at("least_coverage"), 0.5);
  EXPECT_GT(summary.at("depth_range").at(0), 0.2);
}

// A scan without a floor, as of a shelf or a facade.
TEST_F(Views, WhereThereIsNoGroundPlacesAreInFrontOfSurfaces) {
  const fs::path wall = folder_ / "wall.ply";
  WriteFile(wall,
            "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
            "property float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n"
            "0 0 0\n4 0 0\n4 0 3\n0 0 3\n3 0 1 2\n3 0 2 3\n");
  const Arguments command = {
      "views", "--geometry", "mesh:" + wall.string(), "--out", out_, "--count", "5", "--up", "z"};
  EXPECT_TRUE(FailsWith(3, {"no place for a camera", "modes cover and auto"},
                        RunRaylift(command + Arguments{"--mode", "inside"})));
  const CommandResult result = RunRaylift(command);
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_THAT(result.err, ::testing::HasSubstr("--mode cover"));
  EXPECT_EQ(ReadColmapModel(out_).images.size(), 5u);
}

TEST_F(Views, RigsComeWithTheirFrames) {
  ASSERT_TRUE(
      Succeeds(RunRaylift(Command() + Arguments{"--count", "3", "--rig-cameras", "4", "--text"})));
  const ColmapModel model = ReadColmapModel(out_);
  EXPECT_TRUE(model.warnings.empty());
  EXPECT_EQ(model.images.size(), 12u);
  EXPECT_EQ(model.frames.size(), 3u);
}

TEST_F(Views, AWalkHasOdometry) {
  ASSERT_TRUE(Succeeds(RunRaylift(
      Command() + Arguments{"--mode", "walk", "--count", "30", "--spacing", "0.5", "--quiet"})));
  const fs::path odometry = folder_ / "odometry";
  ASSERT_TRUE(Succeeds(
      RunRaylift({"perturb", "--model", out_, "--walk", "--drift", "0", "--out", odometry})));
  const auto poses = ReadTumTrajectory(odometry / "odometry.txt");
  ASSERT_EQ(poses.size(), 30u);
  for (size_t i = 1; i < poses.size(); ++i) {
    const double step =
        (poses[i].cam_from_world.OriginInSource() - poses[i - 1].cam_from_world.OriginInSource())
            .norm();
    EXPECT_LT(step, 0.56);
  }
}

TEST_F(Views, AFinishedFolderIsReplacedOnlyWhereThatIsAskedFor) {
  const Arguments three = Command() + Arguments{"--count", "3", "--quiet"};
  ASSERT_TRUE(Succeeds(RunRaylift(three)));
  const std::string before = ReadFile(out_ / "images.bin");
  EXPECT_TRUE(FailsWith(2, {"--overwrite", "images.bin"}, RunRaylift(three)));
  EXPECT_EQ(ReadFile(out_ / "images.bin"), before);
  ASSERT_TRUE(Succeeds(RunRaylift(three + Arguments{"--overwrite", "--seed", "1"})));
  EXPECT_NE(ReadFile(out_ / "images.bin"), before);
}

TEST_F(Views, AFolderThatCannotBeWrittenIsNamed) {
  const fs::path file = folder_ / "file";
  WriteFile(file, "in the way");
  EXPECT_TRUE(FailsWith(
      5, {file.string()},
      RunRaylift(Arguments{"views", "--geometry", "mesh:" + (demo_ / "scene.obj").string(), "--out",
                           file / "out"})));
  const CommandResult full = RunProcess(WithFullDisk(0, Command() + Arguments{"--count", "3"}));
  EXPECT_EQ(full.exit_code, 5) << full.err;
  EXPECT_EQ(FilesBelow(out_), std::vector<std::string>());
}

TEST_F(Views, ASignalLeavesNothing) {
  EXPECT_EQ(Terminate(StartRaylift(Command() + Arguments{"--count", "1000000"})), 4);
  EXPECT_EQ(FilesBelow(out_), std::vector<std::string>());
}

TEST_F(Views, WrongOptionsAreNamed) {
  const auto fails = [&](const Arguments& more, const std::string& part) {
    return FailsWith(2, {part}, RunRaylift(Command() + more));
  };
  EXPECT_TRUE(fails({"--mode", "above"}, "auto|inside|around|cover|along|walk"));
  EXPECT_TRUE(fails({"--mode", "along"}, "--line"));
  EXPECT_TRUE(fails({"--up", "w"}, "--up"));
  EXPECT_TRUE(fails({"--up", "0,0,0"}, "--up"));
  EXPECT_TRUE(fails({"--count", "0"}, "--count"));
  EXPECT_TRUE(fails({"--camera", "PINHOLE 640"}, "--camera"));
  EXPECT_TRUE(fails({"--fov-deg", "180"}, "--fov-deg"));
  EXPECT_TRUE(fails({"--distance", "-1"}, "--distance"));
  EXPECT_TRUE(fails({"--mode", "walk", "--spacing", "0"}, "--spacing"));
  EXPECT_TRUE(fails({"--min-elevation-deg", "70"}, "--min-elevation-deg"));
  EXPECT_FALSE(fs::exists(out_));
}

}  // namespace
}  // namespace raylift
