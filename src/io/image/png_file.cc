#include "io/image/png_file.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <stdexcept>

#include <fmt/format.h>
#include <png.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

[[noreturn]] void Throw(png_structp, png_const_charp message) { throw std::runtime_error(message); }

void Ignore(png_structp, png_const_charp) {}

// What is left to read.
void Take(png_structp png, png_bytep data, size_t size) {
  auto& rest = *static_cast<std::string_view*>(png_get_io_ptr(png));
  if (size > rest.size()) throw std::runtime_error("it is truncated");
  std::memcpy(data, rest.data(), size);
  rest.remove_prefix(size);
}

void Append(png_structp png, png_bytep data, size_t size) {
  static_cast<std::string*>(png_get_io_ptr(png))->append(reinterpret_cast<char*>(data), size);
}

// libpng's state; its errors are exceptions.
class Writer {
 public:
  explicit Writer(std::string* bytes)
      : png_(png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, &Throw, &Ignore)) {
    if (png_ == nullptr) throw std::runtime_error("libpng cannot start");
    png_set_write_fn(png_, bytes, &Append, nullptr);
  }
  ~Writer() { png_destroy_write_struct(&png_, &info_); }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;

  void Write(PlaneSize size, std::span<const uint16_t> counts, int compression) {
    constexpr size_t kBytesPerChunk = size_t{1} << 18;
    info_ = png_create_info_struct(png_);
    if (info_ == nullptr) throw std::runtime_error("libpng cannot start");
    png_set_IHDR(png_, info_, static_cast<png_uint_32>(size.width_px),
                 static_cast<png_uint_32>(size.height_px), 16, PNG_COLOR_TYPE_GRAY,
                 PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_set_compression_level(png_, compression);
    png_set_compression_buffer_size(png_, kBytesPerChunk);
    png_set_filter(png_, PNG_FILTER_TYPE_BASE, PNG_FILTER_UP);
    png_write_info(png_, info_);
    if (std::endian::native == std::endian::little) png_set_swap(png_);
    const auto width = static_cast<size_t>(size.width_px);
    for (size_t row = 0; row < static_cast<size_t>(size.height_px); ++row) {
      png_write_row(png_, reinterpret_cast<png_const_bytep>(&counts[row * width]));
    }
    png_write_end(png_, info_);
  }

 private:
  png_structp png_;
  png_infop info_ = nullptr;
};

// The same for reading. What libpng only warns of (a damaged comment) is an error, too.
class Reader {
 public:
  explicit Reader(std::string_view bytes)
      : rest_(bytes),
        png_(png_create_read_struct(PNG_LIBPNG_VER_STRING, nullptr, &Throw, &Ignore)) {
    if (png_ == nullptr) throw std::runtime_error("libpng cannot start");
    png_set_read_fn(png_, &rest_, &Take);
    png_set_crc_action(png_, PNG_CRC_ERROR_QUIT, PNG_CRC_ERROR_QUIT);
  }
  ~Reader() { png_destroy_read_struct(&png_, &info_, nullptr); }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;

  std::vector<float> Read(const PngHeader& header) {
    info_ = png_create_info_struct(png_);
    if (info_ == nullptr) throw std::runtime_error("libpng cannot start");
    png_read_info(png_, info_);
    if (png_get_image_width(png_, info_) != header.width_px ||
        png_get_image_height(png_, info_) != header.height_px ||
        png_get_bit_depth(png_, info_) != header.bits ||
        png_get_color_type(png_, info_) != PNG_COLOR_TYPE_GRAY) {
      throw std::runtime_error("it does not start with its header");
    }
    return header.bits == 16 ? ReadAs<uint16_t>(header) : ReadAs<uint8_t>(header);
  }

 private:
  template <typename Sample>
  std::vector<float> ReadAs(const PngHeader& header) {
    const size_t width = header.width_px;
    const size_t height = header.height_px;
    if (sizeof(Sample) > 1 && std::endian::native == std::endian::little) png_set_swap(png_);
    png_set_interlace_handling(png_);
    png_read_update_info(png_, info_);
    RAYLIFT_CHECK_EQ(png_get_rowbytes(png_, info_), width * sizeof(Sample));
    std::vector<Sample> samples(width * height);
    std::vector<png_bytep> rows(height);
    for (size_t y = 0; y < height; ++y) {
      rows[y] = reinterpret_cast<png_bytep>(&samples[y * width]);
    }
    png_read_image(png_, rows.data());
    png_read_end(png_, nullptr);
    return {samples.begin(), samples.end()};
  }

  std::string_view rest_;
  png_structp png_;
  png_infop info_ = nullptr;
};

uint32_t BigEndianAt(std::string_view bytes, size_t offset) {
  uint32_t value = 0;
  for (const char byte : bytes.substr(offset, 4)) {
    value = (value << 8) | static_cast<unsigned char>(byte);
  }
  return value;
}

}  // namespace

std::string EncodePng16(const std::filesystem::path& file, PlaneSize size,
                        std::span<const uint16_t> counts, int compression) {
  try {
    std::string bytes;
    Writer(&bytes).Write(size, counts, compression);
    return bytes;
  } catch (const std::exception& error) {
    throw InputError(file, fmt::format("the PNG file cannot be made: {}", error.what()));
  }
}

PngHeader ReadPngHeader(const std::filesystem::path& file, std::string_view bytes) {
  constexpr size_t kWidthAt = 16, kHeightAt = 20, kBitsAt = 24, kColorTypeAt = 25, kEnd = 26;
  if (bytes.size() < kEnd) throw InputError(file, "the PNG file is truncated");
  return {.width_px = BigEndianAt(bytes, kWidthAt),
          .height_px = BigEndianAt(bytes, kHeightAt),
          .bits = static_cast<unsigned char>(bytes[kBitsAt]),
          .is_grey = bytes[kColorTypeAt] == PNG_COLOR_TYPE_GRAY};
}

std::vector<float> DecodeGreyPng(const std::filesystem::path& file, const PngHeader& header,
                                 std::string_view bytes) {
  RAYLIFT_CHECK(header.is_grey && (header.bits == 8 || header.bits == 16));
  try {
    return Reader(bytes).Read(header);
  } catch (const std::runtime_error& error) {
    throw InputError(file, fmt::format("the PNG file cannot be read: {}", error.what()));
  }
}

}  // namespace raylift
