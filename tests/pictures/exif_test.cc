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
  uint32_t count = 1;
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
      Number(entry.count, 4);
      // Of letters, bytes and short numbers the first bytes.
      const int num_bytes = entry.type < 3 ? 1 : entry.type == 3 ? 2 : 4;
      Number(entry.value, num_bytes);
      for (int i = num_bytes; i < 4; ++i) Number(0, 1);
    }
    Number(0, 4);
  }

  std::string text;

 private:
  ByteOrder order_;
};

// A JPEG's header with a turned photograph of a 4.2 mm lens, 26 mm on film, 5000 pixels per cm, at
// 22 deg 54' 36" south, 15 deg 0' 9" east and 12.5 m below the sea, looking to magnetic west.
std::string Jpeg(ByteOrder order) {
  constexpr uint32_t kCameraAt = 50, kGpsAt = kCameraAt + 2 + 4 * 12 + 4,
                     kFractionsAt = kGpsAt + 2 + 9 * 12 + 4;
  Writer tiff(order);
  tiff.text = order == ByteOrder::kBig ? "MM" : "II";
  tiff.Number(42, 2);
  tiff.Number(8, 4);
  tiff.Directory({{0x0112, 3, 6}, {0x8769, 4, kCameraAt}, {0x8825, 4, kGpsAt}});
  tiff.Directory(
      {{0x920A, 5, kFractionsAt}, {0xA20E, 5, kFractionsAt + 8}, {0xA210, 3, 3}, {0xA405, 3, 26}});
  tiff.Directory({{1, 2, 'S', 2},
                  {2, 5, kFractionsAt + 16, 3},
                  {3, 2, 'E', 2},
                  {4, 5, kFractionsAt + 40, 3},
                  {5, 1, 1},
                  {6, 5, kFractionsAt + 64},
                  {16, 2, 'M', 2},
                  {17, 5, kFractionsAt + 72},
                  {31, 5, kFractionsAt + 80}});
  for (const uint32_t number : {42u, 10u, 5000u, 1u, 22u, 1u,  54u, 1u,   36u, 1u,  15u,
                                1u,  0u,  1u,    9u, 1u,  25u, 2u,  270u, 1u,  13u, 2u}) {
    tiff.Number(number, 4);
  }
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
    EXPECT_EQ(exif.lens.film_mm, 26);
    EXPECT_EQ(exif.pixels_per_mm, 500);
    ASSERT_TRUE(exif.gps);
    EXPECT_DOUBLE_EQ(exif.gps->latitude_deg, -22.91);
    EXPECT_DOUBLE_EQ(exif.gps->longitude_deg, 15.0025);
    EXPECT_EQ(exif.gps->altitude_m, -12.5);
    EXPECT_EQ(exif.gps->direction_deg, 270);
    EXPECT_TRUE(exif.gps->direction_is_magnetic);
    EXPECT_EQ(exif.gps->horizontal_error_m, 6.5);
  }
}

TEST(Exif, SecondsMayBeLeftOut) {
  std::string bytes = Jpeg(ByteOrder::kBig);
  const std::string seconds("\0\0\0\x24\0\0\0\x01", 8);
  const size_t at = bytes.find(seconds);
  ASSERT_NE(at, std::string::npos);
  bytes.replace(at, 8, 8, '\0');
  const auto gps = Read(bytes).gps;
  ASSERT_TRUE(gps);
  EXPECT_DOUBLE_EQ(gps->latitude_deg, -22.9);
  bytes.replace(at - 8, 8, 8, '\0');
  EXPECT_FALSE(Read(bytes).gps) << "minutes may not";
}

TEST(Exif, OfWhatIsNoJpegNothingIsRead) {
  EXPECT_FALSE(Read("\x89PNG\r\n").is_jpeg);
  EXPECT_TRUE(Read(Jpeg(ByteOrder::kBig)).is_jpeg);
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

TEST(Xmp, DronesTagsAreAttributesOrElements) {
  const std::string begin =
      "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"><rdf:RDF "
      "xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\"><rdf:Description ";
  const std::string end = "</rdf:Description></rdf:RDF></x:xmpmeta>";
  const auto tags = ParseDroneTags(
      begin +
      "drone-dji:GimbalYawDegree=\"+46.00\" drone-dji:RtkFlag=\"50\" drone-dji:RtkStdLon=\"0.01\" "
      "drone-dji:RtkStdLat=\"0.02\" drone-dji:RtkStdHgt=\"0.03\" tiff:Make=\"DJI\">"
      "<drone-dji:GimbalPitchDegree> -89.9 </drone-dji:GimbalPitchDegree>"
      "<drone-dji:GimbalRollDegree>level</drone-dji:GimbalRollDegree>" +
      end);
  ASSERT_TRUE(tags);
  EXPECT_EQ(tags->yaw_deg, 46);
  EXPECT_EQ(tags->pitch_deg, -89.9);
  EXPECT_FALSE(tags->roll_deg);
  EXPECT_EQ(tags->rtk_sigma_m, Eigen::Vector3d(0.01, 0.02, 0.03));
  EXPECT_FALSE(tags->range_m || tags->calibration);
  const auto measured = [&](const std::string& more) {
    return *ParseDroneTags(
        begin +
        "drone-dji:LRFTargetDistance=\"41.250\" drone-dji:DewarpData=\"2022-06-08;3713.5,3714,7,"
        "-8.5,-0.11,+0.01,0.001,-0.002,-0.02\"" +
        more + ">" + end);
  };
  EXPECT_EQ(measured("").range_m, 41.25);
  EXPECT_EQ(measured("").calibration,
            (std::array{3713.5, 3714.0, 7.0, -8.5, -0.11, 0.01, 0.001, -0.002, -0.02}));
  EXPECT_EQ(measured(" drone-dji:DewarpFlag=\"1\"").calibration,
            (std::array{3713.5, 3714.0, 7.0, -8.5, 0.0, 0.0, 0.0, 0.0, 0.0}))
      << "its distortion is taken off";
  const auto none = ParseDroneTags(
      begin + "a:LRFTargetDistance=\"0\" a:DewarpData=\"2022-06-08;0,0,0,0,0,0,0,0,0\">" + end);
  EXPECT_FALSE(none->range_m || none->calibration);
  EXPECT_FALSE(ParseDroneTags(begin + "a:Make=\"Canon\">" + end));
  EXPECT_FALSE(ParseDroneTags("<x:xmpmeta"));
  EXPECT_FALSE(ParseDroneTags(""));
}

}  // namespace
}  // namespace raylift
