#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>

#include "raylift/base/file.h"
#include "raylift/io/image_file.h"

namespace raylift {
namespace {

Image Gray(int width_px, int height_px) {
  return {width_px, height_px, 1,
          std::vector<uint8_t>(static_cast<size_t>(width_px) * static_cast<size_t>(height_px), 90)};
}

TEST(ImageSize, IsThatOfTheDecodedPicture) {
  for (const char* name : {"a.png", "a.jpg"}) {
    const auto file = TestFolder() / name;
    WriteImage(file, Gray(300, 7));
    const PlaneSize size = ReadImageSize(file);
    EXPECT_EQ(size.width_px, 300) << name;
    EXPECT_EQ(size.height_px, 7) << name;
  }
}

// OpenCV writes what Raylift only reads.
TEST(ImageSize, OfEveryFormatIsThatOfTheDecodedPicture) {
  const cv::Mat picture(7, 300, CV_8UC3, cv::Scalar(10, 100, 200));
  for (const char* name : {"a.bmp", "a.tiff", "a.webp", "a.ppm", "a.png", "a.jpg"}) {
    const auto file = TestFolder() / name;
    ASSERT_TRUE(cv::imwrite(file.string(), picture)) << name;
    EXPECT_EQ(ReadImageSize(file), (PlaneSize{300, 7})) << name;
    const Image image = ReadImage(file, ImageChannels::kRgb);
    EXPECT_EQ((PlaneSize{image.width_px, image.height_px}), (PlaneSize{300, 7})) << name;
  }
  const auto lossless = TestFolder() / "lossless.webp";
  ASSERT_TRUE(cv::imwrite(lossless.string(), picture, {cv::IMWRITE_WEBP_QUALITY, 101}));
  EXPECT_EQ(ReadImageSize(lossless), (PlaneSize{300, 7}));
}

TEST(ImageSize, LongSegmentsBeforeTheFrameAreSkipped) {
  const auto file = TestFolder() / "exif.jpg";
  WriteImage(file, Gray(64, 48));
  const std::string jpeg = ReadFile(file);
  const std::string segment = std::string("\xFF\xE1\xFF\xF0", 4) + std::string(0xFFF0 - 2, '\xC0');
  WriteFile(file, jpeg.substr(0, 2) + segment + segment + jpeg.substr(2));
  EXPECT_EQ(ReadImageSize(file).width_px, 64);
  EXPECT_EQ(ReadImageSize(file).height_px, 48);
}

TEST(ImageSize, WhatIsNoImageIsNamed) {
  const auto file = TestFolder() / "a.png";
  EXPECT_TRUE(FailsWithInputError([&] { ReadImageSize(file); }, {"a.png"}));
  for (const std::string& text : {std::string("nothing"), std::string("\xFF\xD8\xFF\xE1"),
                                  std::string("\x89PNG\r\n\x1A\n\0\0", 10), std::string()}) {
    WriteFile(file, text);
    EXPECT_TRUE(FailsWithInputError([&] { ReadImageSize(file); }, {"a.png"}));
  }
  EXPECT_TRUE(FailsWithInputError([&] { ReadImageSize(TestFolder()); }, {}));
}

}  // namespace
}  // namespace raylift
