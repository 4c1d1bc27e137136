// Converts single depth map formats between bytes and floats.

#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>

#include "raylift/io/depth_file.h"
#include "raylift/scene/image.h"

namespace raylift {

// Throws InputError where a header claims a size that is no depth map's, or that takes more than
// `max_pixels_in_file`.
void CheckClaimedSize(const std::filesystem::path& path, uint64_t width, uint64_t height,
                      uint64_t max_pixels_in_file);

bool IsExr(std::string_view bytes);
StoredDepth DecodeExr(const std::filesystem::path& path, std::string_view bytes,
                      const std::string& channel);
// One of several channels of one size.
struct ExrChannel {
  std::string name;
  std::span<const float> values;
};
std::string EncodeExr(const std::filesystem::path& path, PlaneSize size,
                      std::span<const ExrChannel> channels, ExrCompression compression,
                      FloatSample sample);
// Returns an EXR of one channel "id" of uint32.
std::string EncodeExrIndices(const std::filesystem::path& path, PlaneSize size,
                             std::span<const uint32_t> indices, ExrCompression compression);

StoredDepth DecodeNpy(const std::filesystem::path& path, std::string_view bytes);
// Returns what stands before the data of an array, for instance of ("<f4", "(480, 640)").
std::string NpyHeaderBytes(std::string_view descr, std::string_view shape);
void AppendSamples(std::span<const float> values, FloatSample sample, std::string& bytes);
std::string EncodeNpy(std::string_view shape, std::span<const float> values, FloatSample sample);

StoredDepth DecodeNpz(const std::filesystem::path& path, std::string_view bytes,
                      const std::string& key);

bool IsGzip(std::string_view bytes);
StoredDepth DecodeNpyGz(const std::filesystem::path& path, std::string_view bytes);

bool IsPng(std::string_view bytes);
bool IsTiff(std::string_view bytes);
bool IsPgm(std::string_view bytes);
StoredDepth DecodePng(const std::filesystem::path& path, std::string_view bytes);
StoredDepth DecodeTiff(const std::filesystem::path& path, std::string_view bytes);
StoredDepth DecodePgm(const std::filesystem::path& path, std::string& bytes);
std::string EncodeTiff(const std::filesystem::path& path, const FloatPlane& plane);

bool IsColmapMap(std::string_view bytes);
StoredDepth DecodeColmapMap(const std::filesystem::path& path, std::string_view bytes);
std::string EncodeColmapMap(const FloatPlane& plane);

bool IsPfm(std::string_view bytes);
StoredDepth DecodePfm(const std::filesystem::path& path, std::string_view bytes);
std::string EncodePfm(const FloatPlane& plane);

StoredDepth DecodeRaw(const std::filesystem::path& path, std::string_view bytes, PlaneSize size);

// Converts floats to formats of 16 bits, float16 and integer steps, by plain loops over lanes that
// are compiled for several instruction sets; all give the same bits (sample_rounding.cc).

inline constexpr float kMaxHalf = 65504;

// Computes the bits of the nearest float16 of each value, ties to even. Infinite and NaN stay as
// they are; finite values beyond kMaxHalf, which float16 cannot hold, become 0 and are counted as
// dropped, as are those that round to 0. Returns how many were beyond.
size_t RoundToHalf(std::span<const float> values, std::span<uint16_t> halves,
                   DepthWriteReport& report);

// Computes the nearest integer number of steps, halves upwards. Values that are not in 0 .. 65535
// steps become 0 and are counted as dropped, as are values that round to 0. Returns how many were
// beyond. `step` > 0.
size_t RoundToSteps(std::span<const float> values, double step, std::span<uint16_t> counts,
                    DepthWriteReport& report);

}  // namespace raylift
