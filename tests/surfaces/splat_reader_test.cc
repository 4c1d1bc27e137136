// ReadSplats on bytes as trainers and compressors write them.

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

#include "mesh_files.h"
#include "renderers/splat_blend.h"
#include "support/matchers.h"
#include "support/splat_files.h"
#include "support/test_data.h"
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/surfaces/splats.h"

namespace raylift {
namespace {

Splats ReadSplatBytes(const std::string& bytes) {
  const auto path = TestFolder() / "splats.ply";
  WriteFile(path, bytes);
  return ReadSplats(path);
}

void ExpectFails(const std::string& bytes, const std::vector<std::string>& parts) {
  EXPECT_TRUE(FailsWithInputError([&] { ReadSplatBytes(bytes); }, parts));
  EXPECT_TRUE(FailsWithInputError([&] { ReadSplatBytes(bytes); }, {"splats.ply"}));
}

std::string Replaced(std::string text, const std::string& from, const std::string& to) {
  const size_t at = text.find(from);
  return at == std::string::npos ? text : text.replace(at, from.size(), to);
}

TEST(ReadSplats, TrainedOnesComeBackAsTheyWere) {
  TestSplat splat{.mean = {1, -2, 3},
                  .rotation = Eigen::Quaterniond(2, 0, 2, 0),  // of any length
                  .scale = {0.5, 0.25, 0.125},
                  .opacity = 0.75};
  for (const size_t coefficients : {1u, 4u, 9u, 16u}) {
    splat.harmonics.resize(coefficients);
    for (size_t i = 0; i < coefficients; ++i) {
      splat.harmonics[i] = static_cast<float>(i + 1) * Eigen::Vector3f(1, 10, 100);
    }
    const Splats read = ReadSplatBytes(SplatPly({{splat, splat}}, SplatLayout::kEllipsoids));
    ASSERT_EQ(read.means.size(), 2u);
    EXPECT_EQ(read.means[1], Eigen::Vector3f(1, -2, 3));
    EXPECT_NEAR((read.scales[1] - Eigen::Vector3f(0.5f, 0.25f, 0.125f)).norm(), 0, 1e-7);
    EXPECT_NEAR(double{read.opacities[1]}, 0.75, 1e-7);
    EXPECT_NEAR(read.rotations[1].angularDistance(Eigen::Quaternionf(1, 0, 1, 0).normalized()), 0,
                1e-3);
    EXPECT_EQ(read.NumCoefficients(), coefficients);
    const std::vector<Eigen::Vector3f> second(read.harmonics.begin() + coefficients,
                                              read.harmonics.end());
    EXPECT_EQ(second, splat.harmonics);
    EXPECT_GT(read.MemoryBytes(), 2 * 12 * coefficients);
    EXPECT_TRUE(read.warnings.empty());
  }
}

TEST(ReadSplats, DiscsHaveTwoScales) {
  const Splats read =
      ReadSplatBytes(SplatPly({{TestSplat{.scale = {0.5, 0.25, 7}}}}, SplatLayout::kDiscs));
  EXPECT_NEAR(double{read.scales.at(0)[1]}, 0.25, 1e-7);
  EXPECT_LT(read.scales[0][2], 1e-6f);
}

// As nerfstudio writes models without harmonics.
TEST(ReadSplats, PlainColorsStandForHarmonics) {
  std::string bytes =
      "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
      "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
      "property float opacity\nproperty float scale_0\nproperty float scale_1\n"
      "property float scale_2\nproperty float rot_0\nproperty float rot_1\nproperty float rot_2\n"
      "property float rot_3\nend_header\n";
  for (const float value : {0.f, 0.f, 5.f}) AppendBytes(bytes, value);
  for (const int value : {255, 51, 0}) AppendBytes(bytes, static_cast<uint8_t>(value));
  for (const float value : {3.f, 0.f, 0.f, 0.f, 1.f, 0.f, 0.f, 0.f}) AppendBytes(bytes, value);
  const Splats splats = ReadSplatBytes(bytes);
  EXPECT_NEAR((SplatColors(splats, {0, 0, 0}, 1).at(0) - Eigen::Vector3f(1, 0.2f, 0)).norm(), 0,
              1e-6);
  std::string bare = Replaced(bytes, "red", "rot");
  EXPECT_TRUE(ReadSplatBytes(bare).harmonics.empty());
}

TEST(ReadSplats, WhatCannotBeSeenIsLeftOut) {
  const TestSplat good{.mean = {1, 2, 3}};
  TestSplat faint = good;
  faint.opacity = 0.003;  // below 1/255
  const double infinity = std::numeric_limits<double>::infinity();
  TestSplat endless = good;
  endless.scale.x() = infinity;
  TestSplat nowhere = good;
  nowhere.mean.x() = std::nan("");
  TestSplat unturned = good;
  unturned.rotation.coeffs().setZero();
  TestSplat colorless = good;
  colorless.harmonics[0].x() = std::numeric_limits<float>::quiet_NaN();
  const Splats read = ReadSplatBytes(
      SplatPly({{good, faint, endless, nowhere, unturned, colorless}}, SplatLayout::kEllipsoids));
  EXPECT_EQ(read.means.size(), 1u);
  ASSERT_EQ(read.warnings.size(), 1u);
  EXPECT_NE(read.warnings[0].find("4 of 6 Gaussians left out"), std::string::npos);
  ExpectFails(SplatPly({{faint}}, SplatLayout::kEllipsoids),
              {"found 1, none of which can be seen"});
  ExpectFails(SplatPly({}, SplatLayout::kEllipsoids), {"found 0"});
}

TEST(ReadSplats, WhatIsWrongIsNamed) {
  TestSplat splat;
  splat.harmonics.resize(4);
  const std::string bytes = SplatPly({{splat}}, SplatLayout::kEllipsoids);
  ExpectFails("solid cube\n", {"expected a PLY file"});
  ExpectFails(Replaced(bytes, "binary_little_endian", "ascii"), {"binary_little_endian"});
  ExpectFails(Replaced(bytes, "vertex 1", "vertex 2"), {"element vertex", "has room for 1"});
  ExpectFails(Replaced(bytes, "vertex 1", "vertex 18446744073709551615"), {"element vertex"});
  ExpectFails(Replaced(bytes, "element vertex", "element point"), {"expected the element vertex"});
  ExpectFails(Replaced(bytes, "opacity", "opaque"), {"expected Gaussians", "without them"});
  ExpectFails(Replaced(bytes, "float rot_3", "float rot_4"), {"expected the property rot_3"});
  ExpectFails(Replaced(bytes, "scale_1", "scale_3"), {"expected the property scale_1"});
  ExpectFails(Replaced(bytes, "f_rest_8", "f_rost_8"), {"0, 9, 24 or 45", "found 8"});
  ExpectFails(Replaced(bytes, "f_dc_2", "f_dc_3"), {"expected the property f_dc_2"});
  ExpectFails(Replaced(bytes, "property float nx", "property list uchar float nx"),
              {"the list nx"});
  EXPECT_TRUE(FailsWithInputError([] { ReadSplats("/nowhere/a.ply"); }, {"/nowhere/a.ply"}));
}

// ---- compressed ----

struct PackedFile {
  std::string chunk_names =
      "min_x min_y min_z max_x max_y max_z min_scale_x min_scale_y "
      "min_scale_z max_scale_x max_scale_y max_scale_z min_r min_g min_b "
      "max_r max_g max_b";
  std::vector<float> chunks = {-1, 0, 10, 1, 4, 20, -3, -3, -3, -1, -1, -1, 0, 0, 0, 1, 2, 1};
  std::vector<std::array<uint32_t, 4>> vertices;
  size_t harmonics = 0;  // bytes per vertex
  std::string harmonic_bytes = {};

  std::string Bytes() const {
    std::string names;
    size_t columns = 0;
    std::istringstream words(chunk_names);
    for (std::string word; words >> word; ++columns) names += "property float " + word + "\n";
    std::string bytes = fmt::format(
        "ply\nformat binary_little_endian 1.0\ncomment made by a test\nelement chunk {}\n{}"
        "element vertex {}\nproperty uint packed_position\nproperty uint packed_rotation\n"
        "property uint packed_scale\nproperty uint packed_color\n",
        chunks.size() / columns, names, vertices.size());
    if (harmonics > 0) bytes += fmt::format("element sh {}\n", vertices.size());
    for (size_t i = 0; i < harmonics; ++i) bytes += fmt::format("property uchar f_rest_{}\n", i);
    bytes += "end_header\n";
    for (const float value : chunks) AppendBytes(bytes, value);
    for (const auto& vertex : vertices) {
      for (const uint32_t value : vertex) AppendBytes(bytes, value);
    }
    return bytes + harmonic_bytes;
  }
};

uint32_t Pack111011(uint32_t x, uint32_t y, uint32_t z) { return x << 21 | y << 11 | z; }

TEST(ReadSplats, CompressedOnesAreUnpackedByTheirChunks) {
  PackedFile file;
  // Largest is y: the others are w, x, z, where 1023 / 2 stands for 0, and 1023 for sqrt(1/2).
  const uint32_t half_turn = 2u << 30 | 512u << 20 | 512u << 10 | 1023u;
  file.vertices = {{Pack111011(0, 1023, 2047), half_turn, Pack111011(2047, 0, 2047),
                    255u << 24 | 51u << 16 | 0u << 8 | 204u}};
  const Splats read = ReadSplatBytes(file.Bytes());
  ASSERT_EQ(read.means.size(), 1u);
  EXPECT_NEAR((read.means[0] - Eigen::Vector3f(-1, 4, 20)).norm(), 0, 1e-5);
  EXPECT_NEAR(std::log(double{read.scales[0][0]}), -1, 1e-6);
  EXPECT_NEAR(std::log(double{read.scales[0][1]}), -3, 1e-6);
  EXPECT_NEAR(double{read.opacities[0]}, 0.8, 1e-6);
  const Eigen::Quaternionf& q = read.rotations[0];
  EXPECT_NEAR(double{q.y()}, std::numbers::sqrt2 / 2, 1e-3);
  EXPECT_NEAR(double{q.z()}, std::numbers::sqrt2 / 2, 1e-3);
  EXPECT_NEAR(double{q.w()}, 0, 1e-3);
  EXPECT_EQ(read.degree, 0);
  EXPECT_NEAR((SplatColors(read, {0, 0, 0}, 1)[0] - Eigen::Vector3f(1, 0.4f, 0)).norm(), 0, 1e-6);
}

TEST(ReadSplats, EachChunkIsOf256AndOlderOnesHaveNoColors) {
  PackedFile file;
  file.chunk_names =
      "min_x min_y min_z max_x max_y max_z min_scale_x min_scale_y min_scale_z "
      "max_scale_x max_scale_y max_scale_z";
  file.chunks = {1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 2, 2, 2, 2, 2, 2, 0, 0, 0, 0, 0, 0};
  file.vertices.assign(257, {0, 512u << 20 | 512u << 10 | 512u, 0, 0x336699ffu});
  const Splats read = ReadSplatBytes(file.Bytes());
  EXPECT_EQ(read.means.at(255), Eigen::Vector3f(1, 1, 1));
  EXPECT_EQ(read.means.at(256), Eigen::Vector3f(2, 2, 2));
  EXPECT_NEAR(double{SplatColors(read, {0, 0, 0}, 1)[256][1]}, 0.4, 1e-6);
  file.chunks.resize(12);
  ExpectFails(file.Bytes(), {"element chunk", "one for each 256 of 257 vertices, found 1"});
}

TEST(ReadSplats, CompressedHarmonicsAreBytes) {
  PackedFile file;
  file.vertices = {{0, 512u << 20 | 512u << 10 | 512u, 0, 0xffffffffu}};
  file.harmonics = 9;
  for (int i = 0; i < 9; ++i) file.harmonic_bytes += static_cast<char>(i == 4 ? 255 : 0);
  const Splats read = ReadSplatBytes(file.Bytes());
  EXPECT_EQ(read.degree, 1);
  ASSERT_EQ(read.harmonics.size(), 4u);
  EXPECT_EQ(read.harmonics[2], Eigen::Vector3f(-4, 4, -4)) << "green's second one";
  ExpectFails(file.Bytes().substr(0, file.Bytes().size() - 1), {"element sh", "room for 0"});
  ExpectFails(Replaced(file.Bytes(), "element sh 1", "element sh 0"), {"element sh", "found 0"});
  ExpectFails(Replaced(file.Bytes(), "uchar f_rest_3", "short f_rest_3"), {"element sh"});
  ExpectFails(Replaced(file.Bytes(), "uint packed_scale", "float packed_scale"),
              {"element vertex, packed_scale"});
  ExpectFails(Replaced(file.Bytes(), "min_scale_y", "min_scale"), {"min_scale_y"});
}

TEST(ReadSplats, CutFilesAreErrorsOfOneLine) {
  TestSplat splat;
  splat.harmonics.resize(4);
  PackedFile packed;
  packed.vertices = {{0, 0, 0, 0xffffffffu}};
  for (const std::string& whole : {SplatPly({{splat}}, SplatLayout::kEllipsoids), packed.Bytes()}) {
    for (size_t size = 0; size < whole.size(); ++size) {
      const std::string cut = whole.substr(0, size);
      EXPECT_TRUE(FailsWithInputError([&] { ReadSplatBytes(cut); }, {"splats.ply"})) << size;
    }
  }
}

}  // namespace
}  // namespace raylift
