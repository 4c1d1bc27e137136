// ReadHeightField on GeoTIFF files that are written here, byte by byte.

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

template <typename T>
std::string BytesOf(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

// A little-endian TIFF of one strip: tags with their types, and values that do not fit beside them.
class TiffWriter {
 public:
  TiffWriter(uint32_t width, uint32_t height, std::string pixels, bool is_color)
      : pixels_(std::move(pixels)) {
    Longs(256, {width});
    Longs(257, {height});
    Shorts(258, is_color ? std::vector<uint16_t>{8, 8, 8} : std::vector<uint16_t>{32});
    Shorts(259, {1});
    Shorts(262, {static_cast<uint16_t>(is_color ? 2 : 1)});
    Longs(273, {8});
    Shorts(277, {static_cast<uint16_t>(is_color ? 3 : 1)});
    Longs(278, {height});
    Longs(279, {static_cast<uint32_t>(pixels_.size())});
    Shorts(339, is_color ? std::vector<uint16_t>{1, 1, 1} : std::vector<uint16_t>{3});
  }
  void Shorts(uint16_t tag, const std::vector<uint16_t>& v) {
    tags_[tag] = {3, v.size(), BytesOf(v)};
  }
  void Longs(uint16_t tag, const std::vector<uint32_t>& v) {
    tags_[tag] = {4, v.size(), BytesOf(v)};
  }
  void Doubles(uint16_t tag, const std::vector<double>& v) {
    tags_[tag] = {12, v.size(), BytesOf(v)};
  }
  void Text(uint16_t tag, std::string text) {
    text += '\0';
    tags_[tag] = {2, text.size(), text};
  }
  // A projected system, and which part of a pixel the coordinates are of.
  void Keys(uint16_t model, uint16_t raster, uint16_t system) {
    Shorts(34735, {1, 1, 0, 3, 1024, 0, 1, model, 1025, 0, 1, raster, 3072, 0, 1, system});
  }

  void Write(const std::filesystem::path& path) const {
    std::string file = "II*";
    file += '\0';
    std::string body = pixels_;
    if (body.size() % 2 != 0) body += '\0';
    const size_t directory = 8 + body.size();
    Append(file, static_cast<uint32_t>(directory));
    file += body;
    Append(file, static_cast<uint16_t>(tags_.size()));
    std::string beyond;
    const size_t beyond_at = directory + 2 + 12 * tags_.size() + 4;
    for (const auto& [tag, entry] : tags_) {
      Append(file, tag);
      Append(file, entry.type);
      Append(file, static_cast<uint32_t>(entry.count));
      if (entry.bytes.size() <= 4) {
        file += entry.bytes + std::string(4 - entry.bytes.size(), '\0');
      } else {
        Append(file, static_cast<uint32_t>(beyond_at + beyond.size()));
        beyond += entry.bytes;
        if (beyond.size() % 2 != 0) beyond += '\0';
      }
    }
    Append(file, uint32_t{0});
    WriteFile(path, file + beyond);
  }

 private:
  struct Entry {
    uint16_t type;
    size_t count;
    std::string bytes;
  };
  template <typename T>
  static void Append(std::string& bytes, T value) {
    bytes.append(reinterpret_cast<const char*>(&value), sizeof(value));
  }

  std::string pixels_;
  std::map<uint16_t, Entry> tags_;
};

constexpr double kEast = 500000.25, kNorth = 5200000.5;  // of the grid's upper left corner

// 3 x 2 cells of half a meter: 10 20 30 / 11 21 none.
TiffWriter SmallField() {
  TiffWriter tiff(3, 2, BytesOf<float>({10, 20, 30, 11, 21, -9999}), false);
  tiff.Doubles(33550, {0.5, 0.5, 0});
  tiff.Doubles(33922, {0, 0, 0, kEast, kNorth, 0});
  tiff.Keys(1, 1, 32632);
  tiff.Text(42113, "-9999");
  return tiff;
}

TiffWriter Picture(double east) {
  TiffWriter tiff(2, 1, std::string("\xff\x00\x00\x00\x00\xff", 6), true);  // red, blue
  tiff.Doubles(33550, {0.75, 1, 0});
  tiff.Doubles(33922, {0, 0, 0, east, kNorth, 0});
  tiff.Keys(1, 1, 32632);
  return tiff;
}

class HeightField : public testing::Test {
 protected:
  TriangleMesh Read(const TiffWriter& tiff) const {
    tiff.Write(file());
    return ReadHeightField(file());
  }
  std::filesystem::path file() const { return folder_ / "dsm.tif"; }
  std::filesystem::path picture() const { return folder_ / "ortho.tif"; }
  void ExpectError(const TiffWriter& tiff, const std::string& text) const {
    tiff.Write(file());
    EXPECT_TRUE(FailsWithInputError([this] { ReadHeightField(file()); }, {"dsm.tif", text}));
  }

  const std::filesystem::path folder_ = TestFolder();
};

// Corners of a mesh in the world, sorted.
std::vector<std::array<double, 3>> MapCorners(const TriangleMesh& mesh) {
  std::vector<std::array<double, 3>> corners;
  for (uint32_t i = 0; i < mesh.vertices.size(); ++i) {
    const Eigen::Vector3d p = mesh.VertexInWorld(i);
    corners.push_back({p.x(), p.y(), p.z()});
  }
  std::sort(corners.begin(), corners.end());
  return corners;
}

TEST_F(HeightField, VerticesAreTheCentersOfCells) {
  const TriangleMesh mesh = Read(SmallField());
  const double x = kEast + 0.25, y = kNorth - 0.25;
  EXPECT_EQ(
      MapCorners(mesh),
      (std::vector<std::array<double, 3>>{
          {x, y - 0.5, 11}, {x, y, 10}, {x + 0.5, y - 0.5, 21}, {x + 0.5, y, 20}, {x + 1, y, 30}}));
  EXPECT_EQ(mesh.triangles.size(), 3u);
  EXPECT_TRUE(mesh.warnings.empty());
  EXPECT_EQ(mesh.crs, "EPSG:32632");
  for (const auto& t : mesh.triangles) {  // seen from above, counterclockwise
    const Eigen::Vector3f normal = (mesh.vertices[t[1]] - mesh.vertices[t[0]])
                                       .cross(mesh.vertices[t[2]] - mesh.vertices[t[0]]);
    EXPECT_GT(normal.z(), 0);
  }
}

TEST_F(HeightField, NamesItsSystemAsFarAsItIsKnown) {
  TiffWriter tiff = SmallField();
  tiff.Shorts(34735,
              {1, 1, 0, 4, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 25832, 4096, 0, 1, 7837});
  EXPECT_EQ(Read(tiff).crs, "EPSG:25832+7837");
  tiff.Keys(1, 1, 32767);
  EXPECT_EQ(Read(tiff).crs, "") << "of the user's own";
  tiff.Keys(1, 1, 1);
  const TriangleMesh unknown = Read(tiff);
  EXPECT_EQ(unknown.crs, "");
  ASSERT_EQ(unknown.warnings.size(), 1u);
  EXPECT_NE(unknown.warnings[0].find("EPSG:1"), std::string::npos) << unknown.warnings[0];
}

TEST_F(HeightField, PixelIsPointIsHalfACellElsewhere) {
  TiffWriter tiff = SmallField();
  tiff.Keys(1, 2, 32632);
  const auto corners = MapCorners(Read(tiff));
  EXPECT_EQ(corners.front(), (std::array<double, 3>{kEast, kNorth - 0.5, 11}));
}

TEST_F(HeightField, TransformationMayTurnAndMirror) {
  // x = east + row / 2, y = north + column / 2 turns; x = east + column / 2, y = north + row / 2
  // mirrors, so that triangles turn around.
  for (const bool mirrors : {false, true}) {
    TiffWriter tiff(2, 2, BytesOf<float>({1, 2, 3, 4}), false);
    const double along = mirrors ? 0.5 : 0, across = 0.5 - along;
    tiff.Doubles(34264,
                 {along, across, 0, kEast, across, along, 0, kNorth, 0, 0, 0, 0, 0, 0, 0, 1});
    const TriangleMesh mesh = Read(tiff);
    EXPECT_EQ(MapCorners(mesh)[1],
              (std::array<double, 3>{kEast + 0.25, kNorth + 0.75, mirrors ? 3.0 : 2.0}));
    ASSERT_EQ(mesh.triangles.size(), 2u);
    for (const auto& t : mesh.triangles) {
      const Eigen::Vector3f normal = (mesh.vertices[t[1]] - mesh.vertices[t[0]])
                                         .cross(mesh.vertices[t[2]] - mesh.vertices[t[0]]);
      EXPECT_GT(normal.z(), 0);
    }
  }
}

TEST_F(HeightField, CellsAreCutAlongTheSmallerStepInHeight) {
  for (const float step : {4.0f, -4.0f}) {
    TiffWriter tiff(2, 2, BytesOf<float>({20, 30 + step, 30, 20 + step / 2}), false);
    tiff.Doubles(33550, {1, 1, 0});
    tiff.Doubles(33922, {0, 0, 0, 0, 0, 0});
    const TriangleMesh mesh = Read(tiff);
    ASSERT_EQ(mesh.triangles.size(), 2u);
    for (const auto& t : mesh.triangles) {
      // The lower two corners, opposite to each other, are of both.
      EXPECT_EQ(std::count_if(t.begin(), t.end(),
                              [&](uint32_t v) { return mesh.VertexInWorld(v).z() < 25; }),
                2);
    }
  }
}

TEST_F(HeightField, WorldFileSaysWhereFirstCenterIs) {
  WriteFile(folder_ / "dsm.tfw", "0.5\n0\n0\n-0.5\n1000\n2000\n");
  const auto corners = MapCorners(Read(TiffWriter(2, 2, BytesOf<float>({1, 2, 3, 4}), false)));
  EXPECT_EQ(corners.back(), (std::array<double, 3>{1000.5, 2000, 2}));
  WriteFile(folder_ / "dsm.tfw", "0.5\n0\n0\n-0.5\n1000\n");
  EXPECT_TRUE(FailsWithInputError([this] { ReadHeightField(file()); },
                                  {"dsm.tfw: expected six numbers, found 5"}));
}

TEST_F(HeightField, UsualNumberOfNoHeightIsSaid) {
  TiffWriter tiff(3, 2, BytesOf<float>({1, 2, 3, 4, 5, -9999}), false);
  tiff.Doubles(33550, {0.5, 0.5, 0});
  tiff.Doubles(33922, {0, 0, 0, 0, 0, 0});
  const TriangleMesh mesh = Read(tiff);
  EXPECT_EQ(mesh.vertices.size(), 5u);
  ASSERT_EQ(mesh.warnings.size(), 1u);
  EXPECT_NE(mesh.warnings.front().find("heights of -9999 are taken for none"), std::string::npos);
}

TEST_F(HeightField, NoNumberIsNoHeight) {
  const float none = std::numeric_limits<float>::quiet_NaN();
  TiffWriter tiff(3, 2, BytesOf<float>({none, 2, 3, 4, 5, -9999}), false);
  tiff.Doubles(33550, {0.5, 0.5, 0});
  tiff.Doubles(33922, {0, 0, 0, 0, 0, 0});
  const TriangleMesh mesh = Read(tiff);
  EXPECT_EQ(mesh.triangles.size(), 2u);
  EXPECT_EQ(mesh.warnings.size(), 1u);
}

TEST_F(HeightField, OrthophotoIsItsTexture) {
  SmallField().Write(file());
  Picture(kEast).Write(picture());
  const TriangleMesh mesh = ReadHeightField(file(), picture());
  ASSERT_EQ(mesh.textures.size(), 1u);
  EXPECT_EQ(mesh.textures[0].Pixel(1, 0)[2], 255);
  for (uint32_t i = 0; i < mesh.vertices.size(); ++i) {
    const Eigen::Vector3d p = mesh.VertexInWorld(i);
    EXPECT_NEAR(mesh.texture_coordinates[i].x(), (p.x() - kEast) / 1.5, 1e-6);
    EXPECT_NEAR(mesh.texture_coordinates[i].y(), 1 - (kNorth - p.y()), 1e-6);
  }
  Picture(kEast + 100).Write(picture());
  EXPECT_TRUE(FailsWithInputError([this] { ReadHeightField(file(), picture()); },
                                  {"ortho.tif: shows nothing of the surface model"}));
  TiffWriter other = Picture(kEast);
  other.Keys(1, 1, 32633);
  other.Write(picture());
  EXPECT_TRUE(FailsWithInputError([this] { ReadHeightField(file(), picture()); },
                                  {"ortho.tif: is in EPSG:32633, but"}));
}

// A field of 6 x 4 heights, or a part of it from a column and a row on.
TiffWriter PartOfField(uint32_t column, uint32_t row, uint32_t width, uint32_t height) {
  std::vector<float> heights;
  for (uint32_t y = row; y < row + height; ++y) {
    for (uint32_t x = column; x < column + width; ++x) {
      heights.push_back(static_cast<float>(x * x + 7 * y));
    }
  }
  TiffWriter tiff(width, height, BytesOf(heights), false);
  tiff.Doubles(33550, {0.5, 0.5, 0});
  tiff.Doubles(33922, {0, 0, 0, kEast + 0.5 * column, kNorth - 0.5 * row, 0});
  tiff.Keys(1, 1, 32632);
  return tiff;
}

TEST_F(HeightField, FilesOfOneGridAreOneSurface) {
  const TriangleMesh whole = Read(PartOfField(0, 0, 6, 4));
  const auto tiles = folder_ / "tiles";
  std::filesystem::create_directories(tiles);
  PartOfField(0, 0, 3, 4).Write(tiles / "a.tif");
  PartOfField(2, 0, 4, 2).Write(tiles / "b.tif");  // overlaps the first
  PartOfField(3, 2, 3, 2).Write(tiles / "c.TIF");
  for (const std::string& files : {tiles.string(), (tiles / "*.[tT]*").string()}) {
    const TriangleMesh mesh = ReadHeightField(files);
    EXPECT_EQ(MapCorners(mesh), MapCorners(whole));
    EXPECT_EQ(mesh.triangles.size(), whole.triangles.size());
  }
  std::filesystem::remove(tiles / "c.TIF");
  EXPECT_EQ(ReadHeightField(tiles).vertices.size(), 18u);  // 24 less 6 of the missing part

  // Two pictures side by side, one texture.
  const auto pictures = folder_ / "pictures";
  std::filesystem::create_directories(pictures);
  Picture(kEast).Write(pictures / "a.tif");
  Picture(kEast + 1.5).Write(pictures / "b.tif");
  const TriangleMesh colored = ReadHeightField(tiles, pictures);
  ASSERT_EQ(colored.textures.size(), 1u);
  EXPECT_EQ(colored.textures[0].width_px, 4);
  EXPECT_EQ(colored.textures[0].Pixel(2, 0)[0], 255);
  EXPECT_EQ(colored.textures[0].Pixel(3, 0)[2], 255);

  const auto expect_error = [&](TiffWriter tiff, const std::string& message) {
    tiff.Write(tiles / "z.tif");
    EXPECT_TRUE(FailsWithInputError([&] { ReadHeightField(tiles); }, {"z.tif: " + message}));
  };
  TiffWriter shifted = PartOfField(3, 2, 3, 2);
  shifted.Doubles(33922, {0, 0, 0, kEast + 1.6, kNorth - 1, 0});
  expect_error(shifted, "its pixels do not lie on the grid of those of");
  TiffWriter coarser = PartOfField(3, 2, 3, 2);
  coarser.Doubles(33550, {0.51, 0.51, 0});
  expect_error(coarser, "its pixels do not lie on the grid of those of");
  TiffWriter elsewhere = PartOfField(3, 2, 3, 2);
  elsewhere.Keys(1, 1, 32633);
  expect_error(elsewhere, "is in EPSG:32633, but");
  TiffWriter far = PartOfField(3, 2, 3, 2);
  far.Doubles(33922, {0, 0, 0, kEast + 1e6, kNorth - 1e6, 0});
  far.Write(tiles / "z.tif");
  EXPECT_TRUE(
      FailsWithInputError([&] { ReadHeightField(tiles); }, {"pixels of all together, found"}));
}

TEST_F(HeightField, OfOverlappingFilesTheFirstThatHasAHeightIsTaken) {
  const auto tiles = folder_ / "tiles";
  std::filesystem::create_directories(tiles);
  const auto write = [&](const char* name, uint32_t column, const std::vector<float>& heights) {
    TiffWriter tiff(2, 2, BytesOf(heights), false);
    tiff.Doubles(33550, {0.5, 0.5, 0});
    tiff.Doubles(33922, {0, 0, 0, kEast + 0.5 * column, kNorth, 0});
    tiff.Text(42113, "-9999");
    tiff.Write(tiles / name);
  };
  write("b.tif", 1, {20, 30, 21, 31});
  write("a.tif", 0, {1, 2, 3, -9999});
  const TriangleMesh mesh = ReadHeightField(tiles);
  std::vector<double> heights;
  for (uint32_t i = 0; i < mesh.vertices.size(); ++i) heights.push_back(mesh.VertexInWorld(i).z());
  std::sort(heights.begin(), heights.end());
  EXPECT_EQ(heights, (std::vector<double>{1, 2, 3, 21, 30, 31}));
}

// Two pictures of 3 x 2 heights each, at opposite corners of 6 x 4.
TEST_F(HeightField, BesideTheOrthophotosThereIsNoTexture) {
  PartOfField(0, 0, 6, 4).Write(file());
  const auto pictures = folder_ / "pictures";
  std::filesystem::create_directories(pictures);
  Picture(kEast).Write(pictures / "a.tif");
  TiffWriter second = Picture(kEast);
  second.Doubles(33922, {0, 0, 0, kEast + 1.5, kNorth - 1, 0});
  second.Write(pictures / "b.tif");
  const TriangleMesh mesh = ReadHeightField(file(), pictures);
  ASSERT_EQ(mesh.triangle_textures.size(), mesh.triangles.size());
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    const auto is_in = [&](double west, double north) {
      return std::all_of(mesh.triangles[i].begin(), mesh.triangles[i].end(), [&](uint32_t v) {
        const Eigen::Vector3d p = mesh.VertexInWorld(v);
        return p.x() > west && p.x() < west + 1.5 && p.y() < north && p.y() > north - 1;
      });
    };
    const bool is_shown = is_in(kEast, kNorth) || is_in(kEast + 1.5, kNorth - 1);
    EXPECT_EQ(mesh.triangle_textures[i] >= 0, is_shown) << i;
  }
}

TEST_F(HeightField, BadFilesAreNamed) {
  TiffWriter degrees = SmallField();
  degrees.Keys(2, 1, 4326);
  ExpectError(degrees, "its coordinates are degrees");
  TiffWriter feet = SmallField();
  feet.Shorts(34735, {1, 1, 0, 2, 1024, 0, 1, 1, 3076, 0, 1, 9003});
  ExpectError(feet, "its coordinates are of unit EPSG:9003");
  ExpectError(TiffWriter(2, 2, BytesOf<float>({1, 2, 3, 4}), false),
              "does not say where its pixels lie");
  ExpectError(Picture(kEast), "expected heights: one channel");
  TiffWriter none(2, 2, BytesOf<float>({-1, -1, -1, -1}), false);
  none.Doubles(33550, {1, 1, 0});
  none.Doubles(33922, {0, 0, 0, 0, 0, 0});
  none.Text(42113, "-1");
  ExpectError(none, "has no neighboring heights");
  none.Text(42113, "many");
  ExpectError(none, "GDAL_NODATA: expected a number, found \"many\"");
  WriteFile(file(), "II*\0truncated");
  EXPECT_TRUE(FailsWithInputError([this] { ReadHeightField(file()); }, {"dsm.tif"}));
}

TEST_F(HeightField, RealOneHasTheHeightsThatOpenCvReads) {
  const auto data = FindTestData("drone_beach");
  if (!data) GTEST_SKIP() << "drone_beach is not on this machine";
  const TriangleMesh mesh = ReadHeightField(*data / "dsm.tif", *data / "ortho.tif");
  const cv::Mat heights = cv::imread((*data / "dsm.tif").string(), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(heights.type(), CV_32F);
  int top = heights.rows, left = heights.cols;
  size_t known = 0;
  for (int row = 0; row < heights.rows; ++row) {
    for (int column = 0; column < heights.cols; ++column) {
      if (heights.at<float>(row, column) == -9999) continue;
      top = std::min(top, row);
      left = std::min(left, column);
      ++known;
    }
  }
  double west = std::numeric_limits<double>::infinity(), north = -west;
  for (const auto& [x, y, z] : MapCorners(mesh)) {
    west = std::min(west, x);
    north = std::max(north, y);
  }
  // Those without a neighbor that has a height are left out.
  EXPECT_LE(mesh.vertices.size(), known);
  EXPECT_GT(mesh.vertices.size(), known * 0.98);
  constexpr double kCell = 0.15;
  for (const auto& [x, y, z] : MapCorners(mesh)) {
    const int row = top + static_cast<int>(std::lround((north - y) / kCell));
    const int column = left + static_cast<int>(std::lround((x - west) / kCell));
    ASSERT_NEAR(heights.at<float>(row, column), z, 1e-3);
  }
}

}  // namespace
}  // namespace raylift
