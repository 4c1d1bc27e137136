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
      const auto before = ReadDepthFile(clean / fs::path(reference.name).replace_extension(".exr"));
      const auto after = ReadDepthFile(out / fs::path(reference.name).replace_extension(format));
      const double unit = after.sample_type == "uint16" ? 0.001 : 1;
      ASSERT_EQ(before.values.size(), after.values.size());
      for (size_t i = 0; i < before.values.size(); i += 97) {
        // Half a millimetre for what is stored in integers.
        EXPECT_NEAR(unit * static_cast<double>(after.values[i]),
                    2 * static_cast<double>(before.values[i]), 6e-4)
            << format;
      }
    }
  }
}

TEST(Perturb, TheSameBytesForAnyNumberOfThreads) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const Arguments noise = {"--noise", "0.01", "--warp", "0.02", "--floaters", "5"};
  const fs::path one = scene.folder / "one", two = scene.folder / "two";
  ASSERT_TRUE(Succeeds(RunRaylift(Perturb(scene, one) + noise + Arguments{"--threads", "1"})));
  ASSERT_TRUE(Succeeds(RunRaylift(Perturb(scene, two) + noise + Arguments{"--threads", "2"})));
  for (const PosedImage& reference : scene.references) {
    const auto file = fs::path(reference.name).replace_extension(".exr");
    EXPECT_EQ(ReadFile(one / file), ReadFile(two / file));
  }
}

TEST(Perturb, BadOptionsAreTold) {
  const RoomScene scene = WriteRoomScene(TestFolder());
  const fs::path out = scene.folder / "out";
  EXPECT_TRUE(
      FailsWith(2, {"--noise = -1"}, RunRaylift(Perturb(scene, out) + Arguments{"--noise", "-1"})));
  EXPECT_TRUE(FailsWith(2, {"--format = gif"},
                        RunRaylift(Perturb(scene, out) + Arguments{"--format", "gif"})));
  EXPECT_FALSE(fs::exists(out));
}

}  // namespace
}  // namespace raylift
