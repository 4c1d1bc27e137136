// Against OpenCV, which reads the same formats by the same libraries.

#include "pictures/picture_codec.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>
#include <jpeglib.h>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

namespace raylift {
namespace {

// A photograph's likes: smooth, with noise and edges.
cv::Mat Scene(int type, int width = 61, int height = 43) {
  Rng rng = TestRng();
  cv::Mat picture(height, width, CV_8UC(CV_MAT_CN(type)));
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int k = 0; k < picture.channels(); ++k) {
        const int edge = (x / 9 + y / 7) % 2 * 60;
        picture.ptr(y, x)[k] = static_cast<uint8_t>(x + 2 * y * k % 90 + edge +
                                                    static_cast<int>(rng.UniformIndex(16)));
      }
    }
  }
  if (CV_MAT_DEPTH(type) == CV_8U) return picture;
  cv::Mat deep;
  picture.convertTo(deep, type, 256.7);
  return deep;
}

std::string EncodedByOpenCv(const char* extension, const cv::Mat& picture,
                            const std::vector<int>& options = {}) {
  std::vector<uint8_t> bytes;
  EXPECT_TRUE(cv::imencode(extension, picture, bytes, options));
  return {bytes.begin(), bytes.end()};
}

Image DecodedByOpenCv(std::string bytes, ImageChannels channels) {
  cv::Mat picture = cv::imdecode(cv::Mat(1, static_cast<int>(bytes.size()), CV_8U, bytes.data()),
                                 cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION);
  const bool is_gray = channels == ImageChannels::kGray;
  cv::cvtColor(picture, picture, is_gray ? cv::COLOR_BGR2GRAY : cv::COLOR_BGR2RGB);
  return {picture.cols, picture.rows, picture.channels(), {picture.datastart, picture.dataend}};
}

int LargestDifference(const Image& a, const Image& b) {
  EXPECT_EQ(a.width_px, b.width_px);
  EXPECT_EQ(a.height_px, b.height_px);
  EXPECT_EQ(a.channels, b.channels);
  if (a.data.size() != b.data.size()) return 255;
  int largest = 0;
  for (size_t i = 0; i < a.data.size(); ++i) {
    largest = std::max(largest, std::abs(int{a.data[i]} - int{b.data[i]}));
  }
  return largest;
}

// OpenCV rounds the gray of colors in another way.
void ExpectAsOpenCv(const std::string& bytes) {
  EXPECT_EQ(LargestDifference(DecodePicture(bytes, ImageChannels::kRgb),
                              DecodedByOpenCv(bytes, ImageChannels::kRgb)),
            0);
  const Image gray = DecodePicture(bytes, ImageChannels::kGray);
  EXPECT_LE(LargestDifference(gray, DecodedByOpenCv(bytes, ImageChannels::kGray)), 1);
  EXPECT_EQ(gray.data, ToGray(DecodePicture(bytes, ImageChannels::kRgb)).data);
}

TEST(PictureCodec, JpegsHaveThePixelsThatOpenCvFinds) {
  for (const int type : {CV_8UC1, CV_8UC3}) {
    for (const int quality : {30, 92, 100}) {
      for (const int progressive : {0, 1}) {
        SCOPED_TRACE(testing::Message() << type << " " << quality << " " << progressive);
        ExpectAsOpenCv(EncodedByOpenCv(
            ".jpg", Scene(type),
            {cv::IMWRITE_JPEG_QUALITY, quality, cv::IMWRITE_JPEG_PROGRESSIVE, progressive}));
      }
    }
  }
}

// As print shops keep them.
std::string CmykJpeg() {
  jpeg_error_mgr errors;
  jpeg_compress_struct jpeg;
  jpeg.err = jpeg_std_error(&errors);
  jpeg_create_compress(&jpeg);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&jpeg, &bytes, &size);
  jpeg.image_width = 16;
  jpeg.image_height = 8;
  jpeg.input_components = 4;
  jpeg.in_color_space = JCS_CMYK;
  jpeg_set_defaults(&jpeg);
  jpeg_start_compress(&jpeg, TRUE);
  std::vector<uint8_t> pixels(16 * 4);
  for (size_t i = 0; i < pixels.size(); ++i) pixels[i] = static_cast<uint8_t>(3 * i + 20);
  for (JSAMPROW row = pixels.data(); jpeg.next_scanline < 8;) jpeg_write_scanlines(&jpeg, &row, 1);
  jpeg_finish_compress(&jpeg);
  jpeg_destroy_compress(&jpeg);
  const std::string result(reinterpret_cast<const char*>(bytes), size);
  std::free(bytes);
  return result;
}

TEST(PictureCodec, JpegsOfFourInksHaveThePixelsThatOpenCvFinds) { ExpectAsOpenCv(CmykJpeg()); }

TEST(PictureCodec, PngsHaveThePixelsThatOpenCvFinds) {
  for (const int type : {CV_8UC1, CV_8UC3, CV_8UC4, CV_16UC1, CV_16UC3, CV_16UC4}) {
    SCOPED_TRACE(type);
    ExpectAsOpenCv(EncodedByOpenCv(".png", Scene(type)));
  }
  ExpectAsOpenCv(EncodedByOpenCv(".png", Scene(CV_8UC1), {cv::IMWRITE_PNG_BILEVEL, 1}));
}

TEST(PictureCodec, OtherFormatsHaveThePixelsThatOpenCvFinds) {
  for (const int type : {CV_8UC1, CV_8UC3}) {
    SCOPED_TRACE(type);
    for (const char* extension : {".bmp", ".tiff", ".webp"}) {
      SCOPED_TRACE(extension);
      ExpectAsOpenCv(EncodedByOpenCv(extension, Scene(type)));
    }
    const char* netpbm = type == CV_8UC1 ? ".pgm" : ".ppm";
    for (const int binary : {0, 1}) {
      ExpectAsOpenCv(EncodedByOpenCv(netpbm, Scene(type), {cv::IMWRITE_PXM_BINARY, binary}));
    }
  }
  for (const int type : {CV_8UC4, CV_16UC1, CV_16UC3}) {
    SCOPED_TRACE(type);
    ExpectAsOpenCv(EncodedByOpenCv(".tiff", Scene(type)));
  }
  ExpectAsOpenCv(EncodedByOpenCv(".webp", Scene(CV_8UC3), {cv::IMWRITE_WEBP_QUALITY, 101}));
}

TEST(PictureCodec, WhatIsEncodedOpenCvReads) {
  for (const int channels : {1, 3}) {
    const cv::Mat scene = Scene(CV_8UC(channels));
    const Image image{scene.cols, scene.rows, channels, {scene.datastart, scene.dataend}};
    const auto kind = channels == 1 ? ImageChannels::kGray : ImageChannels::kRgb;
    EXPECT_EQ(DecodedByOpenCv(EncodePng(image), kind).data, image.data);
    const std::string jpeg = EncodeJpeg(image, 100);
    // The last bits are lost to rounding, and colors to having half the resolution.
    const Image back = DecodedByOpenCv(jpeg, kind);
    EXPECT_LE(LargestDifference(back, image), channels == 1 ? 3 : 120);
    EXPECT_EQ(DecodePicture(jpeg, kind).data, back.data);
    EXPECT_LT(2 * EncodeJpeg(image, 30).size(), jpeg.size());
  }
}

TEST(PictureCodec, OpacityIsKept) {
  const cv::Mat scene = Scene(CV_8UC4);
  std::string png = EncodePng({scene.cols, scene.rows, 4, {scene.datastart, scene.dataend}});
  cv::Mat back = cv::imdecode(cv::Mat(1, static_cast<int>(png.size()), CV_8U, png.data()),
                              cv::IMREAD_UNCHANGED);
  ASSERT_EQ(back.channels(), 4);
  cv::cvtColor(back, back, cv::COLOR_BGRA2RGBA);
  EXPECT_TRUE(std::equal(back.datastart, back.dataend, scene.datastart, scene.dataend));
}

TEST(PictureCodec, WhatIsDamagedIsNamed) {
  for (const char* extension : {".png", ".bmp", ".tiff", ".webp", ".ppm"}) {
    const std::string bytes = EncodedByOpenCv(extension, Scene(CV_8UC3));
    for (const size_t length : {size_t{3}, size_t{40}, bytes.size() / 2, bytes.size() - 200}) {
      EXPECT_TRUE(FailsWithInputError(
          [&] { DecodePicture(bytes.substr(0, length), ImageChannels::kRgb); }, {}))
          << extension << " " << length;
    }
  }
  using namespace std::string_literals;
  for (const auto& [bytes, found] : {std::pair{"no image"s, "found something else"},
                                     {""s, "found no bytes"},
                                     {"\0\0\0\x18"s
                                      "ftypheic\0\0\0\0mif1heic"s,
                                      "found HEIC"},
                                     {"\0\0\0\x20"s
                                      "ftypavif\0\0\0\0"s,
                                      "found AVIF"},
                                     {"GIF89a"s, "found GIF"}}) {
    EXPECT_TRUE(FailsWithInputError([&] { DecodePicture(bytes, ImageChannels::kRgb); },
                                    {"expected an image (PNG, JPEG", found}));
  }
}

}  // namespace
}  // namespace raylift
