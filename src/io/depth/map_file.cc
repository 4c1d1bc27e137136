#include "raylift/io/map_file.h"

#include <array>
#include <cstring>
#include <string>
#include <vector>

#include "io/binary/zip_archive.h"
#include "io/depth/depth_formats.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

using std::filesystem::path;

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

// The values of one component after the other.
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

std::string EncodeVectorsNpy(PlaneSize size, std::span<const float> vectors, FloatSample sample) {
  const bool half = sample == FloatSample::kFloat16;
  std::string bytes = NpyHeaderBytes(half ? "<f2" : "<f4",
                                     fmt::format("({}, {}, 3)", size.height_px, size.width_px));
  AppendSamples(vectors, sample, bytes);
  return bytes;
}

std::string EncodeIndicesNpy(PlaneSize size, std::span<const uint32_t> indices) {
  std::string bytes = NpyHeaderBytes("<u4", fmt::format("({}, {})", size.height_px, size.width_px));
  bytes.append(reinterpret_cast<const char*>(indices.data()), indices.size_bytes());
  return bytes;
}

std::string Zipped(const path& file, const std::string& key, const std::string& npy,
                   const DepthWriteOptions& options) {
  return MakeZip(file, key + ".npy", npy,
                 options.deflate_npz ? ZipMethod::kDeflate : ZipMethod::kStore);
}

std::string EncodeVectors(const path& file, PlaneSize size, std::span<const float> vectors,
                          const DepthWriteOptions& options) {
  const DepthFileFormat format = FormatOf(file, options);
  if (format == DepthFileFormat::kExr) return EncodeVectorsExr(file, size, vectors, options);
  if (format == DepthFileFormat::kNpy) return EncodeVectorsNpy(size, vectors, options.sample);
  if (format == DepthFileFormat::kNpz) {
    const std::string key = options.layer.empty() ? "normals" : options.layer;
    return Zipped(file, key, EncodeVectorsNpy(size, vectors, options.sample), options);
  }
  if (format != DepthFileFormat::kColmap) FailAs(file, format, "vectors");
  std::string bytes = fmt::format("{}&{}&3&", size.width_px, size.height_px);
  AppendSamples(Planar(vectors, NumPixels(size)), FloatSample::kFloat32, bytes);
  return bytes;
}

std::string EncodeIndices(const path& file, PlaneSize size, std::span<const uint32_t> indices,
                          const DepthWriteOptions& options) {
  const DepthFileFormat format = FormatOf(file, options);
  if (format == DepthFileFormat::kExr) {
    return EncodeExrIndices(file, size, indices, options.exr_compression);
  }
  if (format == DepthFileFormat::kNpy) return EncodeIndicesNpy(size, indices);
  if (format != DepthFileFormat::kNpz) FailAs(file, format, "whole numbers of 32 bits");
  return Zipped(file, "id", EncodeIndicesNpy(size, indices), options);
}

}  // namespace

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
