#include <algorithm>

#include "program.h"
#include "support/test_data.h"

#include "raylift/base/file.h"
#include "raylift/io/depth_file.h"

namespace raylift {
namespace {

namespace fs = std::filesystem;

Arguments Perturb(const RoomScene& scene, const fs::path& out) {
  return {"perturb", "--model", scene.model(), "--geometry", "mesh:" + scene.mesh().string(),
          "--out",   out};
}

TEST(Perturb, WritesMapsOfEveryFormatThatItReadsAgain) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path clean = scene.folder / "clean";
  ASSERT_TRUE(Succeeds(RunRaylift(Perturb(scene, clean))));
  for (const std::string format : {"npy", "npz", "png", "tiff", "pfm", "bin"}) {
    const fs::path out = scene.folder / format;
    const CommandResult result =
        RunRaylift({"perturb", "--model", scene.model(), "--geometry", "depth:" + clean.string(),
                    "--out", out, "--format", format, "--scale", "2"});
    ASSERT_TRUE(Succeeds(result));
    for (const PosedImage& reference : scene.references) {
      const auto before = ReadDepthFile(clean / fs::path(reference.name).replace_extension(".npy"));
      const auto after = ReadDepthFile(out / fs::path(reference.name).replace_extension(format));
      const double unit = after.sample_type == "uint16" ? 0.001 : 1;
      ASSERT_EQ(before.values.size(), after.values.size());
      for (size_t i = 0; i < before.values.size(); i += 97) {
        // Half a millimeter for what is stored in integers.
        EXPECT_NEAR(unit * static_cast<double>(after.values[i]),
                    2 * static_cast<double>(before.values[i]), 6e-4)
            << format;
      }
    }
  }
}

TEST(Perturb, WritesConfidencesBesideTheMaps) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path out = scene.folder / "network";
  ASSERT_TRUE(Succeeds(RunRaylift(Perturb(scene, out) +
                                  Arguments{"--bubbles", "3", "--confidences", "informative"})));
  for (const PosedImage& reference : scene.references) {
    const auto file = fs::path(reference.name).replace_extension(".npy");
    EXPECT_EQ(ReadDepthFile(out / "confidence" / file).values.size(),
              ReadDepthFile(out / file).values.size());
  }
}

TEST(Perturb, TheSameBytesForAnyNumberOfThreads) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const Arguments noise = {"--noise", "0.01", "--warp", "0.02", "--floaters", "5"};
  const fs::path one = scene.folder / "one", two = scene.folder / "two";
  ASSERT_TRUE(Succeeds(RunRaylift(Perturb(scene, one) + noise + Arguments{"--threads", "1"})));
  ASSERT_TRUE(Succeeds(RunRaylift(Perturb(scene, two) + noise + Arguments{"--threads", "2"})));
  for (const PosedImage& reference : scene.references) {
    const auto file = fs::path(reference.name).replace_extension(".npy");
    EXPECT_EQ(ReadFile(one / file), ReadFile(two / file));
  }
}

// A map three pixels off, and that of the next image.
TEST(Perturb, ShiftsMapsAndTakesThoseOfOtherFrames) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path clean = scene.folder / "clean", off = scene.folder / "off",
                 late = scene.folder / "late";
  ASSERT_TRUE(Succeeds(RunRaylift(Perturb(scene, clean))));
  ASSERT_TRUE(Succeeds(RunRaylift(Perturb(scene, off) + Arguments{"--shift", "3,-1"})));
  ASSERT_TRUE(Succeeds(RunRaylift(Perturb(scene, late) + Arguments{"--time-offset", "1"})));
  std::vector<std::string> names;
  for (const PosedImage& reference : scene.references) {
    names.push_back(fs::path(reference.name).replace_extension(".npy"));
  }
  std::sort(names.begin(), names.end());
  const auto before = ReadDepthFile(clean / names[0]), after = ReadDepthFile(off / names[0]);
  const auto at = [&](const auto& map, int x, int y) {
    return map.values[static_cast<size_t>(y) * static_cast<size_t>(map.width_px) +
                      static_cast<size_t>(x)];
  };
  for (int y = 10; y < 50; y += 7) {
    for (int x = 10; x < 50; ++x) EXPECT_NEAR(at(after, x + 3, y - 1), at(before, x, y), 1e-5);
  }
  EXPECT_EQ(ReadFile(late / names[0]), ReadFile(clean / names[1]));
  EXPECT_FALSE(fs::exists(late / names.back()));
}

TEST(Perturb, BadOptionsAreTold) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path out = scene.folder / "out";
  EXPECT_TRUE(
      FailsWith(2, {"--noise = -1"}, RunRaylift(Perturb(scene, out) + Arguments{"--noise", "-1"})));
  EXPECT_TRUE(
      FailsWith(2, {"--zoom = 0"}, RunRaylift(Perturb(scene, out) + Arguments{"--zoom", "0"})));
  EXPECT_TRUE(
      FailsWith(2, {"--rotate"}, RunRaylift(Perturb(scene, out) + Arguments{"--rotate", "1,2"})));
  EXPECT_TRUE(FailsWith(2, {"--quantize-bits = 40", "between 1 and 16"},
                        RunRaylift(Perturb(scene, out) + Arguments{"--quantize-bits", "40"})));
  EXPECT_TRUE(FailsWith(2, {"--format = gif"},
                        RunRaylift(Perturb(scene, out) + Arguments{"--format", "gif"})));
  EXPECT_FALSE(fs::exists(out));
}

}  // namespace
}  // namespace raylift
