#include "pictures/picture_codec.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <memory>
#include <new>
#include <span>
#include <sstream>
#include <stdexcept>

#include "base/read_limits.h"
#include "pictures/codecs.h"
#include <fmt/format.h>
#include <webp/decode.h>
#include <webp/encode.h>

#include "raylift/base/error.h"

namespace raylift {

Image DecodeWebp(std::string_view bytes, std::optional<PlaneSize> expected) {
  const auto* data = reinterpret_cast<const uint8_t*>(bytes.data());
  int width = 0, height = 0;
  if (WebPGetInfo(data, bytes.size(), &width, &height) == 0) {
    throw std::runtime_error("its header is damaged");
  }
  if (expected && *expected != PlaneSize{width, height}) {
    throw std::runtime_error(fmt::format("its picture is of {} x {} pixels", width, height));
  }
  Image image = BlankImage(width, height, 3);
  if (WebPDecodeRGBInto(data, bytes.size(), image.data.data(), image.data.size(), 3 * width) ==
      nullptr) {
    throw std::runtime_error("it is damaged or truncated");
  }
  return image;
}

std::optional<std::string> EncodeWebp(const Image& image) {
  RAYLIFT_CHECK_EQ(image.channels, 3);
  if (std::max(image.width_px, image.height_px) > WEBP_MAX_DIMENSION) return std::nullopt;
  uint8_t* encoded = nullptr;
  const size_t size = WebPEncodeLosslessRGB(image.data.data(), image.width_px, image.height_px,
                                            3 * image.width_px, &encoded);
  const std::unique_ptr<uint8_t, decltype(&WebPFree)> owner(encoded, &WebPFree);
  if (size == 0) throw std::bad_alloc();
  return std::string(reinterpret_cast<const char*>(encoded), size);
}

namespace {

Image ToRgb(const Image& image) {
  if (image.channels == 3) return image;
  Image rgb = BlankImage(image.width_px, image.height_px, 3);
  for (size_t i = 0; i < rgb.data.size(); ++i) rgb.data[i] = image.data[i / 3];
  return rgb;
}

// Decodes by the decoder of the format, to gray where that does.
Image DecodeByFormat(std::string_view bytes) {
  if (bytes.starts_with("\xFF\xD8")) return DecodeJpeg(bytes);
  if (bytes.starts_with("\x89PNG")) return DecodePng(bytes);
  if (bytes.starts_with("BM")) return DecodeBmp(bytes);
  if (bytes.starts_with("RIFF")) return DecodeWebp(bytes);
  if (bytes.starts_with("P")) return DecodePnm(bytes);
  return DecodeTiff(bytes);
}

}  // namespace

Image DecodePicture(std::string_view bytes, ImageChannels channels) {
  if (const auto why = WhyNoPicture(bytes)) throw InputError(*why);
  try {
    const Image image = DecodeByFormat(bytes);
    // The libraries do not convert to gray: that of a file is the same as that of its colors in
    // memory.
    return channels == ImageChannels::kGray ? ToGray(image) : ToRgb(image);
  } catch (const std::runtime_error& error) {
    throw InputError(fmt::format("the image cannot be decoded: {}", error.what()));
  }
}

namespace {

// A byte of a PNG holds up to 8 pixels after Deflate; 64 pixels of a JPEG take a bit at least.
constexpr uint64_t kMaxPixelsPerByte = 8 * kMaxDeflateRatio;

uint32_t BigEndian(std::span<const uint8_t> bytes) {
  uint32_t value = 0;
  for (const uint8_t byte : bytes) value = (value << 8) | byte;
  return value;
}

uint32_t LittleEndian(std::span<const uint8_t> bytes) {
  uint32_t value = 0;
  for (size_t i = bytes.size(); i-- > 0;) value = (value << 8) | bytes[i];
  return value;
}

template <size_t N>
std::optional<std::array<uint8_t, N>> Take(std::istream& file) {
  std::array<char, N> chars{};
  if (!file.read(chars.data(), N)) return std::nullopt;
  std::array<uint8_t, N> bytes{};
  for (size_t i = 0; i < N; ++i) bytes[i] = static_cast<uint8_t>(chars[i]);
  return bytes;
}

std::optional<PlaneSize> Checked(uint32_t width, uint32_t height) {
  if (width < 1 || height < 1 || width > kMaxImageSidePx || height > kMaxImageSidePx)
    return std::nullopt;
  return PlaneSize{static_cast<int>(width), static_cast<int>(height)};
}

// Reads what follows the signature: the length and name of the header chunk, then width and height.
std::optional<PlaneSize> PngSize(std::istream& file) {
  const auto header = Take<16>(file);
  if (!header || BigEndian(std::span(*header).subspan(4, 4)) != 0x49484452) return std::nullopt;
  return Checked(BigEndian(std::span(*header).subspan(8, 4)),
                 BigEndian(std::span(*header).subspan(12, 4)));
}

// Returns whether a marker starts a frame: the markers C0 to CF but for DHT, JPG and DAC.
bool IsStartOfFrame(uint8_t marker) {
  return marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
}

// Reads what follows the first marker: segments of a marker and a length each.
std::optional<PlaneSize> JpegSize(std::istream& file) {
  while (const auto start = Take<4>(file)) {
    const uint8_t marker = (*start)[1];
    const uint32_t length = BigEndian(std::span(*start).subspan(2, 2));
    if ((*start)[0] != 0xFF || length < 2) return std::nullopt;
    if (marker == 0xFF) {  // fill
      file.seekg(-3, std::ios::cur);
      continue;
    }
    if (IsStartOfFrame(marker)) {
      const auto frame = Take<5>(file);  // the precision, height and width
      if (!frame) return std::nullopt;
      return Checked(BigEndian(std::span(*frame).subspan(3, 2)),
                     BigEndian(std::span(*frame).subspan(1, 2)));
    }
    file.seekg(length - 2, std::ios::cur);
  }
  return std::nullopt;
}

// Reads what follows the two letters: the file's header, then that of the picture, which begins
// with its length. The height of a picture from top to bottom is negative.
std::optional<PlaneSize> BmpSize(std::istream& file) {
  constexpr size_t kLengthAt = 12, kWidthAt = 16;
  constexpr uint32_t kShort = 12;  // of OS/2
  const auto header = Take<24>(file);
  if (!header) return std::nullopt;
  const std::span bytes(*header);
  if (LittleEndian(bytes.subspan(kLengthAt, 4)) == kShort) {
    return Checked(LittleEndian(bytes.subspan(kWidthAt, 2)),
                   LittleEndian(bytes.subspan(kWidthAt + 2, 2)));
  }
  const int64_t height = static_cast<int32_t>(LittleEndian(bytes.subspan(kWidthAt + 4, 4)));
  return Checked(LittleEndian(bytes.subspan(kWidthAt, 4)), static_cast<uint32_t>(std::abs(height)));
}

// Reads what follows the two letters: width and height in digits, with comments between.
std::optional<PlaneSize> PnmSize(std::istream& file) {
  std::array<uint32_t, 2> sides{};
  for (uint32_t& side : sides) {
    while (file >> std::ws && file.peek() == '#') {
      file.ignore(std::numeric_limits<std::streamsize>::max(), '\n');
    }
    if (!(file >> side)) return std::nullopt;
  }
  return Checked(sides[0], sides[1]);
}

// The size and sign of one value of a type that libtiff takes for a width.
struct TiffInteger {
  uint64_t type;
  size_t num_bytes;
  bool is_signed;
};
constexpr std::array<TiffInteger, 8> kTiffIntegers{{{1, 1, false},
                                                    {3, 2, false},
                                                    {4, 4, false},
                                                    {6, 1, true},
                                                    {8, 2, true},
                                                    {9, 4, true},
                                                    {16, 8, false},
                                                    {17, 8, true}}};

// Reads what follows the byte order: the version, the place of the directory, and its entries. As
// in libtiff, of several entries of one tag the first counts, and of several values none.
std::optional<PlaneSize> TiffSize(std::istream& file, bool is_big_endian) {
  const auto number = [&](size_t num_bytes) {
    uint64_t value = 0;
    for (size_t i = 0; i < num_bytes; ++i) {
      const auto byte = static_cast<uint64_t>(static_cast<uint8_t>(file.get()));
      value = is_big_endian ? value << 8 | byte : value | byte << (8 * i);
    }
    return value;
  };
  constexpr uint64_t kBigTiff = 43, kWidth = 256, kHeight = 257;
  const bool is_big = number(2) == kBigTiff;
  const size_t place_bytes = is_big ? 8 : 4;
  if (is_big) number(4);  // the size of places
  file.seekg(static_cast<std::streamoff>(number(place_bytes)));
  std::optional<uint64_t> width, height;
  for (uint64_t left = number(is_big ? 8 : 2); left > 0 && file; --left) {
    const uint64_t tag = number(2), type = number(2);
    const uint64_t num_values = number(place_bytes);
    std::optional<uint64_t>* const side = tag == kWidth    ? &width
                                          : tag == kHeight ? &height
                                                           : nullptr;
    if (side == nullptr || side->has_value()) {
      number(place_bytes);
      continue;
    }
    const auto* const form = std::ranges::find(kTiffIntegers, type, &TiffInteger::type);
    if (form == kTiffIntegers.end() || form->num_bytes > place_bytes || num_values != 1) {
      return std::nullopt;
    }
    const uint64_t value = number(form->num_bytes);
    number(place_bytes - form->num_bytes);
    const bool is_negative = form->is_signed && (value >> (8 * form->num_bytes - 1)) != 0;
    if (is_negative || value > kMaxImageSidePx) return std::nullopt;
    *side = value;
  }
  if (!file || !width || !height) return std::nullopt;
  return Checked(static_cast<uint32_t>(*width), static_cast<uint32_t>(*height));
}

// Reads what follows "RI": the rest of the container's header, then a chunk's name and length.
std::optional<PlaneSize> WebpSize(std::istream& file) {
  const auto header = Take<28>(file);
  if (!header) return std::nullopt;
  const auto number = [&](size_t at, size_t num_bytes) {
    return LittleEndian(std::span(*header).subspan(at, num_bytes));
  };
  constexpr uint32_t kSideBits = 0x3FFF;
  const std::string kind(header->begin() + 10, header->begin() + 14);
  if (kind == "VP8X") return Checked(number(22, 3) + 1, number(25, 3) + 1);
  if (kind == "VP8L") {
    const uint32_t bits = number(19, 4);
    return Checked((bits & kSideBits) + 1, (bits >> 14 & kSideBits) + 1);
  }
  return Checked(number(24, 2) & kSideBits, number(26, 2) & kSideBits);
}

bool HasPictureSignature(std::string_view bytes) {
  using namespace std::string_view_literals;
  for (const std::string_view start : {"\x89PNG\r\n\x1a\n"sv, "\xFF\xD8\xFF"sv, "BM"sv, "II*\0"sv,
                                       "MM\0*"sv, "II+\0"sv, "MM\0+"sv}) {
    if (bytes.starts_with(start)) return true;
  }
  const bool is_webp =
      bytes.size() > 12 && bytes.starts_with("RIFF") && bytes.substr(8, 4) == "WEBP";
  const bool is_pnm = bytes.size() > 2 && bytes[0] == 'P' && bytes[1] >= '1' && bytes[1] <= '6';
  return is_webp || is_pnm;
}

// Returns the name of a format that photographs are sent in and that is none of ours.
std::string_view OtherFormat(std::string_view bytes) {
  if (bytes.empty()) return "no bytes";
  if (bytes.starts_with("GIF8")) return "GIF";
  if (bytes.starts_with("%PDF")) return "PDF";
  if (bytes.size() < 12 || bytes.substr(4, 4) != "ftyp") return "something else";
  const std::string_view brand = bytes.substr(8, 4);
  if (brand.starts_with("avi")) return "AVIF";
  const bool is_heif =
      brand.starts_with("he") || brand.starts_with("mif") || brand.starts_with("msf");
  return is_heif ? "HEIC" : "a film";
}

}  // namespace

std::optional<PlaneSize> PictureSizeFromHeader(std::istream& file) {
  const auto signature = Take<2>(file);
  if (!signature) return std::nullopt;
  if (*signature == std::array<uint8_t, 2>{0xFF, 0xD8}) return JpegSize(file);
  if (*signature == std::array<uint8_t, 2>{0x89, 0x50} && Take<6>(file)) return PngSize(file);
  const std::string_view letters(reinterpret_cast<const char*>(signature->data()), 2);
  if (letters == "BM") return BmpSize(file);
  if (letters == "II" || letters == "MM") return TiffSize(file, letters == "MM");
  if (letters == "RI") return WebpSize(file);
  if (letters[0] == 'P') return PnmSize(file);
  return std::nullopt;
}

std::optional<std::string> WhyNoPicture(std::string_view bytes) {
  if (!HasPictureSignature(bytes)) {
    return fmt::format("expected an image (PNG, JPEG, TIFF, BMP, WebP, PNM), found {}",
                       OtherFormat(bytes));
  }
  std::istringstream file{std::string(bytes)};
  const auto size = PictureSizeFromHeader(file);
  if (!size) return "its header is damaged";
  if (static_cast<uint64_t>(size->width_px) * static_cast<uint64_t>(size->height_px) >
      kMaxPixelsPerByte * bytes.size()) {
    return fmt::format("its header claims {} x {} pixels, more than {} bytes can hold",
                       size->width_px, size->height_px, bytes.size());
  }
  return std::nullopt;
}

}  // namespace raylift
