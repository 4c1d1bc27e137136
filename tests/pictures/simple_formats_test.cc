// Pictures small enough to be written byte by byte.

#include <array>
#include <string>
#include <string_view>

#include "pictures/picture_codec.h"
#include "support/matchers.h"
#include <gmock/gmock.h>

namespace raylift {
namespace {

using namespace std::string_view_literals;
using testing::ElementsAre;

std::string LittleEndian(std::initializer_list<std::array<uint32_t, 2>> numbers) {
  std::string bytes;
  for (const auto& [value, num_bytes] : numbers) {
    for (uint32_t k = 0; k < num_bytes; ++k) bytes += static_cast<char>(value >> (8 * k) & 0xFF);
  }
  return bytes;
}

std::vector<uint8_t> Rgb(std::string_view bytes) {
  return DecodePicture(bytes, ImageChannels::kRgb).data;
}
std::vector<uint8_t> Gray(std::string_view bytes) {
  return DecodePicture(bytes, ImageChannels::kGray).data;
}

TEST(Pnm, OfEveryKindReads) {
  EXPECT_THAT(Gray("P1\n# bits\n3 2\n101\n0 1 0\n"), ElementsAre(0, 255, 0, 255, 0, 255));
  EXPECT_THAT(Gray("P2 2 1 3\n1 3\n"), ElementsAre(85, 255));
  EXPECT_THAT(Rgb("P3\n1 1\n255\n1 2 3\n"), ElementsAre(1, 2, 3));
  EXPECT_THAT(Gray("P4 3 2\n\xA0\x40"sv), ElementsAre(0, 255, 0, 255, 0, 255));
  EXPECT_THAT(Rgb("P5 2 1 255\n\x07\xC8"sv), ElementsAre(7, 7, 7, 200, 200, 200));
  EXPECT_THAT(Gray("P5 3 1 65535\n\0\xFF\x01\0\xFF\xFF"sv), ElementsAre(0, 1, 255));
  EXPECT_THAT(Gray("P5 2 1 1023\n\x02\0\x03\xFF"sv), ElementsAre(128, 255));
  EXPECT_THAT(Rgb("P6 1 1 255 abc"), ElementsAre('a', 'b', 'c'));
}

TEST(Pnm, WhatIsDamagedIsNamed) {
  for (const std::string_view bytes :
       {"P5 2 1 255\na"sv, "P5 2 1 0\nab"sv, "P5 2 1 70000\nabcd"sv, "P3 1 1 255\n1 2"sv,
        "P3 1 1 255\n1 2 x"sv, "P1 2 1\n1"sv, "P1 2 1\n12"sv, "P4 9 1\na"sv, "P2 2 1"sv}) {
    EXPECT_TRUE(FailsWithInputError([&] { Rgb(bytes); }, {"damaged or truncated"})) << bytes;
  }
}

// The header of 40 bytes; the rows are stored from the last one unless the height is negative.
std::string Bmp(uint32_t width, int height, uint32_t bits, const std::string& palette,
                const std::string& rows, uint32_t compression = 0) {
  const auto offset = static_cast<uint32_t>(54 + palette.size());
  return "BM" +
         LittleEndian({{offset + static_cast<uint32_t>(rows.size()), 4},
                       {0, 4},
                       {offset, 4},
                       {40, 4},
                       {width, 4},
                       {static_cast<uint32_t>(height), 4},
                       {1, 2},
                       {bits, 2},
                       {compression, 4},
                       {static_cast<uint32_t>(rows.size()), 4},
                       {0, 4},
                       {0, 4},
                       {0, 4},
                       {0, 4}}) +
         palette + rows;
}

TEST(Bmp, OfEveryDepthReads) {
  const std::string palette("\x01\x02\x03\0\xFF\xFF\xFF\0", 8);
  EXPECT_THAT(Rgb(Bmp(2, 2, 1, palette, std::string("\x40\0\0\0\x80\0\0\0", 8))),
              ElementsAre(255, 255, 255, 3, 2, 1, 3, 2, 1, 255, 255, 255));
  EXPECT_THAT(Rgb(Bmp(2, 1, 4, palette + std::string(56, '\0'), std::string("\x10\0\0\0", 4))),
              ElementsAre(255, 255, 255, 3, 2, 1));
  EXPECT_THAT(Rgb(Bmp(2, 1, 8, palette + std::string(1016, '\0'), std::string("\0\x01\0\0", 4))),
              ElementsAre(3, 2, 1, 255, 255, 255));
  EXPECT_THAT(Rgb(Bmp(1, -2, 24, "", std::string("\x01\x02\x03\0\x04\x05\x06\0", 8))),
              ElementsAre(3, 2, 1, 6, 5, 4));
  EXPECT_THAT(Rgb(Bmp(1, 1, 32, "", "\x01\x02\x03\x04")), ElementsAre(3, 2, 1));
  const std::string masks = LittleEndian({{0xFF0000, 4}, {0xFF00, 4}, {0xFF, 4}});
  EXPECT_THAT(Rgb(Bmp(1, 1, 32, masks, "\x01\x02\x03\x04", 3)), ElementsAre(3, 2, 1));
}

TEST(Bmp, WhatIsNotReadIsNamed) {
  EXPECT_TRUE(FailsWithInputError([] { Rgb(Bmp(2, 1, 8, "", "abcd", 1)); },
                                  {"expected a BMP of 1, 4, 8, 24 or 32 bits", "compressed"}));
  EXPECT_TRUE(FailsWithInputError([] { Rgb(Bmp(2, 1, 16, "", "abcd")); }, {"found 16 bits"}));
  EXPECT_TRUE(FailsWithInputError([] { Rgb(Bmp(2, 1, 24, "", "abcdefg")); }, {"truncated"}));
  EXPECT_TRUE(FailsWithInputError([] { Rgb(Bmp(1, 1, 8, "", "a")); }, {"truncated"}));
}

TEST(Tiff, OrientationIsIgnored) {
  constexpr uint32_t kShort = 3, kLong = 4, kTurnedAround = 3;
  const auto tag = [](uint32_t name, uint32_t type, uint32_t value) {
    return LittleEndian({{name, 2}, {type, 2}, {1, 4}, {value, 4}});
  };
  const std::string tags = tag(256, kLong, 2) + tag(257, kLong, 1) + tag(258, kShort, 8) +
                           tag(259, kShort, 1) + tag(262, kShort, 1) + tag(273, kLong, 8) +
                           tag(274, kShort, kTurnedAround) + tag(277, kShort, 1) +
                           tag(278, kLong, 1) + tag(279, kLong, 2);
  const std::string bytes = std::string("II*\0\x0A\0\0\0\x07\xC8", 10) + LittleEndian({{10, 2}}) +
                            tags + std::string(4, '\0');
  EXPECT_THAT(Gray(bytes), ElementsAre(7, 200));
}

}  // namespace
}  // namespace raylift
