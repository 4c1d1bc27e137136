#include "geotiff.h"

#include <array>
#include <cmath>
#include <memory>
#include <span>

#include <tiffio.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift::demo {

namespace {

constexpr ttag_t kPixelScale = 33550, kTiePoints = 33922, kKeys = 34735, kNoData = 42113;
constexpr float kNoHeight = -9999;

void DeclareTags(TIFF* tiff) {
  char scale[] = "ModelPixelScale", tie[] = "ModelTiepoint", keys[] = "GeoKeyDirectory",
       none[] = "GDAL_NODATA";
  const std::array<TIFFFieldInfo, 4> fields{
      {{kPixelScale, -1, -1, TIFF_DOUBLE, FIELD_CUSTOM, 1, 1, scale},
       {kTiePoints, -1, -1, TIFF_DOUBLE, FIELD_CUSTOM, 1, 1, tie},
       {kKeys, -1, -1, TIFF_SHORT, FIELD_CUSTOM, 1, 1, keys},
       {kNoData, -1, -1, TIFF_ASCII, FIELD_CUSTOM, 1, 0, none}}};
  TIFFMergeFieldInfo(tiff, fields.data(), static_cast<uint32_t>(fields.size()));
}

struct Samples {
  uint16_t per_pixel, bits, format, photometric;
};

void Write(const std::filesystem::path& path, const RasterPlace& place, int width, int height,
           const Samples& samples, std::span<const uint8_t> bytes) {
  AtomicFile file(path);
  const std::unique_ptr<TIFF, decltype(&TIFFClose)> tiff(
      TIFFOpen(file.temporary_path().c_str(), "w"), &TIFFClose);
  if (!tiff) throw OutputError(path, "cannot be written");
  DeclareTags(tiff.get());
  const auto set = [&](ttag_t tag, auto... values) { TIFFSetField(tiff.get(), tag, values...); };
  set(TIFFTAG_IMAGEWIDTH, width);
  set(TIFFTAG_IMAGELENGTH, height);
  set(TIFFTAG_SAMPLESPERPIXEL, samples.per_pixel);
  set(TIFFTAG_BITSPERSAMPLE, samples.bits);
  set(TIFFTAG_SAMPLEFORMAT, samples.format);
  set(TIFFTAG_PHOTOMETRIC, samples.photometric);
  set(TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
  set(TIFFTAG_COMPRESSION, COMPRESSION_ADOBE_DEFLATE);
  set(TIFFTAG_ROWSPERSTRIP, 64);
  const std::array scale{place.cell_m, place.cell_m, 0.0};
  const std::array tie{0.0, 0.0, 0.0, place.upper_left.x(), place.upper_left.y(), 0.0};
  // A projected model, pixels that are areas, and which system.
  const std::array<uint16_t, 16> keys{1,    1, 0, 3, 1024, 0, 1, 1,
                                      1025, 0, 1, 1, 3072, 0, 1, place.epsg};
  set(kPixelScale, static_cast<int>(scale.size()), scale.data());
  set(kTiePoints, static_cast<int>(tie.size()), tie.data());
  set(kKeys, static_cast<int>(keys.size()), keys.data());
  if (samples.format == SAMPLEFORMAT_IEEEFP) set(kNoData, "-9999");
  const size_t row_bytes = bytes.size() / static_cast<size_t>(height);
  for (int row = 0; row < height; ++row) {
    std::vector<uint8_t> line(bytes.begin() + static_cast<std::ptrdiff_t>(row_bytes) * row,
                              bytes.begin() + static_cast<std::ptrdiff_t>(row_bytes) * (row + 1));
    if (TIFFWriteScanline(tiff.get(), line.data(), static_cast<uint32_t>(row), 0) != 1) {
      throw OutputError(path, "cannot be written");
    }
  }
  TIFFFlush(tiff.get());
  file.Commit();
}

}  // namespace

void WriteHeights(const std::filesystem::path& path, const RasterPlace& place, int width,
                  const std::vector<float>& heights) {
  std::vector<float> values = heights;
  for (float& value : values) value = std::isnan(value) ? kNoHeight : value;
  Write(path, place, width, static_cast<int>(values.size()) / width,
        {1, 32, SAMPLEFORMAT_IEEEFP, PHOTOMETRIC_MINISBLACK},
        {reinterpret_cast<const uint8_t*>(values.data()), values.size() * sizeof(float)});
}

void WriteOrthophoto(const std::filesystem::path& path, const RasterPlace& place,
                     const Image& image) {
  Write(path, place, image.width_px, image.height_px, {3, 8, SAMPLEFORMAT_UINT, PHOTOMETRIC_RGB},
        image.data);
}

}  // namespace raylift::demo
