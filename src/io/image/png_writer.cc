#include "io/image/png_writer.h"

#include <bit>
#include <stdexcept>

#include <fmt/format.h>
#include <png.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

[[noreturn]] void Throw(png_structp, png_const_charp message) { throw std::runtime_error(message); }

void Ignore(png_structp, png_const_charp) {}

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

}  // namespace raylift
