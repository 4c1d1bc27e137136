// Decodes and encodes JPEG by libjpeg, whose errors become exceptions.

#include <array>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string>
#include <vector>

#include "pictures/codecs.h"
// jpeglib.h needs <cstdio> before it.
#include <jpeglib.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

[[noreturn]] void Throw(j_common_ptr jpeg) {
  std::array<char, JMSG_LENGTH_MAX> message{};
  jpeg->err->format_message(jpeg, message.data());
  throw std::runtime_error(message.data());
}

void Ignore(j_common_ptr, int) {}

// Refuses many scans: one of a few bytes takes as long as one of a whole picture.
void RefuseManyScans(j_common_ptr jpeg) {
  constexpr int kMaxScans = 100;
  if (reinterpret_cast<j_decompress_ptr>(jpeg)->input_scan_number <= kMaxScans) return;
  throw std::runtime_error("has too many scans");
}

jpeg_error_mgr* SetUp(jpeg_error_mgr& errors) {
  jpeg_std_error(&errors);
  errors.error_exit = &Throw;
  errors.emit_message = &Ignore;
  return &errors;
}

// Converts CMYK as print shops store it, inverted: 255 is no ink.
void RgbFromCmyk(const uint8_t* cmyk, uint8_t* rgb, size_t num_pixels) {
  for (size_t i = 0; i < num_pixels; ++i, cmyk += 4, rgb += 3) {
    const int black = cmyk[3];
    for (size_t k = 0; k < 3; ++k) {
      rgb[k] = static_cast<uint8_t>(black - ((255 - cmyk[k]) * black >> 8));
    }
  }
}

class Decoder {
 public:
  explicit Decoder(std::string_view bytes) {
    jpeg_.err = SetUp(errors_);
    jpeg_create_decompress(&jpeg_);
    progress_.progress_monitor = &RefuseManyScans;
    jpeg_.progress = &progress_;
    jpeg_mem_src(&jpeg_, reinterpret_cast<const unsigned char*>(bytes.data()),
                 static_cast<unsigned long>(bytes.size()));
  }
  ~Decoder() { jpeg_destroy_decompress(&jpeg_); }
  Decoder(const Decoder&) = delete;
  Decoder& operator=(const Decoder&) = delete;

  Image Decode() {
    jpeg_read_header(&jpeg_, TRUE);
    const bool is_cmyk = jpeg_.num_components == 4;
    const bool is_gray = jpeg_.num_components == 1;
    jpeg_.out_color_space = is_gray ? JCS_GRAYSCALE : is_cmyk ? JCS_CMYK : JCS_RGB;
    jpeg_start_decompress(&jpeg_);
    const size_t width = jpeg_.output_width;
    Image image =
        BlankImage(static_cast<int>(width), static_cast<int>(jpeg_.output_height), is_gray ? 1 : 3);
    std::vector<uint8_t> cmyk(is_cmyk ? 4 * width : 0);
    while (jpeg_.output_scanline < jpeg_.output_height) {
      uint8_t* const pixels = image.Pixel(0, static_cast<int>(jpeg_.output_scanline));
      JSAMPROW row = is_cmyk ? cmyk.data() : pixels;
      jpeg_read_scanlines(&jpeg_, &row, 1);
      if (is_cmyk) RgbFromCmyk(cmyk.data(), pixels, width);
    }
    jpeg_finish_decompress(&jpeg_);
    return image;
  }

 private:
  jpeg_error_mgr errors_{};
  jpeg_progress_mgr progress_{};
  jpeg_decompress_struct jpeg_{};
};

class Encoder {
 public:
  Encoder() {
    jpeg_.err = SetUp(errors_);
    jpeg_create_compress(&jpeg_);
    jpeg_mem_dest(&jpeg_, &bytes_, &size_);
  }
  ~Encoder() {
    jpeg_destroy_compress(&jpeg_);
    std::free(bytes_);
  }
  Encoder(const Encoder&) = delete;
  Encoder& operator=(const Encoder&) = delete;

  std::string Encode(const Image& image, int quality) {
    jpeg_.image_width = static_cast<JDIMENSION>(image.width_px);
    jpeg_.image_height = static_cast<JDIMENSION>(image.height_px);
    jpeg_.input_components = image.channels;
    jpeg_.in_color_space = image.channels == 1 ? JCS_GRAYSCALE : JCS_RGB;
    jpeg_set_defaults(&jpeg_);
    jpeg_set_quality(&jpeg_, quality, TRUE);
    jpeg_start_compress(&jpeg_, TRUE);
    for (int y = 0; y < image.height_px; ++y) {
      // libjpeg does not write there.
      JSAMPROW row = const_cast<uint8_t*>(image.Pixel(0, y));
      jpeg_write_scanlines(&jpeg_, &row, 1);
    }
    jpeg_finish_compress(&jpeg_);
    return {reinterpret_cast<const char*>(bytes_), size_};
  }

 private:
  jpeg_error_mgr errors_{};
  jpeg_compress_struct jpeg_{};
  unsigned char* bytes_ = nullptr;
  unsigned long size_ = 0;
};

}  // namespace

Image DecodeJpeg(std::string_view bytes) { return Decoder(bytes).Decode(); }

std::string EncodeJpeg(const Image& image, int quality) {
  try {
    return Encoder().Encode(image, quality);
  } catch (const std::runtime_error& error) {
    throw InputError(std::string("the image cannot be encoded as JPEG: ") + error.what());
  }
}

}  // namespace raylift
