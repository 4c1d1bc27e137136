#include "raylift/io/depth_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <thread>

#include "io/depth/depth_formats.h"
#include "io/depth_test_files.h"
#include "support/enum_names.h"
#include "support/matchers.h"

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr std::array kWritten = {".exr", ".npy", ".npz", ".png", ".tiff", ".bin", ".pfm"};
constexpr std::array kCompressions = {ExrCompression::kNone, ExrCompression::kZips,
                                      ExrCompression::kZip, ExrCompression::kPiz,
                                      ExrCompression::kPxr24};

// Depths of a slanted plane with a hole, as a renderer gives them.
DepthMap MakeDepths(int width, int height) {
  DepthMap map{width, height, {}};
  Rng rng = TestRng();
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const bool hole = x > width / 3 && x < width / 2 && y > height / 2;
      map.z.push_back(hole ? 0.0f
                           : static_cast<float>(2 + 0.01 * x + 0.007 * y + rng.Uniform(0, 1e-3)));
    }
  }
  return map;
}

TEST(DepthFile, EveryWrittenFormatReadsBack) {
  const auto folder = TestFolder();
  for (const char* extension : kWritten) {
    const auto path = folder / (std::string("ramp") + extension);
    WriteDepthFile(path, MakeRamp(), {.png_step = 1});
    const StoredDepth depth = ReadDepthFile(path);
    EXPECT_TRUE(IsRamp(depth)) << extension;
    EXPECT_EQ(depth.format, DepthFileFormatFromName(path)) << extension;
  }
}

TEST(DepthFile, FloatFormatsKeepEveryBit) {
  const auto folder = TestFolder();
  const DepthMap map = MakeDepths(40, 30);
  for (const char* extension : {".npy", ".npz", ".tiff", ".bin", ".pfm"}) {
    const auto path = folder / (std::string("map") + extension);
    const DepthWriteReport report = WriteDepthFile(path, map);
    EXPECT_EQ(ReadDepthFile(path).values, map.z) << extension;
    EXPECT_EQ(report.bytes, std::filesystem::file_size(path));
    EXPECT_EQ(report.max_rounding, 0);
  }
  for (const ExrCompression compression : kCompressions) {
    WriteDepthFile(folder / "map.exr", map, {.exr_compression = compression});
    const auto values = ReadDepthFile(folder / "map.exr").values;
    for (size_t i = 0; i < values.size(); ++i) {
      // PXR24 drops eight bits of the mantissa and rounds.
      const float tolerance = compression == ExrCompression::kPxr24 ? map.z[i] * 0x1p-16f : 0;
      EXPECT_NEAR(values[i], map.z[i], tolerance) << ToString(compression);
    }
  }
}

TEST(DepthFile, HalfKeepsElevenBits) {
  const auto folder = TestFolder();
  const DepthMap map = MakeDepths(40, 30);
  for (const char* extension : {".exr", ".npy", ".npz"}) {
    const auto path = folder / (std::string("map") + extension);
    const DepthWriteReport report = WriteDepthFile(path, map, {.sample = FloatSample::kFloat16});
    const StoredDepth depth = ReadDepthFile(path);
    EXPECT_EQ(depth.sample_type, "float16");
    double max_difference = 0;
    for (size_t i = 0; i < map.z.size(); ++i) {
      EXPECT_NEAR(depth.values[i], map.z[i], map.z[i] * 0x1p-11f);
      max_difference =
          std::max(max_difference, static_cast<double>(std::abs(depth.values[i] - map.z[i])));
    }
    EXPECT_NEAR(report.max_rounding, max_difference, 1e-12);
  }
}

TEST(DepthFile, PngRoundsToStepsAndCountsWhatItLoses) {
  const auto path = TestFolder() / "map.png";
  DepthMap map = MakeDepths(40, 30);
  map.z[3] = 1e-4f;  // below half a step
  const DepthWriteReport report = WriteDepthFile(path, map, {.png_step = 0.001});
  EXPECT_EQ(report.dropped, 1u);
  EXPECT_LE(report.max_rounding, 0.0005 + 1e-7);
  const StoredDepth depth = ReadDepthFile(path);
  EXPECT_EQ(depth.sample_type, "uint16");
  EXPECT_EQ(depth.values[3], 0);
  for (size_t i = 4; i < map.z.size(); ++i) {
    EXPECT_NEAR(depth.values[i] * 0.001f, map.z[i], 0.00051);
    EXPECT_EQ(depth.values[i] == 0, map.z[i] == 0);
  }
}

TEST(DepthFile, ValuesOutOfRangeAreRefusedOrDroppedAndCounted) {
  const auto folder = TestFolder();
  DepthMap map = MakeRamp();
  map.z[9] = 70000;
  EXPECT_TRUE(FailsWithInputError(
      [&] { WriteDepthFile(folder / "a.png", map); },
      {"a.png", "pixel (2, 1)", "at most 65535 steps of 0.001", "65.535", "70000"}));
  EXPECT_TRUE(FailsWithInputError(
      [&] { WriteDepthFile(folder / "a.npy", map, {.sample = FloatSample::kFloat16}); },
      {"a.npy", "pixel (2, 1)", "65504", "70000"}));
  EXPECT_FALSE(std::filesystem::exists(folder / "a.png"));
  using enum DepthWriteOptions::OutOfRange;
  EXPECT_EQ(WriteDepthFile(folder / "a.png", map, {.png_step = 1, .out_of_range = kDrop}).dropped,
            1u);
  EXPECT_EQ(ReadDepthFile(folder / "a.png").values[9], 0);
  const DepthWriteOptions half{.sample = FloatSample::kFloat16, .out_of_range = kDrop};
  EXPECT_EQ(WriteDepthFile(folder / "a.exr", map, half).dropped, 1u);
  EXPECT_EQ(ReadDepthFile(folder / "a.exr").values[9], 0);
  map.z[9] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_TRUE(FailsWithInputError([&] { WriteDepthFile(folder / "a.png", map); }, {"nan"}));
}

TEST(DepthFile, SameValuesGiveTheSameBytesFromEveryThread) {
  const auto folder = TestFolder();
  const DepthMap map = MakeDepths(64, 48);
  for (const char* extension : kWritten) {
    std::vector<std::string> bytes(8);
    ParallelFor(bytes.size(), 4, [&](size_t i) {
      const auto path = folder / (std::to_string(i) + extension);
      WriteDepthFile(path, map, {.deflate_npz = true});
      bytes[i] = ReadFile(path);
    });
    for (const std::string& other : bytes) EXPECT_EQ(other, bytes[0]) << extension;
  }
}

TEST(DepthFile, LayersAreChosenByNameOrBySensibleDefault) {
  const auto folder = TestFolder();
  const DepthMap ramp = MakeRamp();
  const std::vector<float> other(ramp.z.size(), 3.0f);
  const PlaneSize size{kRampWidth, kRampHeight};
  const auto write = [&](std::vector<ExrChannel> channels) {
    const auto file = folder / "a.exr";
    WriteFile(file, EncodeExr(file, size, channels, ExrCompression::kZip, FloatSample::kFloat32));
  };
  write({{"A", other}, {"Z", ramp.z}});
  EXPECT_TRUE(IsRamp(ReadDepthFile(folder / "a.exr")));
  write({{"R", other}, {"View.Depth", ramp.z}});
  EXPECT_TRUE(IsRamp(ReadDepthFile(folder / "a.exr")));
  EXPECT_EQ(ReadDepthFile(folder / "a.exr").layer, "View.Depth");
  write({{"B", other}, {"R", ramp.z}});
  EXPECT_TRUE(IsRamp(ReadDepthFile(folder / "a.exr")));
  write({{"foo", ramp.z}});
  EXPECT_TRUE(IsRamp(ReadDepthFile(folder / "a.exr")));
  write({{"Z", other}, {"median", ramp.z}});
  EXPECT_TRUE(IsRamp(ReadDepthFile(folder / "a.exr", {.layer = "median"})));
  EXPECT_TRUE(FailsWithInputError([&] { ReadDepthFile(folder / "a.exr", {.layer = "mean"}); },
                                  {"a.exr", "expected a channel \"mean\", found Z, median"}));

  WriteDepthFile(folder / "a.npz", ramp, {.layer = "other"});
  EXPECT_TRUE(IsRamp(ReadDepthFile(folder / "a.npz")));
  EXPECT_TRUE(FailsWithInputError([&] { ReadDepthFile(folder / "a.npz", {.layer = "depth"}); },
                                  {"a.npz", "expected an array \"depth\", found other"}));
}

TEST(DepthFile, RawFilesNeedTheirExactSize) {
  const auto path = TestFolder() / "a.depth";
  const DepthMap ramp = MakeRamp();
  WriteFile(path, {reinterpret_cast<const char*>(ramp.z.data()), ramp.z.size() * sizeof(float)});
  EXPECT_TRUE(IsRamp(ReadDepthFile(path, {.raw_size = PlaneSize{kRampWidth, kRampHeight}})));
  EXPECT_TRUE(FailsWithInputError(
      [&] {
        ReadDepthFile(path, {.raw_size = PlaneSize{kRampWidth, 6}});
      },
      {"a.depth", "7 x 6 floats", "168 bytes, found 140"}));
  EXPECT_TRUE(FailsWithInputError([&] { ReadDepthFile(path); },
                                  {"a.depth", "expected a depth map", "needs its size"}));
}

TEST(DepthFile, FormatsFollowTheName) {
  EXPECT_EQ(DepthFileFormatFromName("a/b.c.EXR"), DepthFileFormat::kExr);
  EXPECT_EQ(DepthFileFormatFromName("b.jpg.npy.gz"), DepthFileFormat::kNpyGz);
  EXPECT_EQ(DepthFileFormatFromName("b.jpg.geometric.bin"), DepthFileFormat::kColmap);
  EXPECT_FALSE(DepthFileFormatFromName("b.jpg"));
  EXPECT_FALSE(DepthFileFormatFromName(".exr"));
  EXPECT_TRUE(FailsWithInputError([] { WriteDepthFile("/tmp/a.jpg", MakeRamp()); },
                                  {"a.jpg", "must end in .exr"}));
  EXPECT_THROW(WriteDepthFile("/tmp/a.tiff", MakeRamp(), {.sample = FloatSample::kFloat16}),
               OptionError);
}

TEST(DepthFile, FormatsAndOptionsHaveNames) {
  EXPECT_TRUE(NamesEveryValue<DepthFileFormat>());
  EXPECT_TRUE(NamesEveryValue<ExrCompression>());
  EXPECT_TRUE(NamesEveryValue<FloatSample>());
  EXPECT_TRUE(NamesEveryValue<DepthWriteOptions::OutOfRange>());
}

}  // namespace
}  // namespace raylift
