// Depth maps in PNG and TIFF. The headers are looked at first, as libpng and libtiff take the
// memory that they claim.

#include <array>
#include <stdexcept>

#include "base/read_limits.h"
#include "io/depth/depth_formats.h"
#include "pictures/codecs.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr std::string_view kPngMagic("\x89PNG\r\n\x1a\n", 8);

std::string SampleName(TiffSample sample) {
  switch (sample) {
    case TiffSample::kUint8:
      return "uint8";
    case TiffSample::kUint16:
      return "uint16";
    case TiffSample::kInt16:
      return "int16";
    case TiffSample::kInt32:
      return "int32";
    case TiffSample::kFloat32:
      return "float32";
    case TiffSample::kFloat64:
      return "float64";
  }
  return {};
}

}  // namespace

bool IsPng(std::string_view bytes) { return bytes.starts_with(kPngMagic); }

StoredDepth DecodePng(const path& file, std::string_view bytes) {
  const PngHeader header = ReadPngHeader(file, bytes);
  if (!header.is_gray || (header.bits != 8 && header.bits != 16)) {
    throw InputError(
        file,
        fmt::format("expected a gray PNG of 16 bits, found {} of {} bits",
                    header.is_gray ? "a gray one" : "one in colors or with alpha", header.bits));
  }
  CheckClaimedSize(file, header.width_px, header.height_px,
                   kMaxDeflateRatio * bytes.size() * 8 / static_cast<uint64_t>(header.bits));
  StoredDepth depth;
  depth.width_px = static_cast<int>(header.width_px);
  depth.height_px = static_cast<int>(header.height_px);
  depth.format = DepthFileFormat::kPng;
  depth.sample_type = header.bits == 8 ? "uint8" : "uint16";
  depth.values = DecodeGrayPng(file, header, bytes);
  return depth;
}

bool IsTiff(std::string_view bytes) {
  using namespace std::string_view_literals;
  return bytes.starts_with("II*\0"sv) || bytes.starts_with("MM\0*"sv) ||
         bytes.starts_with("II+\0"sv) || bytes.starts_with("MM\0+"sv);
}

namespace {

StoredDepth DecodePlane(const path& file, std::string_view bytes) {
  TiffForm form = ReadTiffForm(bytes);
  const bool is_said = form.format.has_value();
  const uint16_t format = form.format.value_or(1);
  // Depth needs but 31 of 32 bits: larger counts become negative, which is no depth.
  if (form.bits == 32 && format == 1) form.format = 2;
  const auto sample = form.Sample();
  if (!sample) {
    constexpr std::array<const char*, 4> kNames = {"unknown", "unsigned", "signed", "float"};
    throw InputError(
        file,
        fmt::format("expected a TIFF of one channel of 8 to 32 bits, or 32 or 64 bits float, found "
                    "{} of {} bits {}",
                    form.channels, form.bits, kNames[format < 4 ? format : 0]));
  }
  if (form.bits == 32 && !is_said) {
    throw InputError(file, "expected a TIFF of 32 bits that says what they are (SampleFormat)");
  }
  const uint64_t inflation = form.is_compressed ? kMaxDeflateRatio : 1;
  CheckClaimedSize(file, form.width_px, form.height_px, inflation * bytes.size() * 8 / form.bits);
  StoredDepth depth;
  depth.width_px = static_cast<int>(form.width_px);
  depth.height_px = static_cast<int>(form.height_px);
  depth.format = DepthFileFormat::kTiff;
  depth.sample_type = SampleName(*sample);
  depth.values = DecodeTiffPlane(bytes, {depth.width_px, depth.height_px}, *sample);
  return depth;
}

}  // namespace

StoredDepth DecodeTiff(const path& file, std::string_view bytes) {
  try {
    return DecodePlane(file, bytes);
  } catch (const InputError&) {
    throw;
  } catch (const std::runtime_error& error) {
    throw InputError(file, error.what());
  }
}

std::string EncodeTiff(const path& file, const FloatPlane& plane) {
  try {
    return EncodeTiffPlane({plane.width_px, plane.height_px}, plane.values);
  } catch (const std::runtime_error& error) {
    throw InputError(file, fmt::format("the TIFF file cannot be made: {}", error.what()));
  }
}

bool IsPgm(std::string_view bytes) {
  return bytes.size() > 2 && bytes.starts_with("P5") &&
         std::isspace(static_cast<unsigned char>(bytes[2])) != 0;
}

}  // namespace raylift
