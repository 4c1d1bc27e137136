// Depth maps in PNG, by libpng, and TIFF, by OpenCV. The headers are looked at first: both take the
// memory that they claim, and OpenCV reads some sample types as if they were others.

#include <algorithm>
#include <array>
#include <bit>
#include <cctype>
#include <cstring>

#include "io/depth/depth_formats.h"
#include "io/image/png_file.h"
#include <fmt/format.h>
#include <opencv2/imgcodecs.hpp>

#include "raylift/base/error.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr std::string_view kPngMagic("\x89PNG\r\n\x1a\n", 8);

template <typename T>
T LoadAt(std::string_view bytes, uint64_t offset, bool big_endian) {
  std::array<char, sizeof(T)> raw;
  std::memcpy(raw.data(), bytes.data() + offset, sizeof(T));
  if (big_endian) std::reverse(raw.begin(), raw.end());
  return std::bit_cast<T>(raw);
}

cv::Mat Decode(const path& file, std::string& bytes) {
  cv::Mat decoded;
  try {
    decoded = cv::imdecode(cv::Mat(1, static_cast<int>(bytes.size()), CV_8U, bytes.data()),
                           cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception& error) {
    throw InputError(file, fmt::format("the picture cannot be decoded: {}", error.err));
  }
  if (decoded.empty()) {
    throw InputError(file, "the picture is damaged or truncated");
  }
  return decoded;
}

std::string SampleName(int depth) {
  switch (depth) {
    case CV_8U:
      return "uint8";
    case CV_16U:
      return "uint16";
    case CV_16S:
      return "int16";
    case CV_32S:
      return "int32";
    case CV_32F:
      return "float32";
    case CV_64F:
      return "float64";
    default:
      return {};
  }
}

StoredDepth ToStored(const path& file, const cv::Mat& decoded) {
  StoredDepth depth;
  depth.width_px = decoded.cols;
  depth.height_px = decoded.rows;
  depth.format = DepthFileFormat::kTiff;
  depth.sample_type = SampleName(decoded.depth());
  if (decoded.channels() != 1 || depth.sample_type.empty()) {
    throw InputError(file, fmt::format("expected one grey channel, found {}", decoded.channels()));
  }
  depth.values.resize(decoded.total());
  cv::Mat values(decoded.rows, decoded.cols, CV_32F, depth.values.data());
  decoded.convertTo(values, CV_32F);
  return depth;
}

std::string EncodeByOpenCv(const path& file, const char* extension, const cv::Mat& picture,
                           const std::vector<int>& options) {
  std::vector<uint8_t> bytes;
  try {
    cv::imencode(extension, picture, bytes, options);
  } catch (const cv::Exception& error) {
    throw InputError(file, fmt::format("the picture cannot be encoded: {}", error.err));
  }
  return {bytes.begin(), bytes.end()};
}

// What the first directory of a TIFF file says.
struct TiffFacts {
  uint64_t width = 0;
  uint64_t height = 0;
  uint64_t bits_per_sample = 1;
  uint64_t samples_per_pixel = 1;
  uint64_t sample_format = 1;     // 1: unsigned, 2: signed, 3: float
  uint64_t sample_format_at = 0;  // the byte that says so; 0: none
  uint64_t compression = 1;       // 1: none
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
      if (tag == kSampleFormat) facts.sample_format_at = LowByteOf(entry);
    }
    // The place of the next directory ends this one; files are often cut short here.
    Load<uint32_t>(first + count * entry_size + (big_ ? 4 : 0));
    return facts;
  }

 private:
  static constexpr uint16_t kSampleFormat = 339;

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
      case kSampleFormat:
        return &facts.sample_format;
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

  // Of the first number of an entry of its own.
  uint64_t LowByteOf(uint64_t entry) const {
    const uint64_t inline_at = entry + (big_ ? 12 : 8);
    if (!big_endian_) return inline_at;
    return inline_at + (Load<uint16_t>(entry + 2) == 3 ? 1 : 3);
  }

  template <typename T>
  T Load(uint64_t offset) const {
    if (offset > bytes_.size() || bytes_.size() - offset < sizeof(T)) Fail();
    return LoadAt<T>(bytes_, offset, big_endian_);
  }
  [[noreturn]] void Fail() const {
    throw InputError(file_, "the TIFF file is damaged or truncated");
  }

  const path& file_;
  std::string_view bytes_;
  bool big_endian_;
  bool big_;  // BigTIFF
};

// OpenCV refuses unsigned samples of 32 bits. Depth needs but 31 of them: larger counts become
// negative, which is no depth.
void SaySigned(const path& file, const TiffFacts& facts, std::string& bytes) {
  if (facts.sample_format_at == 0) {
    throw InputError(file, "expected a TIFF of 32 bits that says what they are (SampleFormat)");
  }
  bytes[facts.sample_format_at] = 2;
}

}  // namespace

bool IsPng(std::string_view bytes) { return bytes.starts_with(kPngMagic); }

StoredDepth DecodePng(const path& file, std::string_view bytes) {
  const PngHeader header = ReadPngHeader(file, bytes);
  if (!header.is_grey || (header.bits != 8 && header.bits != 16)) {
    throw InputError(
        file,
        fmt::format("expected a grey PNG of 16 bits, found {} of {} bits",
                    header.is_grey ? "a grey one" : "one in colours or with alpha", header.bits));
  }
  CheckClaimedSize(file, header.width_px, header.height_px,
                   kMaxInflation * bytes.size() * 8 / static_cast<uint64_t>(header.bits));
  StoredDepth depth;
  depth.width_px = static_cast<int>(header.width_px);
  depth.height_px = static_cast<int>(header.height_px);
  depth.format = DepthFileFormat::kPng;
  depth.sample_type = header.bits == 8 ? "uint8" : "uint16";
  depth.values = DecodeGreyPng(file, header, bytes);
  return depth;
}

bool IsTiff(std::string_view bytes) {
  using namespace std::string_view_literals;
  return bytes.starts_with("II*\0"sv) || bytes.starts_with("MM\0*"sv) ||
         bytes.starts_with("II+\0"sv) || bytes.starts_with("MM\0+"sv);
}

StoredDepth DecodeTiff(const path& file, std::string& bytes) {
  const TiffFacts facts = TiffDirectory(file, bytes).Read();
  const uint64_t bits = facts.bits_per_sample;
  const bool is_float = facts.sample_format == 3 && (bits == 32 || bits == 64);
  const bool is_unsigned = facts.sample_format == 1 && (bits == 8 || bits == 16 || bits == 32);
  const bool is_signed = facts.sample_format == 2 && (bits == 16 || bits == 32);
  if (facts.samples_per_pixel != 1 || !(is_float || is_unsigned || is_signed)) {
    constexpr std::array<const char*, 4> kNames = {"unknown", "unsigned", "signed", "float"};
    throw InputError(
        file,
        fmt::format("expected a TIFF of one channel of 8 to 32 bits, or 32 or 64 bits float, found "
                    "{} of {} bits {}",
                    facts.samples_per_pixel, bits,
                    kNames[facts.sample_format < 4 ? facts.sample_format : 0]));
  }
  if (is_unsigned && bits == 32) SaySigned(file, facts, bytes);
  const uint64_t inflation = facts.compression == 1 ? 1 : kMaxInflation;
  CheckClaimedSize(file, facts.width, facts.height, inflation * bytes.size() * 8 / bits);
  return ToStored(file, Decode(file, bytes));
}

std::string EncodeTiff(const path& file, const FloatPlane& plane) {
  cv::Mat picture(plane.height_px, plane.width_px, CV_32F);
  std::memcpy(picture.data, plane.values.data(), plane.values.size_bytes());
  return EncodeByOpenCv(file, ".tiff", picture, {});
}

bool IsPgm(std::string_view bytes) {
  return bytes.size() > 2 && bytes.starts_with("P5") &&
         std::isspace(static_cast<unsigned char>(bytes[2])) != 0;
}

}  // namespace raylift
