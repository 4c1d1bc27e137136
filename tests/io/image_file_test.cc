#include "raylift/io/image_file.h"

#include "support/matchers.h"
#include "support/test_data.h"
#include <gmock/gmock.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

Image RandomImage(int width, int height, int channels) {
  Rng rng = TestRng();
  Image image{width, height, channels, {}};
  image.data.resize(static_cast<size_t>(width) * height * channels);
  for (uint8_t& value : image.data) {
    value = static_cast<uint8_t>(rng.UniformIndex(256));
  }
  return image;
}

TEST(ImageFile, PngKeepsEveryPixel) {
  const auto folder = TestFolder();
  for (const int channels : {1, 3}) {
    const Image image = RandomImage(17, 5, channels);
    WriteImage(folder / "x.PNG", image);
    const Image back =
        ReadImage(folder / "x.PNG", channels == 1 ? ImageChannels::kGray : ImageChannels::kRgb);
    EXPECT_EQ(back.width_px, 17);
    EXPECT_EQ(back.height_px, 5);
    EXPECT_EQ(back.channels, channels);
    EXPECT_EQ(back.data, image.data);
  }
}

TEST(ImageFile, ChannelsAreRedGreenBlueAndConvert) {
  const auto path = TestFolder() / "x.png";
  WriteImage(path, {2, 1, 3, {255, 0, 0, 0, 0, 255}});
  EXPECT_THAT(ReadImage(path, ImageChannels::kRgb).data,
              testing::ElementsAre(255, 0, 0, 0, 0, 255));
  // Luma of Rec. 601: 0.299 for red, 0.114 for blue.
  EXPECT_THAT(ReadImage(path, ImageChannels::kGray).data, testing::ElementsAre(76, 29));
  WriteImage(path, {2, 1, 1, {7, 200}});
  EXPECT_THAT(ReadImage(path, ImageChannels::kRgb).data,
              testing::ElementsAre(7, 7, 7, 200, 200, 200));
}

TEST(ImageFile, WhatIsTruncatedIsNamed) {
  const auto folder = TestFolder();
  for (const char* name : {"x.png", "x.jpg"}) {
    WriteImage(folder / name, RandomImage(60, 40, 3));
    const std::string whole = ReadFile(folder / name);
    for (const size_t length : {whole.size() - 1, whole.size() / 2, size_t{40}, size_t{12}}) {
      WriteFile(folder / name, whole.substr(0, length));
      EXPECT_TRUE(FailsWithInputError([&] { ReadImage(folder / name, ImageChannels::kRgb); },
                                      {name, "truncated"}))
          << length;
    }
    // What cameras add after the end is none of the image's.
    WriteFile(folder / name, whole + std::string(100, 'x'));
    EXPECT_EQ(ReadImage(folder / name, ImageChannels::kRgb).width_px, 60);
  }
}

TEST(ImageFile, OfAThumbnailTheEndIsNotTheImages) {
  const auto file = TestFolder() / "x.jpg";
  WriteImage(file, RandomImage(60, 40, 3));
  const std::string whole = ReadFile(file);
  const std::string segment("\xFF\xE1\x00\x06\xFF\xD8\xFF\xD9", 8);
  WriteFile(file, whole.substr(0, 2) + segment + whole.substr(2));
  EXPECT_EQ(ReadImage(file, ImageChannels::kRgb).height_px, 40);
  WriteFile(file, whole.substr(0, 2) + segment + whole.substr(2, whole.size() - 4));
  EXPECT_TRUE(FailsWithInputError([&] { ReadImage(file, ImageChannels::kRgb); }, {"truncated"}));
}

TEST(ImageFile, OrientationTagsAreIgnoredAnd16BitBecomes8) {
  if (!HasProgram("/usr/bin/python3")) GTEST_SKIP() << "python3 is not installed";
  const auto folder = TestFolder();
  WriteFile(folder / "write.py", R"(
import sys, struct, numpy as np, cv2
folder = sys.argv[1]
cv2.imwrite(folder + '/16.png', np.array([[0, 256, 65535]], np.uint16))
ok, data = cv2.imencode('.jpg', np.full((4, 8, 3), 100, np.uint8))
data = data.tobytes()
# An APP1 segment with the single tag Orientation = 6 (turn by 90 degrees).
tiff = b'II*\0' + struct.pack('<IHHHIHHI', 8, 1, 0x112, 3, 1, 6, 0, 0)
exif = b'Exif\0\0' + tiff
app1 = b'\xff\xe1' + struct.pack('>H', len(exif) + 2) + exif
open(folder + '/turned.jpg', 'wb').write(data[:2] + app1 + data[2:])
assert cv2.imread(folder + '/turned.jpg').shape[:2] == (8, 4)
)");
  RunProgram("/usr/bin/python3 " + (folder / "write.py").string() + " " + folder.string());
  const Image turned = ReadImage(folder / "turned.jpg", ImageChannels::kGray);
  EXPECT_EQ(turned.width_px, 8);
  EXPECT_EQ(turned.height_px, 4);
  EXPECT_THAT(ReadImage(folder / "16.png", ImageChannels::kGray).data,
              testing::ElementsAre(0, 1, 255));
}

TEST(ImageFile, JpegQualityCounts) {
  const auto folder = TestFolder();
  const Image image = RandomImage(64, 64, 3);
  WriteImage(folder / "good.jpg", image, 98);
  WriteImage(folder / "small.jpeg", image, 30);
  EXPECT_LT(2 * std::filesystem::file_size(folder / "small.jpeg"),
            std::filesystem::file_size(folder / "good.jpg"));
  EXPECT_EQ(ReadImage(folder / "good.jpg", ImageChannels::kRgb).width_px, 64);
}

TEST(ImageFile, WhatIsNoImageIsNamed) {
  const auto folder = TestFolder();
  const auto read = [&](const std::string& name) { ReadImage(folder / name, ImageChannels::kRgb); };
  EXPECT_TRUE(FailsWithInputError([&] { read("none.png"); }, {"none.png: no such file"}));
  WriteFile(folder / "empty.png", "");
  EXPECT_TRUE(FailsWithInputError([&] { read("empty.png"); }, {"empty.png: expected an image"}));
  WriteFile(folder / "text.png", "this is no image");
  EXPECT_TRUE(FailsWithInputError([&] { read("text.png"); }, {"text.png: expected an image"}));
  EXPECT_TRUE(FailsWithInputError([&] { WriteImage(folder / "x.foo", RandomImage(2, 2, 1)); },
                                  {"x.foo: images are written as .png, .jpg or .jpeg only"}));
}

}  // namespace
}  // namespace raylift
