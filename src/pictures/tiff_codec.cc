#include <algorithm>
#include <array>
#include <cstdio>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <utility>

#include "base/read_limits.h"
#include "pictures/codecs.h"
#include <tiffio.h>

namespace raylift {
namespace {

[[noreturn]] void Fail() { throw std::runtime_error("the TIFF file is damaged or truncated"); }

// The memory that libtiff takes for a file.
struct Memory {
  std::string_view given = {};  // to be read
  std::string written = {};
  bool is_written = false;
  uint64_t at = 0;
  bool is_short = false;  // it was read beyond its end

  uint64_t Size() const { return is_written ? written.size() : given.size(); }
};

tmsize_t Read(thandle_t handle, void* data, tmsize_t size) {
  auto& memory = *static_cast<Memory*>(handle);
  const std::string_view bytes = memory.is_written ? memory.written : memory.given;
  const std::string_view taken =
      memory.at < bytes.size() ? bytes.substr(memory.at, static_cast<size_t>(size)) : "";
  std::memcpy(data, taken.data(), taken.size());
  memory.at += taken.size();
  memory.is_short |= taken.size() < static_cast<size_t>(size);
  return static_cast<tmsize_t>(taken.size());
}

tmsize_t Write(thandle_t handle, void* data, tmsize_t size) {
  auto& memory = *static_cast<Memory*>(handle);
  const uint64_t end = memory.at + static_cast<uint64_t>(size);
  if (end > memory.written.size()) memory.written.resize(end);
  std::memcpy(memory.written.data() + memory.at, data, static_cast<size_t>(size));
  memory.at = end;
  return size;
}

toff_t Seek(thandle_t handle, toff_t offset, int whence) {
  auto& memory = *static_cast<Memory*>(handle);
  memory.at = offset + (whence == SEEK_CUR ? memory.at : whence == SEEK_END ? memory.Size() : 0);
  return memory.at;
}

toff_t Size(thandle_t handle) { return static_cast<Memory*>(handle)->Size(); }

int Close(thandle_t) { return 0; }

struct Closer {
  void operator()(TIFF* tiff) const { TIFFClose(tiff); }
};
using TiffPointer = std::unique_ptr<TIFF, Closer>;

// Opens the memory; mode "m" copies what is read into buffers of the decoder's.
TiffPointer Open(Memory& memory, const char* mode) {
  // libtiff would print its errors.
  TIFFSetErrorHandler(nullptr);
  TIFFSetWarningHandler(nullptr);
  TiffPointer tiff(TIFFClientOpen("memory", mode, &memory, &Read, &Write, &Seek, &Close, &Size,
                                  nullptr, nullptr));
  if (tiff == nullptr) Fail();
  return tiff;
}

template <typename T>
T Field(TIFF* tiff, uint32_t tag) {
  T value = 0;
  TIFFGetFieldDefaulted(tiff, tag, &value);
  return value;
}

// Refuses blocks that are too large: a tile may be larger than its picture, but not by far.
void RefuseLargeBlocks(TIFF* tiff) {
  constexpr uint64_t kUsualBytes = uint64_t{1} << 26;
  constexpr uint64_t kMaxPixelBytes = 32;  // four numbers in double precision
  const tmsize_t bytes = TIFFIsTiled(tiff) != 0 ? TIFFTileSize(tiff) : TIFFStripSize(tiff);
  if (bytes <= 0 || bytes > kMaxTiffBlockBytes) Fail();
  const uint64_t pixels = uint64_t{Field<uint32_t>(tiff, TIFFTAG_IMAGEWIDTH)} *
                          Field<uint32_t>(tiff, TIFFTAG_IMAGELENGTH);
  if (static_cast<uint64_t>(bytes) > std::max(kUsualBytes, kMaxPixelBytes * pixels)) Fail();
}

// Copies the pixels of one strip or tile, as far as they are in the picture.
template <typename Sample>
void Put(const std::vector<Sample>& block, size_t block_width, size_t left, size_t top,
         PlaneSize size, std::vector<float>& values) {
  const auto width = static_cast<size_t>(size.width_px);
  const auto height = static_cast<size_t>(size.height_px);
  const size_t columns = std::min(block_width, width - left);
  const size_t rows = std::min(block.size() / block_width, height - top);
  for (size_t y = 0; y < rows; ++y) {
    std::transform(block.begin() + static_cast<std::ptrdiff_t>(y * block_width),
                   block.begin() + static_cast<std::ptrdiff_t>(y * block_width + columns),
                   values.begin() + static_cast<std::ptrdiff_t>((top + y) * width + left),
                   [](Sample value) { return static_cast<float>(value); });
  }
}

template <typename Sample>
std::vector<float> ReadPlane(TIFF* tiff, PlaneSize size) {
  const auto width = static_cast<size_t>(size.width_px);
  const auto height = static_cast<size_t>(size.height_px);
  const bool is_tiled = TIFFIsTiled(tiff) != 0;
  const size_t block_width = is_tiled ? Field<uint32_t>(tiff, TIFFTAG_TILEWIDTH) : width;
  const size_t block_height =
      is_tiled ? Field<uint32_t>(tiff, TIFFTAG_TILELENGTH)
               : std::min<size_t>(Field<uint32_t>(tiff, TIFFTAG_ROWSPERSTRIP), height);
  if (block_width == 0 || block_height == 0) Fail();
  std::vector<float> values(width * height);
  uint32_t index = 0;
  for (size_t top = 0; top < height; top += block_height) {
    for (size_t left = 0; left < width; left += block_width, ++index) {
      const size_t rows = is_tiled ? block_height : std::min(block_height, height - top);
      std::vector<Sample> block(block_width * rows);
      const auto bytes = static_cast<tmsize_t>(block.size() * sizeof(Sample));
      const tmsize_t read = is_tiled ? TIFFReadEncodedTile(tiff, index, block.data(), bytes)
                                     : TIFFReadEncodedStrip(tiff, index, block.data(), bytes);
      if (read != bytes) Fail();
      Put(block, block_width, left, top, size, values);
    }
  }
  return values;
}

uint16_t BitsOf(TiffSample sample) {
  constexpr std::array<uint16_t, 6> kBits = {8, 16, 16, 32, 32, 64};  // in the order of the enum
  return kBits[static_cast<size_t>(sample)];
}

void RequireForm(TIFF* tiff, PlaneSize size, TiffSample sample) {
  if (Field<uint32_t>(tiff, TIFFTAG_IMAGEWIDTH) != static_cast<uint32_t>(size.width_px) ||
      Field<uint32_t>(tiff, TIFFTAG_IMAGELENGTH) != static_cast<uint32_t>(size.height_px) ||
      Field<uint16_t>(tiff, TIFFTAG_SAMPLESPERPIXEL) != 1 ||
      Field<uint16_t>(tiff, TIFFTAG_BITSPERSAMPLE) != BitsOf(sample)) {
    Fail();
  }
}

TiffForm FormOf(TIFF* tiff) {
  TiffForm form{.width_px = Field<uint32_t>(tiff, TIFFTAG_IMAGEWIDTH),
                .height_px = Field<uint32_t>(tiff, TIFFTAG_IMAGELENGTH),
                .bits = Field<uint16_t>(tiff, TIFFTAG_BITSPERSAMPLE),
                .channels = Field<uint16_t>(tiff, TIFFTAG_SAMPLESPERPIXEL),
                .format = std::nullopt,
                .is_compressed = Field<uint16_t>(tiff, TIFFTAG_COMPRESSION) != COMPRESSION_NONE};
  uint16_t format = 0;
  if (TIFFGetField(tiff, TIFFTAG_SAMPLEFORMAT, &format) != 0) form.format = format;
  return form;
}

// Returns the values of a tag that libtiff does not know, or that another library has told it of;
// empty where there is none of this type.
template <typename T>
std::vector<T> ValuesOf(TIFF* tiff, uint32_t tag, TIFFDataType type) {
  const TIFFField* const field = TIFFFindField(tiff, tag, TIFF_ANY);
  if (field == nullptr || TIFFFieldDataType(field) != type || TIFFFieldPassCount(field) == 0) {
    return {};
  }
  const T* values = nullptr;
  uint32_t count = 0;
  uint16_t short_count = 0;
  if (TIFFFieldReadCount(field) == TIFF_VARIABLE2) {
    if (TIFFGetField(tiff, tag, &count, &values) == 0) return {};
  } else {
    if (TIFFGetField(tiff, tag, &short_count, &values) == 0) return {};
    count = short_count;
  }
  return values == nullptr ? std::vector<T>() : std::vector<T>(values, values + count);
}

}  // namespace

std::optional<TiffSample> TiffForm::Sample() const {
  // These are in the order of the enum.
  constexpr std::array<std::pair<uint16_t, uint16_t>, 6> kForms = {{{8, SAMPLEFORMAT_UINT},
                                                                    {16, SAMPLEFORMAT_UINT},
                                                                    {16, SAMPLEFORMAT_INT},
                                                                    {32, SAMPLEFORMAT_INT},
                                                                    {32, SAMPLEFORMAT_IEEEFP},
                                                                    {64, SAMPLEFORMAT_IEEEFP}}};
  const std::pair own(bits, format.value_or(SAMPLEFORMAT_UINT));
  const auto* const known = std::ranges::find(kForms, own);
  if (channels != 1 || known == kForms.end()) return std::nullopt;
  return static_cast<TiffSample>(known - kForms.begin());
}

TiffForm ReadTiffForm(std::string_view bytes) {
  Memory memory{.given = bytes};
  const TiffPointer tiff = Open(memory, "rm");
  // The place of the next directory ends this one; files are often cut short there.
  if (memory.is_short) Fail();
  return FormOf(tiff.get());
}

TiffHeader ReadTiffHeader(std::string_view bytes) {
  Memory memory{.given = bytes};
  const TiffPointer tiff = Open(memory, "rm");
  const TiffForm form = FormOf(tiff.get());
  const auto is_side = [](uint32_t side) { return side > 0 && side <= kMaxImageSidePx; };
  if (!is_side(form.width_px) || !is_side(form.height_px)) Fail();
  TiffHeader header{.size = {static_cast<int>(form.width_px), static_cast<int>(form.height_px)},
                    .sample = form.Sample(),
                    .place = {}};
  header.place.pixel_scale = ValuesOf<double>(tiff.get(), 33550, TIFF_DOUBLE);
  header.place.tie_points = ValuesOf<double>(tiff.get(), 33922, TIFF_DOUBLE);
  header.place.transformation = ValuesOf<double>(tiff.get(), 34264, TIFF_DOUBLE);
  header.place.keys = ValuesOf<uint16_t>(tiff.get(), 34735, TIFF_SHORT);
  constexpr uint32_t kNoData = 42113;
  const TIFFField* const field = TIFFFindField(tiff.get(), kNoData, TIFF_ANY);
  if (const char* text = nullptr; field != nullptr && TIFFFieldPassCount(field) == 0) {
    // The tag is a text where GDAL has told libtiff of it, as both are in one process.
    if (TIFFGetField(tiff.get(), kNoData, &text) != 0 && text != nullptr) {
      header.place.no_data = text;
    }
  }
  for (const char c : ValuesOf<char>(tiff.get(), kNoData, TIFF_ASCII)) {
    if (c != 0) header.place.no_data += c;
  }
  return header;
}

Image DecodeTiff(std::string_view bytes) {
  Memory memory{.given = bytes};
  const TiffPointer tiff = Open(memory, "rm");
  RefuseLargeBlocks(tiff.get());
  TIFFRGBAImage picture{};
  std::array<char, 1024> why{};  // the size that it is told to have
  constexpr int kStopOnError = 1;
  if (TIFFRGBAImageBegin(&picture, tiff.get(), kStopOnError, why.data()) == 0) {
    throw std::runtime_error(why.data());
  }
  const std::unique_ptr<TIFFRGBAImage, void (*)(TIFFRGBAImage*)> end(&picture, &TIFFRGBAImageEnd);
  // Pictures are read as if the first row stored were the top one: tags do not turn them.
  picture.orientation = ORIENTATION_TOPLEFT;
  picture.req_orientation = ORIENTATION_TOPLEFT;
  Image image = BlankImage(static_cast<int>(picture.width), static_cast<int>(picture.height), 3);
  std::vector<uint32_t> pixels(static_cast<size_t>(picture.width) * picture.height);
  if (TIFFRGBAImageGet(&picture, pixels.data(), picture.width, picture.height) == 0) Fail();
  for (size_t i = 0; i < pixels.size(); ++i) {
    image.data[3 * i] = static_cast<uint8_t>(TIFFGetR(pixels[i]));
    image.data[3 * i + 1] = static_cast<uint8_t>(TIFFGetG(pixels[i]));
    image.data[3 * i + 2] = static_cast<uint8_t>(TIFFGetB(pixels[i]));
  }
  return image;
}

std::vector<float> DecodeTiffPlane(std::string_view bytes, PlaneSize size, TiffSample sample) {
  Memory memory{.given = bytes};
  const TiffPointer tiff = Open(memory, "rm");
  RequireForm(tiff.get(), size, sample);
  RefuseLargeBlocks(tiff.get());
  switch (sample) {
    case TiffSample::kUint8:
      return ReadPlane<uint8_t>(tiff.get(), size);
    case TiffSample::kUint16:
      return ReadPlane<uint16_t>(tiff.get(), size);
    case TiffSample::kInt16:
      return ReadPlane<int16_t>(tiff.get(), size);
    case TiffSample::kInt32:
      return ReadPlane<int32_t>(tiff.get(), size);
    case TiffSample::kFloat32:
      return ReadPlane<float>(tiff.get(), size);
    case TiffSample::kFloat64:
      return ReadPlane<double>(tiff.get(), size);
  }
  return {};
}

std::string EncodeTiffPlane(PlaneSize size, std::span<const float> values) {
  Memory memory{.is_written = true};
  TiffPointer tiff = Open(memory, "wm");
  const auto set = [&](uint32_t tag, auto value) {
    if (TIFFSetField(tiff.get(), tag, value) == 0) throw std::runtime_error("libtiff refuses it");
  };
  set(TIFFTAG_IMAGEWIDTH, static_cast<uint32_t>(size.width_px));
  set(TIFFTAG_IMAGELENGTH, static_cast<uint32_t>(size.height_px));
  set(TIFFTAG_BITSPERSAMPLE, int{BitsOf(TiffSample::kFloat32)});
  set(TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_IEEEFP);
  set(TIFFTAG_SAMPLESPERPIXEL, 1);
  set(TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
  set(TIFFTAG_COMPRESSION, COMPRESSION_NONE);
  set(TIFFTAG_ROWSPERSTRIP, TIFFDefaultStripSize(tiff.get(), 0));
  const auto width = static_cast<size_t>(size.width_px);
  std::vector<float> row(width);  // which libtiff may change
  for (size_t y = 0; y < static_cast<size_t>(size.height_px); ++y) {
    std::copy_n(values.begin() + static_cast<std::ptrdiff_t>(y * width), width, row.begin());
    if (TIFFWriteScanline(tiff.get(), row.data(), static_cast<uint32_t>(y), 0) != 1) {
      throw std::runtime_error("libtiff refuses it");
    }
  }
  if (TIFFFlush(tiff.get()) != 1) throw std::runtime_error("libtiff refuses it");
  tiff.reset();
  return std::move(memory.written);
}

}  // namespace raylift
