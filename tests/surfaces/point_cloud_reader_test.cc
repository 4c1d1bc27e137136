// ReadPointCloud on every format; bytes as their specifications say.

#include <limits>

#include "mesh_files.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/surfaces/point_cloud.h"

namespace raylift {
namespace {

PointCloud ReadCloudBytes(const std::string& name, const std::string& bytes) {
  const auto path = TestFolder() / name;
  WriteFile(path, bytes);
  return ReadPointCloud(path);
}

void ExpectFails(const std::string& name, const std::string& bytes,
                 const std::vector<std::string>& parts) {
  EXPECT_TRUE(FailsWithInputError([&] { ReadCloudBytes(name, bytes); }, parts));
  EXPECT_TRUE(FailsWithInputError([&] { ReadCloudBytes(name, bytes); }, {name}));
}

using Rgb = std::array<uint8_t, 3>;

TEST(ReadPointCloud, PlyOfBothByteOrdersHasNormalsAndColors) {
  for (const bool big : {false, true}) {
    std::string bytes = "ply\nformat binary_" + std::string(big ? "big" : "little") +
                        "_endian 1.0\nelement vertex 1\nproperty double x\nproperty double y\n"
                        "property double z\nproperty float nx\nproperty float ny\n"
                        "property float nz\nproperty uchar red\nproperty uchar green\n"
                        "property uchar blue\nend_header\n";
    for (const double x : {4e5 + 0.001, 5e6, -1.5}) AppendBytes(bytes, x, big);
    for (const float n : {0.f, 0.f, 1.f}) AppendBytes(bytes, n, big);
    for (const int c : {10, 20, 30}) AppendBytes(bytes, static_cast<uint8_t>(c), big);
    const PointCloud cloud = ReadCloudBytes("scan.ply", bytes);
    ASSERT_EQ(cloud.points_in_world.size(), 1u);
    EXPECT_EQ(cloud.points_in_world[0], Eigen::Vector3d(4e5 + 0.001, 5e6, -1.5));
    EXPECT_EQ(cloud.normals.at(0), Eigen::Vector3f(0, 0, 1));
    EXPECT_EQ(cloud.colors_rgb.at(0), (Rgb{10, 20, 30}));
    bytes.pop_back();
    ExpectFails("cut.ply", bytes, {"element vertex", "the file has room for 0"});
  }
}

// A LAS file of the given minor version and format, with a header as its specification says.
struct LasFile {
  uint8_t minor = 2;
  uint8_t format = 2;
  uint16_t record_bytes = 26;
  uint32_t count = 2;

  std::string Header() const {
    const size_t size = minor >= 4 ? 375 : 227;
    std::string bytes(size, '\0');
    const auto put = [&bytes](size_t at, auto value) {
      bytes.replace(at, sizeof(value), reinterpret_cast<const char*>(&value), sizeof(value));
    };
    bytes.replace(0, 4, "LASF");
    put(24, uint8_t{1});
    put(25, minor);
    put(94, static_cast<uint16_t>(size));
    put(96, static_cast<uint32_t>(size));
    put(104, format);
    put(105, record_bytes);
    put(107, minor >= 4 ? uint32_t{0} : count);
    if (minor >= 4) put(247, uint64_t{count});
    for (size_t axis = 0; axis < 3; ++axis) put(131 + 8 * axis, 0.001);
    put(155, 400000.0);
    put(163, 5000000.0);
    return bytes;
  }
  std::string Point(int x, uint8_t flags, uint8_t kind, size_t color_at) const {
    std::string bytes(record_bytes, '\0');
    const auto put = [&bytes](size_t at, auto value) {
      bytes.replace(at, sizeof(value), reinterpret_cast<const char*>(&value), sizeof(value));
    };
    put(0, int32_t{x});
    put(4, int32_t{-2000});
    put(8, int32_t{3});
    put(15, flags);
    if (format >= 6) put(16, kind);
    if (color_at > 0) put(color_at, uint16_t{0xff00});
    return bytes;
  }
};

TEST(ReadPointCloud, LasHasScaleOffsetAndColors) {
  for (const LasFile& las : {LasFile{}, LasFile{.minor = 4, .format = 7, .record_bytes = 40}}) {
    const size_t color_at = las.format == 2 ? 20 : 30;
    const uint8_t noise = las.format == 2 ? 7 : 0;  // of the old formats, in the flags' byte
    const PointCloud cloud =
        ReadCloudBytes("scan.las", las.Header() + las.Point(1, 0, 2, color_at) +
                                       las.Point(5, noise, 18, color_at));
    ASSERT_EQ(cloud.points_in_world.size(), 1u) << "noise is left out";
    EXPECT_LT((cloud.points_in_world[0] - Eigen::Vector3d(400000.001, 4999998, 0.003)).norm(),
              1e-8);
    EXPECT_EQ(cloud.colors_rgb.at(0), (Rgb{255, 0, 0}));
    ASSERT_EQ(cloud.warnings.size(), 1u);
    EXPECT_NE(cloud.warnings[0].find("1 of 2 points left out"), std::string::npos);
  }
}

TEST(ReadPointCloud, BadLasNamesTheField) {
  const LasFile las;
  ExpectFails("a.las", "LASX", {"expected a LAS file"});
  ExpectFails("a.las", las.Header().substr(0, 100), {"header: the file ends early"});
  ExpectFails("a.las", las.Header(),
              {"number of point records", "claims 2, the file has room for 0"});
  ExpectFails("a.las", LasFile{.format = 11}.Header(), {"point data format", "0 to 10, found 11"});
  ExpectFails("a.las", LasFile{.format = 130}.Header(), {"compressed LAS is not read"});
  ExpectFails("a.las", LasFile{.record_bytes = 20}.Header(), {"record length", "26 or more"});
  ExpectFails("a.las", LasFile{.minor = 5}.Header() + std::string(200, '\0'),
              {"version", "1.0 to 1.4, found 1.5"});
  ExpectFails("a.laz", "LASF", {"expected it decompressed"});
}

const std::string kPcdHead =
    "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb normal_x normal_y normal_z\n"
    "SIZE 4 4 4 4 4 4 4\nTYPE F F F F F F F\nCOUNT 1 1 1 1 1 1 1\nWIDTH 2\nHEIGHT 1\n"
    "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\n";

TEST(ReadPointCloud, PcdAsTextAndBinary) {
  // 0x0a141e as the bits of a float.
  const std::string text = kPcdHead + "DATA ascii\n1 2 3 9.2557e-40 0 0 1\nnan nan nan 0 0 0 1\n";
  std::string binary = kPcdHead + "DATA binary\n";
  for (const float x : {1.f, 2.f, 3.f}) AppendBytes(binary, x);
  AppendBytes(binary, uint32_t{0x0a141e});
  for (const float x : {0.f, 0.f, 1.f}) AppendBytes(binary, x);
  for (int i = 0; i < 7; ++i) AppendBytes(binary, std::numeric_limits<float>::quiet_NaN());
  for (const std::string& bytes : {text, binary}) {
    const PointCloud cloud = ReadCloudBytes("scan.pcd", bytes);
    ASSERT_EQ(cloud.points_in_world.size(), 1u) << "what is not finite is left out";
    EXPECT_EQ(cloud.points_in_world[0], Eigen::Vector3d(1, 2, 3));
    EXPECT_EQ(cloud.normals.at(0), Eigen::Vector3f(0, 0, 1));
    EXPECT_EQ(cloud.colors_rgb.at(0)[0], 10);
    EXPECT_EQ(cloud.colors_rgb.at(0)[1], 20);
    EXPECT_EQ(cloud.warnings.size(), 1u);
  }
}

TEST(ReadPointCloud, BadPcdNamesTheField) {
  ExpectFails("a.pcd", kPcdHead, {"the file ends before the line DATA"});
  ExpectFails("a.pcd", kPcdHead + "DATA binary_compressed\n", {"DATA: expected ascii or binary"});
  ExpectFails("a.pcd", kPcdHead + "DATA binary\n" + std::string(2 * 28 - 1, 'x'),
              {"POINTS", "claims 2, the file has room for"});
  ExpectFails("a.pcd", kPcdHead + "DATA ascii\n1 2 x 0 0 0 1\n0 0 0 0 0 0 0\n",
              {"line 12, z: expected a number, found \"x\""});
  ExpectFails("a.pcd", kPcdHead + "DATA ascii\n1 2 3 0 0 0 1 0 0 0 0 0\n1 2\n",
              {"line 12: expected 7 numbers, found 12"});
  ExpectFails("a.pcd", "FIELDS x y\nSIZE 4 4\nTYPE F F\nPOINTS 1\nDATA ascii\n1 2\n",
              {"FIELDS: expected x, y and z"});
  ExpectFails("a.pcd", "FIELDS x\nSIZE 3\nTYPE F\nPOINTS 1\nDATA ascii\n1\n", {"SIZE, x"});
}

TEST(ReadPointCloud, TextFindsItsColumns) {
  PointCloud cloud = ReadCloudBytes("a.xyz", "1 2 3\n\n# comment\n4,5;6\n");
  EXPECT_EQ(cloud.points_in_world.size(), 2u);
  EXPECT_TRUE(cloud.normals.empty() && cloud.colors_rgb.empty());
  cloud = ReadCloudBytes("b.txt", "1 2 3 10 20 30 0 0.6 0.8\n1 2 4 11 20 30 0 1 0\n");
  EXPECT_EQ(cloud.colors_rgb.at(0), (Rgb{10, 20, 30}));
  EXPECT_EQ(cloud.normals.at(1), Eigen::Vector3f(0, 1, 0));
  cloud = ReadCloudBytes("c.pts", "2\n1 2 3 -1200.5 10 20 30\n1 2 4 7 11 20 30\n");
  EXPECT_EQ(cloud.colors_rgb.at(1), (Rgb{11, 20, 30}));
  cloud = ReadCloudBytes("d.csv", "//Intensity,X,Y,Z\n0.5,1,2,3\n");
  EXPECT_EQ(cloud.points_in_world.at(0), Eigen::Vector3d(1, 2, 3));
}

TEST(ReadPointCloud, BadTextNamesLineAndColumn) {
  ExpectFails("a.xyz", "1 2 3\n1 x 3\n", {"line 2, y: expected a number, found \"x\""});
  ExpectFails("a.xyz", "1 2 3\n1 2\n", {"line 2: expected 3 columns, found 2"});
  ExpectFails("a.xyz", "hello\n", {"line 1, x: expected a number, found \"hello\""});
  ExpectFails("a.xyz", "nan nan nan\n", {"expected points, found none"});
  ExpectFails("a.xyz", "", {"expected points, found none"});
  ExpectFails("a.e57", "1 2 3\n", {"expected a point cloud: .ply, .las"});
}

}  // namespace
}  // namespace raylift
