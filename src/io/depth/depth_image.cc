// Depth maps in PNG and TIFF. The headers are looked at first, as libpng and libtiff take the
// memory that they claim.

#include <algorithm>
#include <array>
#include <cctype>
#include <optional>
#include <stdexcept>

#include "base/bytes.h"
#include "base/read_limits.h"
#include "io/depth/depth_formats.h"
#include "pictures/codecs.h"
#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr std::string_view kPngMagic("\x89PNG\r\n\x1a\n", 8);

// The entries of a TIFF file's first directory.
struct TiffFacts {
  uint64_t width = 0;
  uint64_t height = 0;
  uint64_t bits_per_sample = 1;
  uint64_t samples_per_pixel = 1;
  std::optional<uint64_t> sample_format;  // 1: unsigned, 2: signed, 3: float
  uint64_t compression = 1;               // 1: none
};

class TiffDirectory {
 public:
  TiffDirectory(const path& file, std::string_view bytes)
      : file_(file), bytes_(bytes), big_endian_(bytes[0] == 'M') {
    big_ = Load<uint16_t>(2) == 43;
  }

  TiffFacts Read() const {
    TiffFacts facts;
    const uint64_t start = big_ ? Load<uint64_t>(8) : Load<uint32_t>(4);
    const uint64_t count = big_ ? Load<uint64_t>(start) : Load<uint16_t>(start);
    const uint64_t first = start + (big_ ? 8 : 2);
    const uint64_t entry_size = big_ ? 20 : 12;
    if (count > bytes_.size() / entry_size) Fail();
    for (uint64_t i = 0; i < count; ++i) {
      const uint64_t entry = first + i * entry_size;
      const auto tag = Load<uint16_t>(entry);
      if (uint64_t* field = FieldOf(tag, facts)) *field = Value(entry);
    }
    // The place of the next directory ends this one; files are often cut short here.
    Load<uint32_t>(first + count * entry_size + (big_ ? 4 : 0));
    return facts;
  }

 private:
  static uint64_t* FieldOf(uint16_t tag, TiffFacts& facts) {
    switch (tag) {
      case 256:
        return &facts.width;
      case 257:
        return &facts.height;
      case 258:
        return &facts.bits_per_sample;
      case 259:
        return &facts.compression;
      case 277:
        return &facts.samples_per_pixel;
      case 339:
        return &facts.sample_format.emplace();
      default:
        return nullptr;
    }
  }

  // The first number of an entry. A list of several (one per channel) stands elsewhere.
  uint64_t Value(uint64_t entry) const {
    const auto type = Load<uint16_t>(entry + 2);
    const uint64_t count = big_ ? Load<uint64_t>(entry + 4) : Load<uint32_t>(entry + 4);
    const uint64_t inline_at = entry + (big_ ? 12 : 8);
    if (type == 4) return Load<uint32_t>(inline_at);
    if (type == 16) return Load<uint64_t>(inline_at);
    if (type != 3) Fail();
    const bool is_inline = count <= (big_ ? 4 : 2);
    const uint64_t at = is_inline ? inline_at
                        : big_    ? Load<uint64_t>(inline_at)
                                  : Load<uint32_t>(inline_at);
    return Load<uint16_t>(at);
  }

  template <typename T>
  T Load(uint64_t offset) const {
    if (offset > bytes_.size() || bytes_.size() - offset < sizeof(T)) Fail();
    return LoadNumber<T>(bytes_.data() + offset, big_endian_);
  }
  [[noreturn]] void Fail() const {
    throw InputError(file_, "the TIFF file is damaged or truncated");
  }

  const path& file_;
  std::string_view bytes_;
  bool big_endian_;
  bool big_;  // BigTIFF
};

// Depth needs but 31 of 32 bits: larger counts become negative, which is no depth.
std::optional<TiffSample> SampleOf(uint64_t bits, uint64_t format) {
  constexpr uint64_t kUnsigned = 1, kSigned = 2, kFloat = 3;
  if (format == kUnsigned && bits == 8) return TiffSample::kUint8;
  if (format == kUnsigned && bits == 16) return TiffSample::kUint16;
  if (format == kSigned && bits == 16) return TiffSample::kInt16;
  if ((format == kUnsigned || format == kSigned) && bits == 32) return TiffSample::kInt32;
  if (format == kFloat && bits == 32) return TiffSample::kFloat32;
  if (format == kFloat && bits == 64) return TiffSample::kFloat64;
  return std::nullopt;
}

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

StoredDepth DecodeTiff(const path& file, std::string_view bytes) {
  const TiffFacts facts = TiffDirectory(file, bytes).Read();
  const uint64_t bits = facts.bits_per_sample;
  const uint64_t format = facts.sample_format.value_or(1);
  const auto sample = SampleOf(bits, format);
  if (facts.samples_per_pixel != 1 || !sample) {
    constexpr std::array<const char*, 4> kNames = {"unknown", "unsigned", "signed", "float"};
    throw InputError(
        file,
        fmt::format("expected a TIFF of one channel of 8 to 32 bits, or 32 or 64 bits float, found "
                    "{} of {} bits {}",
                    facts.samples_per_pixel, bits, kNames[format < 4 ? format : 0]));
  }
  if (bits == 32 && !facts.sample_format) {
    throw InputError(file, "expected a TIFF of 32 bits that says what they are (SampleFormat)");
  }
  const uint64_t inflation = facts.compression == 1 ? 1 : kMaxDeflateRatio;
  CheckClaimedSize(file, facts.width, facts.height, inflation * bytes.size() * 8 / bits);
  StoredDepth depth;
  depth.width_px = static_cast<int>(facts.width);
  depth.height_px = static_cast<int>(facts.height);
  depth.format = DepthFileFormat::kTiff;
  depth.sample_type = SampleName(*sample);
  try {
    depth.values = DecodeTiffPlane(bytes, {depth.width_px, depth.height_px}, *sample);
  } catch (const std::runtime_error& error) {
    throw InputError(file, error.what());
  }
  return depth;
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
