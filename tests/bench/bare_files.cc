#include "bare_files.h"

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <string>
#include <vector>

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfOutputFile.h>
#include <half.h>
#include <opencv2/imgcodecs.hpp>

namespace raylift {
namespace {

void WriteExr(const std::string& file, int width, int height, Imf::Compression compression,
              Imf::PixelType type, const void* samples, size_t bytes_per_sample) {
  Imf::Header header(width, height);
  header.compression() = compression;
  header.channels().insert("Y", Imf::Channel(type));
  Imf::OutputFile output(file.c_str(), header, 0);
  Imf::FrameBuffer buffer;
  buffer.insert("Y", Imf::Slice(type, static_cast<char*>(const_cast<void*>(samples)),
                                bytes_per_sample, bytes_per_sample * static_cast<size_t>(width)));
  output.setFrameBuffer(buffer);
  output.writePixels(height);
}

void WriteHalf(const std::string& file, int width, int height, std::span<const float> depth) {
  std::vector<Imath::half> halves(depth.begin(), depth.end());
  WriteExr(file, width, height, Imf::ZIP_COMPRESSION, Imf::HALF, halves.data(), 2);
}

void WritePng16(const std::string& file, int width, int height, std::span<const float> depth) {
  cv::Mat picture(height, width, CV_16U);
  auto* const counts = picture.ptr<uint16_t>();
  for (size_t i = 0; i < depth.size(); ++i) {
    const float count = depth[i] * 1000 + 0.5f;
    counts[i] = count < 65535.5f ? static_cast<uint16_t>(count) : uint16_t{0};
  }
  cv::imwrite(file, picture, {cv::IMWRITE_PNG_COMPRESSION, 1});
}

void WriteNpy(const std::string& file, std::span<const float> depth) {
  const std::string header(128, ' ');  // as long as the true one
  std::FILE* const stream = std::fopen(file.c_str(), "wb");
  std::fwrite(header.data(), 1, header.size(), stream);
  std::fwrite(depth.data(), sizeof(float), depth.size(), stream);
  std::fclose(stream);
}

}  // namespace

void WriteBare(BareFormat format, const std::filesystem::path& file, int width_px, int height_px,
               std::span<float> depth) {
  for (float& z : depth) {
    if (!std::isfinite(z)) z = 0;
  }
  switch (format) {
    case BareFormat::kNpy:
      return WriteNpy(file.string(), depth);
    case BareFormat::kExrHalfZip:
      return WriteHalf(file.string(), width_px, height_px, depth);
    case BareFormat::kPng16:
      return WritePng16(file.string(), width_px, height_px, depth);
    case BareFormat::kExrFloatPxr24:
      return WriteExr(file.string(), width_px, height_px, Imf::PXR24_COMPRESSION, Imf::FLOAT,
                      depth.data(), 4);
    case BareFormat::kExrFloatZip:
      return WriteExr(file.string(), width_px, height_px, Imf::ZIP_COMPRESSION, Imf::FLOAT,
                      depth.data(), 4);
  }
}

}  // namespace raylift
