// Decodes BMP without compression (samples of a palette, or blue, green and red), and PBM, PGM and
// PPM, as text (P1 to P3) and binary (P4 to P6).

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdint>
#include <cstdlib>
#include <stdexcept>
#include <vector>

#include "pictures/codecs.h"
#include <fmt/format.h>

namespace raylift {
namespace {

constexpr size_t kHeaderAt = 14;       // after that of the file
constexpr uint32_t kShortHeader = 12;  // OS/2's, with 16-bit sides and colors of 3 bytes
constexpr uint32_t kLeastHeader = 40;

class BmpReader {
 public:
  explicit BmpReader(std::string_view bytes) : bytes_(bytes) {
    header_size_ = Number(kHeaderAt, 4);
    is_short_ = header_size_ == kShortHeader;
    if (!is_short_ && header_size_ < kLeastHeader) Fail();
    width_ = is_short_ ? static_cast<int>(Number(18, 2)) : static_cast<int>(Number(18, 4));
    const int height =
        is_short_ ? static_cast<int>(Number(20, 2)) : static_cast<int>(Number(22, 4));
    is_top_down_ = height < 0;
    height_ = std::abs(height);
    bits_ = Number(is_short_ ? 24 : 28, 2);
    const uint32_t compression = is_short_ ? 0 : Number(30, 4);
    const bool is_plain = compression == 0 && (bits_ == 24 || bits_ == 32 || HasPalette());
    if (!is_plain && !HasUsualMasks(compression)) {
      throw std::runtime_error(fmt::format(
          "expected a BMP of 1, 4, 8, 24 or 32 bits without compression, found {} bits{}", bits_,
          compression == 0 ? "" : ", compressed"));
    }
  }

  Image Read() const {
    const size_t begin = Number(10, 4);
    const size_t row_bytes = (static_cast<size_t>(width_) * bits_ + 31) / 32 * 4;
    const auto height = static_cast<size_t>(height_);
    if (begin > bytes_.size() || height > (bytes_.size() - begin) / row_bytes) Fail();
    Image image = BlankImage(width_, height_, 3);
    const auto palette = Palette();
    for (int y = 0; y < height_; ++y) {
      const auto stored = static_cast<size_t>(is_top_down_ ? y : height_ - 1 - y);
      const auto* row =
          reinterpret_cast<const uint8_t*>(bytes_.data()) + begin + stored * row_bytes;
      for (int x = 0; x < width_; ++x) {
        const uint8_t* bgr = HasPalette() ? palette[Index(row, static_cast<size_t>(x))].data()
                                          : row + static_cast<size_t>(x) * (bits_ / 8);
        uint8_t* rgb = image.Pixel(x, y);
        for (size_t k = 0; k < 3; ++k) rgb[k] = bgr[2 - k];
      }
    }
    return image;
  }

 private:
  using Bgr = std::array<uint8_t, 3>;

  bool HasPalette() const { return bits_ == 1 || bits_ == 4 || bits_ == 8; }

  // Returns whether pixels of 32 bits have masks that say where their colors are, and these are the
  // usual ones.
  bool HasUsualMasks(uint32_t compression) const {
    constexpr uint32_t kMasks = 3, kMasksAt = 54;
    return compression == kMasks && bits_ == 32 && Number(kMasksAt, 4) == 0xFF0000 &&
           Number(kMasksAt + 4, 4) == 0xFF00 && Number(kMasksAt + 8, 4) == 0xFF;
  }

  // Returns the palette; colors that the file does not give are black.
  std::vector<Bgr> Palette() const {
    if (!HasPalette()) return {};
    std::vector<Bgr> palette(size_t{1} << bits_);
    const size_t entry = is_short_ ? 3 : 4;
    const uint32_t used = is_short_ ? 0 : Number(46, 4);
    const size_t given = used == 0 ? palette.size() : std::min<size_t>(used, palette.size());
    for (size_t i = 0; i < given; ++i) {
      for (size_t k = 0; k < 3; ++k) {
        palette[i][k] = static_cast<uint8_t>(Number(kHeaderAt + header_size_ + i * entry + k, 1));
      }
    }
    return palette;
  }

  // Returns a pixel's index in the palette. The leftmost pixel is in a byte's highest bits.
  size_t Index(const uint8_t* row, size_t x) const {
    const size_t bit = x * bits_;
    return row[bit / 8] >> (8 - bits_ - bit % 8) & ((1U << bits_) - 1);
  }

  uint32_t Number(size_t at, size_t num_bytes) const {
    if (at + num_bytes > bytes_.size()) Fail();
    uint32_t value = 0;
    for (size_t i = num_bytes; i-- > 0;) value = value << 8 | static_cast<uint8_t>(bytes_[at + i]);
    return value;
  }

  [[noreturn]] static void Fail() { throw std::runtime_error("it is damaged or truncated"); }

  std::string_view bytes_;
  uint32_t header_size_ = 0;
  bool is_short_ = false, is_top_down_ = false;
  int width_ = 0, height_ = 0;
  uint32_t bits_ = 0;
};

class PnmReader {
 public:
  explicit PnmReader(std::string_view bytes) : rest_(bytes.substr(2)) {
    kind_ = bytes[1] - '0';
    width_ = Number();
    height_ = Number();
    if (!IsBits()) max_value_ = Number();
    if (width_ == 0 || height_ == 0 || max_value_ == 0 || max_value_ > kMost) Fail();
    // One character of white space ends a binary picture's header.
    if (!IsText() && !rest_.empty()) rest_.remove_prefix(1);
  }

  Image Read() {
    const size_t channels = kind_ % 3 == 0 ? 3 : 1;
    if (NumBytes(channels) > rest_.size()) Fail();
    Image image =
        BlankImage(static_cast<int>(width_), static_cast<int>(height_), static_cast<int>(channels));
    if (kind_ == 4) {
      ReadBits(image);
    } else {
      for (uint8_t& value : image.data) value = ToByte(Sample());
    }
    return image;
  }

 private:
  static constexpr uint32_t kMost = 65535;

  bool IsText() const { return kind_ <= 3; }
  bool IsBits() const { return kind_ % 3 == 1; }

  // Returns the fewest bytes that the samples take.
  size_t NumBytes(size_t channels) const {
    const size_t width = width_, height = height_;
    if (kind_ == 4) return (width + 7) / 8 * height;
    return width * height * channels * (!IsText() && max_value_ > 255 ? 2 : 1);
  }

  // Reads a number in digits, after white space and comments.
  uint32_t Number() {
    while (!rest_.empty() && (IsSpace(rest_[0]) || rest_[0] == '#')) {
      const size_t end = rest_[0] == '#' ? rest_.find('\n') : 0;
      rest_.remove_prefix(end == std::string_view::npos ? rest_.size() : end + 1);
    }
    if (rest_.empty() || !IsDigit(rest_[0])) Fail();
    uint32_t number = 0;
    while (!rest_.empty() && IsDigit(rest_[0])) {
      number = std::min(number, uint32_t{1} << 24) * 10 + static_cast<uint32_t>(rest_[0] - '0');
      rest_.remove_prefix(1);
    }
    return number;
  }

  uint8_t Byte() {
    if (rest_.empty()) Fail();
    const auto byte = static_cast<uint8_t>(rest_[0]);
    rest_.remove_prefix(1);
    return byte;
  }

  // Reads a sample as text. A bit is one digit, with or without space after it.
  uint32_t Sample() {
    if (kind_ == 1) {
      while (!rest_.empty() && IsSpace(rest_[0])) rest_.remove_prefix(1);
      const uint8_t digit = Byte();
      if (digit != '0' && digit != '1') Fail();
      return digit == '0' ? 1 : 0;  // 1 is black
    }
    if (IsText()) return Number();
    const uint32_t high = Byte();
    return max_value_ > 255 ? high << 8 | Byte() : high;
  }

  void ReadBits(Image& image) {
    for (int y = 0; y < image.height_px; ++y) {
      uint8_t bits = 0;
      for (int x = 0; x < image.width_px; ++x) {
        if (x % 8 == 0) bits = Byte();
        *image.Pixel(x, y) = (bits >> (7 - x % 8) & 1) != 0 ? 0 : 255;  // 1 is black
      }
    }
  }

  // Returns the upper half of 16 bits, as for a PNG.
  uint8_t ToByte(uint32_t sample) const {
    sample = std::min(sample, max_value_);
    return static_cast<uint8_t>(max_value_ > 255 ? sample * 256 / (max_value_ + 1)
                                                 : sample * 255 / max_value_);
  }

  static bool IsSpace(char c) { return std::isspace(static_cast<unsigned char>(c)) != 0; }
  static bool IsDigit(char c) { return c >= '0' && c <= '9'; }
  [[noreturn]] static void Fail() { throw std::runtime_error("it is damaged or truncated"); }

  std::string_view rest_;
  int kind_ = 0;
  uint32_t width_ = 0, height_ = 0, max_value_ = 1;
};

}  // namespace

Image DecodeBmp(std::string_view bytes) { return BmpReader(bytes).Read(); }

Image DecodePnm(std::string_view bytes) { return PnmReader(bytes).Read(); }

}  // namespace raylift
