// Decodes and encodes single formats. Decoders throw std::runtime_error for what is damaged; their
// callers have looked at the claimed size (picture_codec.h).

#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "pictures/picture_codec.h"

#include "raylift/scene/image.h"

namespace raylift {

// Returns a picture of this size whose pixels are to be filled in.
inline Image BlankImage(int width_px, int height_px, int channels) {
  Image image{width_px, height_px, channels, {}};
  image.data.resize(static_cast<size_t>(width_px) * static_cast<size_t>(height_px) *
                    static_cast<size_t>(channels));
  return image;
}

// Decode to red, green and blue; JPEG, PNG and PNM to gray where the file is.
Image DecodeJpeg(std::string_view bytes);
Image DecodePng(std::string_view bytes);
Image DecodeBmp(std::string_view bytes);
Image DecodePnm(std::string_view bytes);
Image DecodeTiff(std::string_view bytes);
// Throws also where the picture is not of the expected size.
Image DecodeWebp(std::string_view bytes, std::optional<PlaneSize> expected = std::nullopt);

// Returns lossless WebP of RGB; nullopt where a side has more than its 16383 pixels.
std::optional<std::string> EncodeWebp(const Image& image);

// ---- planes of numbers in TIFF files, by libtiff ----

enum class TiffSample { kUint8, kUint16, kInt16, kInt32, kFloat32, kFloat64 };

// Returns the only channel of a file that holds such samples, row by row. Throws std::runtime_error
// where it holds others, or is damaged or truncated.
std::vector<float> DecodeTiffPlane(std::string_view bytes, PlaneSize size, TiffSample sample);

// The tags that georeference a GeoTIFF (OGC 19-008r4), as they are; empty where it lacks one.
struct GeoTiffTags {
  std::vector<double> pixel_scale;     // ModelPixelScaleTag
  std::vector<double> tie_points;      // ModelTiepointTag
  std::vector<double> transformation;  // ModelTransformationTag
  std::vector<uint16_t> keys;          // GeoKeyDirectoryTag
  std::string no_data;                 // GDAL's GDAL_NODATA
};
// The samples of a file as it claims them; format 1: unsigned, 2: signed, 3: float.
struct TiffForm {
  uint32_t width_px = 0, height_px = 0;
  uint16_t bits = 0, channels = 0;
  std::optional<uint16_t> format;
  bool is_compressed = false;

  // Returns the type of the only channel's samples; nullopt where there are several channels or it
  // is another type.
  std::optional<TiffSample> Sample() const;
};
struct TiffHeader {
  PlaneSize size;
  std::optional<TiffSample> sample;
  GeoTiffTags place;
};
// Throw std::runtime_error where the file is damaged; ReadTiffHeader() also where a side is longer
// than that of pictures may be.
TiffForm ReadTiffForm(std::string_view bytes);
TiffHeader ReadTiffHeader(std::string_view bytes);

// Encodes 32-bit floats without compression.
std::string EncodeTiffPlane(PlaneSize size, std::span<const float> values);

// ---- gray PNG files of depth, by libpng ----

// Encodes samples of 16 bits; `compression` is that of deflate, 0 .. 9. Every row is stored as its
// difference from the row above, which for depth takes half of the time of choosing a filter for
// each row, at a few per cent of size.
std::string EncodePng16(const std::filesystem::path& path_for_messages, PlaneSize size,
                        std::span<const uint16_t> counts, int compression);

// The header of a PNG file.
struct PngHeader {
  uint32_t width_px = 0;
  uint32_t height_px = 0;
  int bits = 0;
  bool is_gray = false;  // one channel, without alpha and palette
};
PngHeader ReadPngHeader(const std::filesystem::path& path_for_messages, std::string_view bytes);

// Returns the samples of a file whose header says gray and 8 or 16 bits, row by row. Throws
// InputError where the file is damaged or truncated: every checksum and the end are looked at.
std::vector<float> DecodeGrayPng(const std::filesystem::path& path_for_messages,
                                 const PngHeader& header, std::string_view bytes);

}  // namespace raylift
