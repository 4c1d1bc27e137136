// color: a bare mesh gets the photographs' colors.

#include <cmath>
#include <span>
#include <vector>

#include "apps/program.h"
#include "base/statistics.h"
#include "support/room_scene.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/io/image_file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

class Color : public ::testing::Test {
 protected:
  Arguments Command(const std::string& mesh) const {
    return {"color", mesh, "--model", scene_.model(), "--images", scene_.images(), "--out", out_};
  }

  RoomScene scene_ = WriteRoomScene(TestFolder(), {.matches = false, .pictures = true});
  fs::path out_ = scene_.folder / "colored.ply";
};

TEST_F(Color, TheMeshLooksLikePhotographsOfOtherPlaces) {
  const CommandResult result = RunRaylift(Command(scene_.mesh()) + Arguments{"--max-edge", "0.02"});
  ASSERT_TRUE(Succeeds(result));
  EXPECT_NE(result.out.find("colored by 6 photographs"), std::string::npos) << result.out;
  const fs::path rendered = scene_.folder / "rendered";
  ASSERT_TRUE(
      Succeeds(RunRaylift({"render", "--geometry", "mesh:" + out_.string(), "--model",
                           scene_.truth(), "--products", "color", "--out", rendered, "--quiet"})));
  for (const PosedImage& query : scene_.queries) {
    const Image photograph = ReadImage(scene_.images() / query.name, ImageChannels::kRgb);
    const Image view =
        ReadImage((rendered / "color" / query.name).replace_extension(".png"), ImageChannels::kRgb);
    ASSERT_EQ(view.data.size(), photograph.data.size());
    std::vector<int> differences;
    for (size_t i = 0; i < view.data.size(); ++i) {
      differences.push_back(std::abs(view.data[i] - photograph.data[i]));
    }
    EXPECT_LT(UpperMedianInPlace(std::span(differences)), 8) << query.name;
  }
}

TEST_F(Color, SaysWhereVerticesAreTooFewAndWhatIsWrong) {
  const CommandResult coarse = RunRaylift(Command(scene_.mesh()));
  EXPECT_EQ(coarse.exit_code, 0);
  EXPECT_NE(coarse.err.find("--max-edge"), std::string::npos) << coarse.err;
  EXPECT_TRUE(FailsWith(3, {"sees a vertex", "of one world?"},
                        RunRaylift(Command("mesh:" + scene_.mesh().string() + ",shift=900/0/0"))));
  EXPECT_TRUE(FailsWith(2, {"--max-edge", "must not be negative"},
                        RunRaylift(Command(scene_.mesh()) + Arguments{"--max-edge=-1"})));
  EXPECT_TRUE(FailsWith(2, {"--max-edge", "triangles"},
                        RunRaylift(Command(scene_.mesh()) + Arguments{"--max-edge", "1e-5"})));
  fs::remove(scene_.images() / scene_.references[2].name);
  EXPECT_TRUE(FailsWith(3, {scene_.references[2].name}, RunRaylift(Command(scene_.mesh()))));
}

}  // namespace
}  // namespace raylift
