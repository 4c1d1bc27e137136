// fuse: depth maps become a mesh that localize takes.

#include <string>
#include <vector>

#include "apps/program.h"
#include "support/room_scene.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/io/colmap_model.h"
#include "raylift/mapping/fusion.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

class Fuse : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!CanFuse()) GTEST_SKIP() << "built without OpenVDB";
  }

  // Depth maps of the room's mesh with these faults.
  std::string Maps(const Arguments& faults) const {
    const fs::path folder = scene_.folder / "maps";
    EXPECT_TRUE(Succeeds(RunRaylift(Arguments{"perturb", "--model", scene_.model(), "--geometry",
                                              "mesh:" + scene_.mesh().string(), "--out", folder} +
                                    faults)));
    return "depth:" + folder.string();
  }

  Arguments Command(const std::string& geometry) const {
    return {"fuse", "--model", scene_.model(), "--geometry", geometry, "--out", out_};
  }

  // Of the share of the queries that are localized within 2 cm.
  bool LocalizesAsWell() const {
    const fs::path poses = scene_.folder / "localized";
    EXPECT_TRUE(Succeeds(RunRaylift(
        {"localize", "--model", scene_.model(), "--geometry", "mesh:" + out_.string(), "--queries",
         scene_.query_list(), "--features", scene_.features(), "--matches", scene_.matches(),
         "--pairs", scene_.pairs(), "--method", "p3p", "--out", poses, "--quiet", "--overwrite"})));
    const CommandResult result =
        RunRaylift({"evaluate", "--ground-truth", scene_.truth(), "--poses", poses / "poses.txt",
                    "--thresholds", "0.02,0.5"});
    EXPECT_TRUE(Succeeds(result));
    return result.out.find("100.0") != std::string::npos;
  }

  RoomScene scene_ = WriteRoomScene(TestFolder(), {.pictures = true});
  fs::path out_ = scene_.folder / "fused.ply";
};

TEST_F(Fuse, MapsBecomeAMeshThatLocalizeTakes) {
  const CommandResult result = RunRaylift(Command(Maps({"--relative-noise", "0.002"})));
  ASSERT_TRUE(Succeeds(result));
  EXPECT_NE(result.out.find("views disagree by"), std::string::npos) << result.out;
  const TriangleMesh fused = ReadMesh(out_);
  EXPECT_TRUE(fused.vertex_colors_rgb.empty());
  EXPECT_EQ(fused.warnings, std::vector<std::string>());
  EXPECT_TRUE(LocalizesAsWell());
}

TEST_F(Fuse, DepthIsCorrectedFirstAndPhotographsColorTheMesh) {
  const CommandResult result =
      RunRaylift(Command(Maps({"--scale-sigma", "0.2"})) +
                 Arguments{"--images", scene_.images(), "--align-depth", "scale"});
  ASSERT_TRUE(Succeeds(result));
  EXPECT_NE(result.out.find("the depth is corrected"), std::string::npos) << result.out;
  EXPECT_FALSE(ReadMesh(out_).vertex_colors_rgb.empty());
  EXPECT_TRUE(LocalizesAsWell());
}

TEST_F(Fuse, AMeshIsSeenByRays) {
  const std::string mesh = "mesh:" + scene_.mesh().string();
  ASSERT_TRUE(Succeeds(RunRaylift(Command(mesh) + Arguments{"--max-side", "320"})));
  EXPECT_TRUE(LocalizesAsWell());
}

TEST_F(Fuse, SaysWhatIsWrong) {
  const std::string mesh = "mesh:" + scene_.mesh().string();
  const auto fails = [&](const std::vector<std::string>& parts, const Arguments& more) {
    return FailsWith(2, parts, RunRaylift(Command(mesh) + more));
  };
  EXPECT_TRUE(fails({"--images is required"}, {"--align-depth", "grid"}));
  EXPECT_TRUE(fails({"--voxel = -1", "must be positive"}, {"--voxel=-1"}));
  EXPECT_TRUE(fails({"--min-piece = -1", "must be at least 0"}, {"--min-piece=-1"}));
  EXPECT_TRUE(fails({"--voxel", "GB", "a quarter"}, {"--voxel", "0.001", "--memory", "0.01"}));
  EXPECT_TRUE(fails({"--truncation", "voxels"}, {"--voxel", "0.05", "--truncation", "0.01"}));
  EXPECT_TRUE(fails({"--max-side"}, {"--max-side", "0"}));
  EXPECT_TRUE(FailsWith(2, {"are no surface"}, RunRaylift(Command("sfm"))));
  EXPECT_TRUE(FailsWith(3, {"none of the 6 views sees"},
                        RunRaylift(Command(mesh + ",scale=1e-6,shift=900/0/0"))));
  out_ = scene_.folder / "fused.obj";
  EXPECT_TRUE(FailsWith(2, {"--out", ".ply"}, RunRaylift(Command(mesh))));
}

}  // namespace
}  // namespace raylift
