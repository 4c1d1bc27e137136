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

// EXIF in the order of bytes of a PC: the orientation alone.
std::string Turned(const std::string& jpeg) {
  const std::string exif("Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0",
                         32);
  return jpeg.substr(0, 2) + std::string("\xFF\xE1\0\x22", 4) + exif + jpeg.substr(2);
}

TEST(ImageSize, OfAnotherCameraIsNamedWithTheWayOut) {
  const auto file = TestFolder() / "a.jpg";
  WriteImage(file, Gray(64, 48));
  const auto fails = [&](int width_px, int height_px, const std::vector<std::string>& parts) {
    const Camera camera(CameraModel::kSimplePinhole, width_px, height_px,
                        std::vector<double>{100, 60, 50});
    return FailsWithInputError([&] { RequireSizeOf(camera, "a.jpg", ReadImageSize(file), file); },
                               parts);
  };
  EXPECT_TRUE(fails(128, 96,
                    {"a.jpg: the image is 64 x 48, its camera 128 x 96; scaled to the image it "
                     "is: a.jpg SIMPLE_PINHOLE 64 48 50 30 25"}));
  EXPECT_TRUE(fails(48, 64, {"64 x 48, its camera 48 x 64: turn the image"}));
  EXPECT_TRUE(fails(100, 100, {"64 x 48, its camera 100 x 100"}));
  WriteFile(file, Turned(ReadFile(file)));
  EXPECT_TRUE(fails(48, 64, {"64 x 48, its camera 48 x 64: EXIF turns it in viewers"}));
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
