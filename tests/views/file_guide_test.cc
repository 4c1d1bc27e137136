#include "views/job_files.h"
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "raylift/base/text.h"

namespace raylift {
namespace {

TEST(FileGuide, HasEveryProductInEveryFormatAndFitsATerminal) {
  const std::string guide = FileGuide();
  for (const Product product : AllValues<Product>()) {
    const size_t at = guide.find(fmt::format("\n{}: ", ToString(product)));
    ASSERT_NE(at, std::string::npos) << ToString(product);
    const std::string section = guide.substr(at, guide.find("\n\n", at + 1) - at);
    for (const std::string_view format : FormatsOf(product)) {
      EXPECT_NE(section.find(fmt::format("\n  .{}: ", format)), std::string::npos)
          << ToString(product) << " " << format;
    }
  }
  for (const std::string_view line : SplitBy(guide, '\n')) EXPECT_LE(line.size(), 105u) << line;
}

TEST(FileGuide, TellsWhatTheOptionsMakeOfTheFiles) {
  StorageOptions storage;
  storage.floats.png_step = 0.25;
  storage.floats.sample = FloatSample::kFloat16;
  const ProductOutput outputs[] = {
      {Product::kDepth, "png"}, {Product::kNormals, "npy"}, {Product::kDistance, "exr"}};
  const std::string guide = FileGuide(outputs, storage, FrameOptions::NormalsIn::kCamera);
  EXPECT_TRUE(guide.starts_with(kFileGuideTitle));
  EXPECT_NE(guide.find("value times 0.25"), std::string::npos) << guide;
  EXPECT_NE(guide.find("float16 (height, width, 3)"), std::string::npos) << guide;
  EXPECT_NE(guide.find("the camera's frame"), std::string::npos) << guide;
  EXPECT_NE(guide.find("channel Y, float16"), std::string::npos) << guide;
  EXPECT_EQ(guide.find("triangle:"), std::string::npos) << guide;
}

}  // namespace
}  // namespace raylift
