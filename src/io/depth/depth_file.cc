#include "raylift/io/depth_file.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cctype>
#include <cmath>
#include <utility>

#include "base/bytes.h"
#include "base/input_paths.h"
#include "base/read_limits.h"
#include "io/binary/npy_array.h"
#include "io/binary/zip_archive.h"
#include "io/depth/depth_formats.h"
#include "pictures/codecs.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr std::array<std::pair<std::string_view, DepthFileFormat>, 11> kExtensions = {{
    {".exr", DepthFileFormat::kExr},
    {".png", DepthFileFormat::kPng},
    {".tif", DepthFileFormat::kTiff},
    {".tiff", DepthFileFormat::kTiff},
    {".pgm", DepthFileFormat::kPgm},
    {".npy", DepthFileFormat::kNpy},
    {".npz", DepthFileFormat::kNpz},
    {".npy.gz", DepthFileFormat::kNpyGz},
    {".bin", DepthFileFormat::kColmap},
    {".pfm", DepthFileFormat::kPfm},
    {".depth", DepthFileFormat::kRaw},
}};

// Throws for a value that the format cannot hold: the first one for which `fits` is false.
template <typename Fits>
[[noreturn]] void Refuse(const path& file, const FloatPlane& plane, std::string_view limit,
                         const Fits& fits) {
  const auto found = std::find_if_not(plane.values.begin(), plane.values.end(), fits);
  RAYLIFT_CHECK(found != plane.values.end());
  const auto index = static_cast<size_t>(found - plane.values.begin());
  const auto width = static_cast<size_t>(plane.width_px);
  throw InputError(file, fmt::format("pixel ({}, {})", index % width, index / width),
                   fmt::format("expected a value of at most {}, found {}", limit, *found));
}

std::vector<uint16_t> CountSteps(const path& file, const FloatPlane& plane,
                                 const DepthWriteOptions& options, DepthWriteReport& report) {
  const double step = options.png_step;
  if (!(step > 0) || !std::isfinite(step)) {
    throw OptionError("png_step", fmt::format("{}", step), "must be positive");
  }
  std::vector<uint16_t> counts(plane.values.size());
  const size_t beyond = RoundToSteps(plane.values, step, counts, report);
  if (beyond > 0 && options.out_of_range == DepthWriteOptions::OutOfRange::kRefuse) {
    Refuse(file, plane, fmt::format("65535 steps of {}, that is {}", step, 65535 * step),
           [step](float value) { return value / step > -0.5 && value / step < 65535.5; });
  }
  return counts;
}

// Rounds the values as float16 does. The encoders round in the same way.
void CheckHalf(const path& file, const FloatPlane& plane, const DepthWriteOptions& options,
               DepthWriteReport& report) {
  std::vector<uint16_t> halves(plane.values.size());
  const size_t beyond = RoundToHalf(plane.values, halves, report);
  if (beyond > 0 && options.out_of_range == DepthWriteOptions::OutOfRange::kRefuse) {
    Refuse(file, plane, "65504, float16's largest",
           [](float value) { return !std::isfinite(value) || std::abs(value) <= kMaxHalf; });
  }
}

DepthFileFormat FormatToWrite(const path& file, const DepthWriteOptions& options) {
  const auto format = options.format ? options.format : DepthFileFormatFromName(file);
  if (!format) {
    throw InputError(file,
                     "the name of a depth map to write must end in .exr, .npy, .npz, .png, .tif, "
                     ".tiff, .bin or .pfm");
  }
  return *format;
}

// Returns a shape as numpy writes it.
std::string ShapeText(PlaneSize size) {
  return fmt::format("({}, {})", size.height_px, size.width_px);
}

std::string Zipped(const path& file, const std::string& key, const std::string& npy,
                   const DepthWriteOptions& options) {
  return MakeZip(file, key + ".npy", npy,
                 options.deflate_npz ? ZipMethod::kDeflate : ZipMethod::kStore);
}

std::string Encode(const path& file, const FloatPlane& plane, DepthFileFormat format,
                   const DepthWriteOptions& options) {
  const PlaneSize size{plane.width_px, plane.height_px};
  switch (format) {
    case DepthFileFormat::kExr: {
      const ExrChannel channel{options.layer.empty() ? "Y" : options.layer, plane.values};
      return EncodeExr(file, size, {&channel, 1}, options.exr_compression, options.sample);
    }
    case DepthFileFormat::kNpy:
      return EncodeNpy(ShapeText(size), plane.values, options.sample);
    case DepthFileFormat::kNpz:
      return Zipped(file, options.layer.empty() ? "depth" : options.layer,
                    EncodeNpy(ShapeText(size), plane.values, options.sample), options);
    case DepthFileFormat::kTiff:
      return EncodeTiff(file, plane);
    case DepthFileFormat::kColmap:
      return EncodeColmapMap(plane);
    case DepthFileFormat::kPfm:
      return EncodePfm(plane);
    case DepthFileFormat::kPng:
    case DepthFileFormat::kPgm:
    case DepthFileFormat::kNpyGz:
    case DepthFileFormat::kRaw:
      break;
  }
  throw InputError(file, fmt::format("{} files are read only", ToString(format)));
}

// Returns the header of a format that holds the values as they are in memory; nullopt for others.
std::optional<std::string> PlainHeader(const FloatPlane& plane, DepthFileFormat format,
                                       const DepthWriteOptions& options) {
  if (std::endian::native != std::endian::little || options.sample != FloatSample::kFloat32) {
    return std::nullopt;
  }
  if (format == DepthFileFormat::kNpy) {
    return NpyHeaderBytes("<f4", ShapeText({plane.width_px, plane.height_px}));
  }
  if (format == DepthFileFormat::kColmap) {
    return fmt::format("{}&{}&1&", plane.width_px, plane.height_px);
  }
  return std::nullopt;
}

size_t WritePlain(const path& file, const std::string& header, const FloatPlane& plane) {
  const std::array<std::string_view, 2> parts = {header, AsBytes(plane.values)};
  WriteFile(file, parts);
  return parts[0].size() + parts[1].size();
}

bool HoldsHalf(DepthFileFormat format) {
  return format == DepthFileFormat::kExr || format == DepthFileFormat::kNpy ||
         format == DepthFileFormat::kNpz;
}

size_t NumPixels(PlaneSize size) {
  RAYLIFT_CHECK(size.width_px > 0 && size.height_px > 0);
  return static_cast<size_t>(size.width_px) * static_cast<size_t>(size.height_px);
}

DepthFileFormat FormatOf(const path& file, const DepthWriteOptions& options) {
  const auto format = options.format ? options.format : DepthFileFormatFromName(file);
  if (!format) throw InputError(file, "the name must end in .exr, .npy, .npz or .bin");
  return *format;
}

[[noreturn]] void FailAs(const path& file, DepthFileFormat format, std::string_view what) {
  throw InputError(file, fmt::format("{} files hold no {}", ToString(format), what));
}

// Returns the values of one component after the other.
std::vector<float> Planar(std::span<const float> interleaved, size_t pixels) {
  std::vector<float> planar(interleaved.size());
  for (size_t i = 0; i < pixels; ++i) {
    for (size_t c = 0; c < 3; ++c) planar[c * pixels + i] = interleaved[3 * i + c];
  }
  return planar;
}

std::string EncodeVectorsExr(const path& file, PlaneSize size, std::span<const float> vectors,
                             const DepthWriteOptions& options) {
  const size_t pixels = NumPixels(size);
  const std::vector<float> planar = Planar(vectors, pixels);
  const std::span<const float> all(planar);
  const std::array<ExrChannel, 3> channels = {{{"R", all.subspan(0, pixels)},
                                               {"G", all.subspan(pixels, pixels)},
                                               {"B", all.subspan(2 * pixels, pixels)}}};
  return EncodeExr(file, size, channels, options.exr_compression, options.sample);
}

std::string EncodeIndicesNpy(PlaneSize size, std::span<const uint32_t> indices) {
  std::string bytes = NpyHeaderBytes("<u4", ShapeText(size));
  bytes += AsBytes(indices);
  return bytes;
}

std::string EncodeVectors(const path& file, PlaneSize size, std::span<const float> vectors,
                          const DepthWriteOptions& options) {
  const DepthFileFormat format = FormatOf(file, options);
  if (format == DepthFileFormat::kExr) return EncodeVectorsExr(file, size, vectors, options);
  if (format == DepthFileFormat::kNpy || format == DepthFileFormat::kNpz) {
    const std::string npy = EncodeNpy(fmt::format("({}, {}, 3)", size.height_px, size.width_px),
                                      vectors, options.sample);
    if (format == DepthFileFormat::kNpy) return npy;
    return Zipped(file, options.layer.empty() ? "normals" : options.layer, npy, options);
  }
  if (format != DepthFileFormat::kColmap) FailAs(file, format, "vectors");
  std::string bytes = fmt::format("{}&{}&3&", size.width_px, size.height_px);
  AppendSamples(Planar(vectors, NumPixels(size)), FloatSample::kFloat32, bytes);
  return bytes;
}

// Returns the ids in 16 bits; the largest number, which means none, stays the largest.
std::vector<uint16_t> As16Bits(const path& file, std::span<const uint32_t> indices) {
  std::vector<uint16_t> narrow;
  narrow.reserve(indices.size());
  for (const uint32_t index : indices) {
    if (index >= UINT16_MAX && index != UINT32_MAX) {
      throw InputError(file, fmt::format("the id {} is beyond the 65534 of a PNG of 16 bits: NPY, "
                                         "NPZ and EXR hold it",
                                         index));
    }
    narrow.push_back(static_cast<uint16_t>(index));
  }
  return narrow;
}

std::string EncodeIndices(const path& file, PlaneSize size, std::span<const uint32_t> indices,
                          const DepthWriteOptions& options) {
  const DepthFileFormat format = FormatOf(file, options);
  if (format == DepthFileFormat::kExr) {
    return EncodeExrIndices(file, size, indices, options.exr_compression);
  }
  if (format == DepthFileFormat::kNpy) return EncodeIndicesNpy(size, indices);
  if (format == DepthFileFormat::kPng) {
    return EncodePng16(file, size, As16Bits(file, indices), options.png_compression);
  }
  if (format != DepthFileFormat::kNpz) FailAs(file, format, "whole numbers of 32 bits");
  return Zipped(file, "id", EncodeIndicesNpy(size, indices), options);
}

}  // namespace

std::optional<DepthFileFormat> DepthFileFormatFromName(const path& file) {
  const std::string name = Lower(file.filename().string());
  for (const auto& [extension, format] : kExtensions) {
    if (name.size() > extension.size() && name.ends_with(extension)) return format;
  }
  return std::nullopt;
}

void CheckClaimedSize(const path& file, uint64_t width, uint64_t height,
                      uint64_t max_pixels_in_file) {
  if (width == 0 || height == 0) {
    throw InputError(file,
                     fmt::format("expected at least one pixel, found {} x {}", width, height));
  }
  if (width > kMaxImageSidePx || height > kMaxImageSidePx || width * height > kMaxDepthMapPixels) {
    throw InputError(file, fmt::format("claims {} x {} pixels; a depth map has at most {}", width,
                                       height, kMaxDepthMapPixels));
  }
  if (width * height > max_pixels_in_file) {
    throw InputError(file, fmt::format("claims {} x {} pixels, more than the file can hold: it is "
                                       "truncated or its header is wrong",
                                       width, height));
  }
}

StoredDepth ParseDepthFile(const path& file, std::string bytes, const DepthReadOptions& options) {
  if (options.raw_size) return DecodeRaw(file, bytes, *options.raw_size);
  if (IsExr(bytes)) return DecodeExr(file, bytes, options.layer);
  if (IsNpy(bytes)) return DecodeNpy(file, bytes);
  if (IsZip(bytes)) return DecodeNpz(file, bytes, options.layer);
  if (IsGzip(bytes)) return DecodeNpyGz(file, bytes);
  if (IsPng(bytes)) return DecodePng(file, bytes);
  if (IsTiff(bytes)) return DecodeTiff(file, bytes);
  if (IsPgm(bytes)) return DecodePgm(file, bytes);
  if (IsPfm(bytes)) return DecodePfm(file, bytes);
  if (IsColmapMap(bytes)) return DecodeColmapMap(file, bytes);
  throw InputError(file, bytes.empty()
                             ? "expected a depth map, found an empty file"
                             : "expected a depth map (EXR, PNG, TIFF, PGM, NPY, NPZ, NPY.GZ, PFM, "
                               "COLMAP's .bin), found none of them; one without a header needs its "
                               "size");
}

StoredDepth ReadDepthFile(const path& file, const DepthReadOptions& options) {
  return ParseDepthFile(file, ReadFile(file), options);
}

DepthWriteReport WriteDepthFile(const path& file, const FloatPlane& plane,
                                const DepthWriteOptions& options) {
  RAYLIFT_CHECK(plane.width_px > 0 && plane.height_px > 0);
  RAYLIFT_CHECK_EQ(plane.values.size(),
                   static_cast<size_t>(plane.width_px) * static_cast<size_t>(plane.height_px));
  const DepthFileFormat format = FormatToWrite(file, options);
  DepthWriteReport report;
  if (const auto header = PlainHeader(plane, format, options)) {
    report.bytes = WritePlain(file, *header, plane);
    return report;
  }
  std::string bytes;
  if (format == DepthFileFormat::kPng) {
    const std::vector<uint16_t> counts = CountSteps(file, plane, options, report);
    bytes = EncodePng16(file, {plane.width_px, plane.height_px}, counts, options.png_compression);
  } else if (options.sample == FloatSample::kFloat16) {
    if (!HoldsHalf(format)) {
      throw OptionError(fmt::format("{} files hold no float16", ToString(format)));
    }
    CheckHalf(file, plane, options, report);
    bytes = Encode(file, plane, format, options);
  } else {
    bytes = Encode(file, plane, format, options);
  }
  WriteFile(file, bytes);
  report.bytes = bytes.size();
  return report;
}

size_t WriteVectorMap(const path& file, PlaneSize size, std::span<const float> vectors,
                      const DepthWriteOptions& options) {
  RAYLIFT_CHECK_EQ(vectors.size(), 3 * NumPixels(size));
  const std::string bytes = EncodeVectors(file, size, vectors, options);
  WriteFile(file, bytes);
  return bytes.size();
}

size_t WriteIndexMap(const path& file, PlaneSize size, std::span<const uint32_t> indices,
                     const DepthWriteOptions& options) {
  RAYLIFT_CHECK_EQ(indices.size(), NumPixels(size));
  const std::string bytes = EncodeIndices(file, size, indices, options);
  WriteFile(file, bytes);
  return bytes.size();
}

}  // namespace raylift
