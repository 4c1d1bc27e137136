#include <bit>
#include <cstring>
#include <new>
#include <stdexcept>

#include "pictures/codecs.h"
#include <fmt/format.h>
#include <png.h>
#include <zlib.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

[[noreturn]] void Throw(png_structp, png_const_charp message) { throw std::runtime_error(message); }

void Ignore(png_structp, png_const_charp) {}

// Gives libpng bytes that are left to read.
void Take(png_structp png, png_bytep data, size_t size) {
  auto& rest = *static_cast<std::string_view*>(png_get_io_ptr(png));
  if (size > rest.size()) throw std::runtime_error("it is truncated");
  std::memcpy(data, rest.data(), size);
  rest.remove_prefix(size);
}

void Append(png_structp png, png_bytep data, size_t size) {
  static_cast<std::string*>(png_get_io_ptr(png))->append(reinterpret_cast<char*>(data), size);
}

// libpng's state for writing; its errors are exceptions.
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

  // Writes rows of such samples, which are in their native byte order.
  void Write(PlaneSize size, int bits, int color_type, const void* rows) {
    info_ = png_create_info_struct(png_);
    if (info_ == nullptr) throw std::runtime_error("libpng cannot start");
    png_set_IHDR(png_, info_, static_cast<png_uint_32>(size.width_px),
                 static_cast<png_uint_32>(size.height_px), bits, color_type, PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png_, info_);
    if (bits == 16 && std::endian::native == std::endian::little) png_set_swap(png_);
    const auto* row = static_cast<png_const_bytep>(rows);
    const size_t row_bytes = png_get_rowbytes(png_, info_);
    for (int y = 0; y < size.height_px; ++y, row += row_bytes) png_write_row(png_, row);
    png_write_end(png_, info_);
  }

  png_structp get() const { return png_; }

 private:
  png_structp png_;
  png_infop info_ = nullptr;
};

// libpng's state for reading; its errors are exceptions.
class Reader {
 public:
  explicit Reader(std::string_view bytes)
      : rest_(bytes),
        png_(png_create_read_struct(PNG_LIBPNG_VER_STRING, nullptr, &Throw, &Ignore)) {
    if (png_ == nullptr) throw std::runtime_error("libpng cannot start");
    png_set_read_fn(png_, &rest_, &Take);
  }
  ~Reader() { png_destroy_read_struct(&png_, &info_, nullptr); }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;

  // Reads the samples. Damage that libpng only warns of (of a comment) is an error, too.
  std::vector<float> ReadPlane(const PngHeader& header) {
    png_set_crc_action(png_, PNG_CRC_ERROR_QUIT, PNG_CRC_ERROR_QUIT);
    ReadInfo();
    if (png_get_image_width(png_, info_) != header.width_px ||
        png_get_image_height(png_, info_) != header.height_px ||
        png_get_bit_depth(png_, info_) != header.bits ||
        png_get_color_type(png_, info_) != PNG_COLOR_TYPE_GRAY) {
      throw std::runtime_error("it does not start with its header");
    }
    return header.bits == 16 ? ReadAs<uint16_t>(header) : ReadAs<uint8_t>(header);
  }

  // Reads a PNG of any kind, as gray or RGB.
  Image ReadPicture() {
    ReadInfo();
    png_set_strip_16(png_);
    png_set_strip_alpha(png_);
    png_set_expand(png_);
    PrepareRows();
    Image image = BlankImage(static_cast<int>(png_get_image_width(png_, info_)),
                             static_cast<int>(png_get_image_height(png_, info_)),
                             png_get_channels(png_, info_));
    ReadRows(image.data.data(), static_cast<size_t>(image.height_px),
             static_cast<size_t>(image.width_px) * static_cast<size_t>(image.channels));
    return image;
  }

 private:
  template <typename Sample>
  std::vector<float> ReadAs(const PngHeader& header) {
    const size_t width = header.width_px;
    const size_t height = header.height_px;
    if (sizeof(Sample) > 1 && std::endian::native == std::endian::little) png_set_swap(png_);
    PrepareRows();
    std::vector<Sample> samples(width * height);
    ReadRows(samples.data(), height, width * sizeof(Sample));
    return {samples.begin(), samples.end()};
  }

  void ReadInfo() {
    info_ = png_create_info_struct(png_);
    if (info_ == nullptr) throw std::runtime_error("libpng cannot start");
    png_read_info(png_, info_);
  }

  void PrepareRows() {
    png_set_interlace_handling(png_);
    png_read_update_info(png_, info_);
  }

  void ReadRows(void* pixels, size_t height, size_t row_bytes) {
    RAYLIFT_CHECK_EQ(png_get_rowbytes(png_, info_), row_bytes);
    std::vector<png_bytep> rows(height);
    for (size_t y = 0; y < height; ++y) rows[y] = static_cast<png_bytep>(pixels) + y * row_bytes;
    png_read_image(png_, rows.data());
    png_read_end(png_, nullptr);
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
    constexpr size_t kBytesPerChunk = size_t{1} << 18;
    std::string bytes;
    Writer writer(&bytes);
    png_set_compression_level(writer.get(), compression);
    png_set_compression_buffer_size(writer.get(), kBytesPerChunk);
    png_set_filter(writer.get(), PNG_FILTER_TYPE_BASE, PNG_FILTER_UP);
    writer.Write(size, 16, PNG_COLOR_TYPE_GRAY, counts.data());
    return bytes;
  } catch (const std::bad_alloc&) {
    throw;
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
          .is_gray = bytes[kColorTypeAt] == PNG_COLOR_TYPE_GRAY};
}

std::vector<float> DecodeGrayPng(const std::filesystem::path& file, const PngHeader& header,
                                 std::string_view bytes) {
  RAYLIFT_CHECK(header.is_gray && (header.bits == 8 || header.bits == 16));
  try {
    return Reader(bytes).ReadPlane(header);
  } catch (const std::runtime_error& error) {
    throw InputError(file, fmt::format("the PNG file cannot be read: {}", error.what()));
  }
}

Image DecodePng(std::string_view bytes) { return Reader(bytes).ReadPicture(); }

// Compresses fast rather than small.
std::string EncodePng(const Image& image) {
  try {
    std::string bytes;
    Writer writer(&bytes);
    png_set_compression_level(writer.get(), Z_BEST_SPEED);
    png_set_compression_strategy(writer.get(), Z_RLE);
    png_set_filter(writer.get(), PNG_FILTER_TYPE_BASE, PNG_FILTER_SUB);
    const int color_type = image.channels == 1   ? PNG_COLOR_TYPE_GRAY
                           : image.channels == 3 ? PNG_COLOR_TYPE_RGB
                                                 : PNG_COLOR_TYPE_RGB_ALPHA;
    writer.Write({image.width_px, image.height_px}, 8, color_type, image.data.data());
    return bytes;
  } catch (const std::runtime_error& error) {
    throw InputError(fmt::format("the image cannot be encoded as PNG: {}", error.what()));
  }
}

}  // namespace raylift
