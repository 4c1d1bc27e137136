#include "pictures/exif.h"

#include <sstream>
#include <string>
#include <vector>

#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

enum class ByteOrder { kLittle, kBig };

struct Entry {
  int tag, type;
  uint32_t value;
};

// Writes numbers of either byte order, one behind the other.
class Writer {
 public:
  explicit Writer(ByteOrder order) : order_(order) {}

  void Number(uint32_t value, int num_bytes) {
    for (int i = 0; i < num_bytes; ++i) {
      const int byte = order_ == ByteOrder::kBig ? num_bytes - 1 - i : i;
      text += static_cast<char>(value >> (8 * byte) & 0xFF);
    }
  }
  void Directory(const std::vector<Entry>& entries) {
    Number(static_cast<uint32_t>(entries.size()), 2);
    for (const Entry& entry : entries) {
      Number(static_cast<uint32_t>(entry.tag), 2);
      Number(static_cast<uint32_t>(entry.type), 2);
      Number(1, 4);
      Number(entry.value, entry.type == 3 ? 2 : 4);
      if (entry.type == 3) Number(0, 2);
    }
    Number(0, 4);
  }

  std::string text;

 private:
  ByteOrder order_;
};

// A JPEG's header with a turned photograph of a 4.2 mm lens, 26 mm on film, 5000 pixels per cm.
std::string Jpeg(ByteOrder order) {
  constexpr uint32_t kCameraAt = 38, kFractionsAt = kCameraAt + 2 + 4 * 12 + 4;
  Writer tiff(order);
  tiff.text = order == ByteOrder::kBig ? "MM" : "II";
  tiff.Number(42, 2);
  tiff.Number(8, 4);
  tiff.Directory({{0x0112, 3, 6}, {0x8769, 4, kCameraAt}});
  tiff.Directory(
      {{0x920A, 5, kFractionsAt}, {0xA20E, 5, kFractionsAt + 8}, {0xA210, 3, 3}, {0xA405, 3, 26}});
  for (const uint32_t number : {42u, 10u, 5000u, 1u}) tiff.Number(number, 4);
  Writer jpeg(ByteOrder::kBig);
  jpeg.Number(0xFFD8FFE0, 4);  // a segment before that of EXIF
  jpeg.Number(4, 2);
  jpeg.Number(0, 2);
  jpeg.Number(0xFFE1, 2);
  jpeg.Number(static_cast<uint32_t>(2 + 6 + tiff.text.size()), 2);
  return jpeg.text + std::string("Exif\0\0", 6) + tiff.text;
}

Exif Read(const std::string& bytes) {
  std::istringstream file(bytes);
  return ReadExif(file);
}

TEST(Exif, IsReadInEitherByteOrder) {
  for (const ByteOrder order : {ByteOrder::kLittle, ByteOrder::kBig}) {
    const Exif exif = Read(Jpeg(order));
    EXPECT_EQ(exif.orientation, 6);
    EXPECT_TRUE(exif.SwapsSides());
    EXPECT_EQ(exif.focal_mm, 4.2);
    EXPECT_EQ(exif.focal_35mm, 26);
    EXPECT_EQ(exif.pixels_per_mm, 500);
  }
}

TEST(Exif, DamageIsNothingKnown) {
  const std::string whole = Jpeg(ByteOrder::kLittle);
  for (size_t size = 0; size + 1 < whole.size(); ++size) {
    const Exif exif = Read(whole.substr(0, size));
    EXPECT_EQ(exif.orientation, 1) << size;
    EXPECT_FALSE(exif.focal_mm) << size;
  }
  // Any byte may be wrong.
  Rng rng = TestRng();
  for (int i = 0; i < 2000; ++i) {
    std::string damaged = whole;
    damaged[rng.UniformIndex(static_cast<uint32_t>(whole.size()))] =
        static_cast<char>(rng.UniformIndex(256));
    const Exif exif = Read(damaged);
    EXPECT_GE(exif.orientation, 1);
    EXPECT_LE(exif.orientation, 8);
    EXPECT_GT(exif.focal_mm.value_or(1), 0);
  }
}

}  // namespace
}  // namespace raylift
