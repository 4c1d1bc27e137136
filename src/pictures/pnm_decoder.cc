// PBM, PGM and PPM, as text (P1 to P3) and binary (P4 to P6).

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <stdexcept>

#include "pictures/decoders.h"

namespace raylift {
namespace {

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

  // That the samples take at least.
  size_t NumBytes(size_t channels) const {
    const size_t width = width_, height = height_;
    if (kind_ == 4) return (width + 7) / 8 * height;
    return width * height * channels * (!IsText() && max_value_ > 255 ? 2 : 1);
  }

  // In digits, after white space and comments.
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

  // A bit as text is one digit, with or without space after it.
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

  // Of 16 bits the upper half, as of a PNG.
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

Image DecodePnm(std::string_view bytes) { return PnmReader(bytes).Read(); }

}  // namespace raylift
