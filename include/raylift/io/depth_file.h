// Depth maps (and any other picture of one float per pixel) in the formats of the field. Reading
// gives the numbers as they are stored: what they mean (z or ray length, unit, which of them are
// holes) is for the caller to say, see lifting/depth_convention.h.

#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/scene/image.h"

namespace raylift {

enum class DepthFileFormat {
  kExr,     // OpenEXR: float16, float32 or uint32; scan lines or tiles, one or several parts
  kPng,     // gray, 8 or 16 bits
  kTiff,    // gray, integers of 8 to 32 bits, float32 or float64
  kPgm,     // binary, 8 or 16 bits
  kNpy,     // numpy: float16/32/64 and (u)int8/16/32/64, either byte order, C or Fortran order
  kNpz,     // numpy: a ZIP of those
  kNpyGz,   // an NPY in gzip, as nerfstudio writes it
  kColmap,  // COLMAP's dense maps (.bin)
  kPfm,     // portable float map, one channel
  kRaw,     // float32, little endian, without any header (kapture, ETH3D)
};
template <>
inline constexpr auto kEnumNames<DepthFileFormat> = std::to_array<EnumName<DepthFileFormat>>({
    {DepthFileFormat::kExr, "EXR"},
    {DepthFileFormat::kPng, "PNG"},
    {DepthFileFormat::kTiff, "TIFF"},
    {DepthFileFormat::kPgm, "PGM"},
    {DepthFileFormat::kNpy, "NPY"},
    {DepthFileFormat::kNpz, "NPZ"},
    {DepthFileFormat::kNpyGz, "NPY.GZ"},
    {DepthFileFormat::kColmap, "COLMAP"},
    {DepthFileFormat::kPfm, "PFM"},
    {DepthFileFormat::kRaw, "raw"},
});
// Returns the format that a file name asks for: .exr, .png, .tif, .tiff, .pgm, .npy, .npz, .npy.gz,
// .bin, .pfm, .depth.
std::optional<DepthFileFormat> DepthFileFormatFromName(const std::filesystem::path& path);

// A depth map as it is stored in a file.
struct StoredDepth {
  int width_px = 0;
  int height_px = 0;
  std::vector<float> values;  // row-major, the top row first, whatever the order in the file
  // Properties of the values that the file states.
  DepthFileFormat format = DepthFileFormat::kRaw;
  std::string sample_type;               // "uint16", "float32", ...
  std::string layer;                     // the channel of an EXR, the key of an NPZ
  std::optional<double> declared_scale;  // of a PFM, without its sign; not applied
};

struct DepthReadOptions {
  // The channel of an EXR ("Z", "part.Z", "layer.Z") or the key of an NPZ. Where it is empty: Z,
  // depth, R or Y, else the first channel; the key depth, else the only array.
  std::string layer = {};
  // The size of a file without a header; the file is then read as kRaw, whatever its content.
  std::optional<PlaneSize> raw_size = std::nullopt;
};

// Reads a depth map; the format follows from the content. Throws InputError naming the file for
// anything wrong: unknown content, a truncated file, a size that cannot be in a file of this
// length, samples of a wrong type, several channels where one is expected. No memory is allocated
// by an unchecked header. Thread safe.
StoredDepth ReadDepthFile(const std::filesystem::path& path, const DepthReadOptions& options = {});
StoredDepth ParseDepthFile(const std::filesystem::path& path_for_messages, std::string bytes,
                           const DepthReadOptions& options = {});

enum class ExrCompression { kNone, kZips, kZip, kPiz, kPxr24, kDwaa };
template <>
inline constexpr auto kEnumNames<ExrCompression> = std::to_array<EnumName<ExrCompression>>({
    {ExrCompression::kNone, "none"},
    {ExrCompression::kZips, "zips"},
    {ExrCompression::kZip, "zip"},
    {ExrCompression::kPiz, "piz"},
    {ExrCompression::kPxr24, "pxr24"},
    {ExrCompression::kDwaa, "dwaa"},
});

enum class FloatSample { kFloat32, kFloat16 };
template <>
inline constexpr auto kEnumNames<FloatSample> = std::to_array<EnumName<FloatSample>>({
    {FloatSample::kFloat32, "float"},
    {FloatSample::kFloat16, "half"},
});

// One float per pixel, row-major, the top row first.
struct FloatPlane {
  int width_px;
  int height_px;
  std::span<const float> values;

  FloatPlane(int width, int height, std::span<const float> plane_values)
      : width_px(width), height_px(height), values(plane_values) {}
  FloatPlane(const DepthMap& map)  // NOLINT(google-explicit-constructor): it is a view of it
      : width_px(map.width_px), height_px(map.height_px), values(map.z) {}
};

struct DepthWriteOptions {
  // By default the format that the file name asks for. kPgm, kNpyGz and kRaw can only be read.
  std::optional<DepthFileFormat> format = std::nullopt;
  FloatSample sample = FloatSample::kFloat32;  // of EXR, NPY and NPZ
  // PXR24 keeps 24 of a float32's bits (relative error below 2^-16), float16 exactly.
  ExrCompression exr_compression = ExrCompression::kPxr24;
  bool deflate_npz = false;  // numpy reads both; stored is some 20 times faster to write
  // By default the key "depth" of an NPZ, and the channel "Y" of an EXR, which viewers take for
  // gray; OpenCV silently reads a file with "Z" alone as zeros.
  std::string layer = {};
  double png_step = 0.001;  // scene units per count of a 16-bit PNG
  int png_compression = 1;  // 0 .. 9
  // For a value that the format cannot hold (above 65535 steps of a PNG, or 65504 in float16):
  // kRefuse throws, kDrop stores 0 (no depth) and counts it.
  enum class OutOfRange { kRefuse, kDrop };
  OutOfRange out_of_range = OutOfRange::kRefuse;
};
template <>
inline constexpr auto kEnumNames<DepthWriteOptions::OutOfRange> =
    std::to_array<EnumName<DepthWriteOptions::OutOfRange>>({
        {DepthWriteOptions::OutOfRange::kRefuse, "refuse"},
        {DepthWriteOptions::OutOfRange::kDrop, "drop"},
    });

struct DepthWriteReport {
  size_t bytes = 0;
  size_t dropped = 0;       // stored as 0 although they are not: out of range, or below a step
  double max_rounding = 0;  // the largest change of a value that was kept, scene units
};

// Writes a depth map. The file appears complete or not at all, and the same values give the same
// bytes. Thread safe; uses no threads of its own. Throws InputError naming the file where it cannot
// be written or a value is out of range, OptionError for an option that the format does not know.
DepthWriteReport WriteDepthFile(const std::filesystem::path& path, const FloatPlane& plane,
                                const DepthWriteOptions& options = {});

// Writes x, y, z per pixel, row-major, the top row first. The format follows from the file name, or
// `options.format`:
//   .exr  channels R, G, B (x, y, z)         .npy, .npz  an array (height, width, 3), key
//   .bin  COLMAP's normal maps (planar)                  `options.layer`, by default "normals"
// Returns the file's size in bytes. Errors as WriteDepthFile.
size_t WriteVectorMap(const std::filesystem::path& path, PlaneSize size,
                      std::span<const float> vectors, const DepthWriteOptions& options = {});

// Writes one integer per pixel without loss: .exr (uint32, channel "id"), .npy, .npz (uint32, key
// "id"), .png (16 bits, in which 4294967295 is stored as 65535).
size_t WriteIndexMap(const std::filesystem::path& path, PlaneSize size,
                     std::span<const uint32_t> indices, const DepthWriteOptions& options = {});

}  // namespace raylift
