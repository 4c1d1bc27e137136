// Depth maps in numpy's NPY, NPZ and gzipped NPY.

#include <algorithm>
#include <limits>
#include <memory>
#include <span>

#include "base/bytes.h"
#include "io/binary/npy_array.h"
#include "io/binary/zip_archive.h"
#include "io/depth/depth_formats.h"
#include <fmt/format.h>
#include <zlib.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

constexpr int kGzipWindowBits = 16 + MAX_WBITS;
constexpr size_t kMaxInflated = size_t{1} << 32;  // more than the largest depth map takes

class GzipStream {
 public:
  explicit GzipStream(std::string_view bytes) {
    // zlib only reads its input.
    stream_.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
    stream_.avail_in = static_cast<uInt>(bytes.size());
    RAYLIFT_CHECK_EQ(inflateInit2(&stream_, kGzipWindowBits), Z_OK);
  }
  ~GzipStream() { inflateEnd(&stream_); }
  GzipStream(const GzipStream&) = delete;
  GzipStream& operator=(const GzipStream&) = delete;

  z_stream& get() { return stream_; }

 private:
  z_stream stream_{};
};

// Inflates all members of a gzip file, one after the other. Throws InputError where it is damaged
// or truncated.
std::string InflateGzip(const std::filesystem::path& path, std::string_view bytes) {
  if (bytes.size() > std::numeric_limits<uInt>::max()) {
    throw InputError(path, "the gzip file is too large");
  }
  GzipStream gzip(bytes);
  z_stream& stream = gzip.get();
  std::string result;
  auto buffer = std::make_unique<char[]>(1 << 18);
  while (true) {
    stream.next_out = reinterpret_cast<Bytef*>(buffer.get());
    stream.avail_out = 1 << 18;
    const int status = inflate(&stream, Z_NO_FLUSH);
    result.append(buffer.get(), (1 << 18) - stream.avail_out);
    if (status == Z_STREAM_END) {
      if (stream.avail_in == 0) return result;
      if (inflateReset(&stream) != Z_OK) break;
    } else if (status != Z_OK) {
      throw InputError(path, fmt::format("the gzip file is damaged or truncated: {}",
                                         stream.msg != nullptr ? stream.msg : "it ends too early"));
    }
    if (result.size() > kMaxInflated) break;
  }
  throw InputError(path, "the gzip file holds more than a depth map can have");
}

using std::filesystem::path;

struct Sides {
  uint64_t width, height;
};

// Finds the sides of a shape (H, W), with any sides of 1 before and after.
Sides FindSides(const path& file, const NpyHeader& header) {
  std::span<const uint64_t> shape = header.shape;
  while (shape.size() > 2 && shape.front() == 1) shape = shape.subspan(1);
  while (shape.size() > 2 && shape.back() == 1) shape = shape.first(shape.size() - 1);
  if (shape.size() != 2) {
    throw InputError(file, fmt::format("expected one value per pixel, shape (height, width), found "
                                       "an array of shape ({})",
                                       fmt::join(header.shape, ", ")));
  }
  return {shape[1], shape[0]};
}

std::vector<float> Transposed(const std::vector<float>& columns, uint64_t width, uint64_t height) {
  std::vector<float> rows(columns.size());
  for (uint64_t y = 0; y < height; ++y) {
    for (uint64_t x = 0; x < width; ++x) rows[y * width + x] = columns[x * height + y];
  }
  return rows;
}

}  // namespace

StoredDepth DecodeNpy(const path& file, std::string_view bytes) {
  if (!IsNpy(bytes)) throw InputError(file, "expected an NPY array, found something else");
  const NpyHeader header = ReadNpyHeader(file, bytes);
  const NpySamples& type = SamplesOf(file, header);
  const auto [width, height] = FindSides(file, header);
  const size_t num_data_bytes = bytes.size() - header.data_offset;
  CheckClaimedSize(file, width, height, num_data_bytes / type.num_bytes);
  std::vector<float> values(width * height);
  type.to_float(bytes.data() + header.data_offset, header.swapped(), values);

  StoredDepth depth;
  depth.width_px = static_cast<int>(width);
  depth.height_px = static_cast<int>(height);
  depth.values = header.fortran_order ? Transposed(values, width, height) : std::move(values);
  depth.format = DepthFileFormat::kNpy;
  depth.sample_type = type.name;
  return depth;
}

std::string NpyHeaderBytes(std::string_view descr, std::string_view shape) {
  std::string text =
      fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': {}, }}", descr, shape);
  // The data start at a multiple of 64 bytes.
  const size_t unpadded = kNpyMagic.size() + 4 + text.size() + 1;
  text += std::string((64 - unpadded % 64) % 64, ' ') + '\n';
  std::string bytes(kNpyMagic);
  bytes +=
      {'\x01', '\x00', static_cast<char>(text.size() & 0xff), static_cast<char>(text.size() >> 8)};
  return bytes + text;
}

void AppendSamples(std::span<const float> values, FloatSample sample, std::string& bytes) {
  if (sample == FloatSample::kFloat32) {
    bytes += AsBytes(values);
    return;
  }
  std::vector<uint16_t> halves(values.size());
  DepthWriteReport ignored;
  RoundToHalf(values, halves, ignored);
  bytes += AsBytes(std::span(halves));
}

std::string EncodeNpy(std::string_view shape, std::span<const float> values, FloatSample sample) {
  std::string bytes = NpyHeaderBytes(sample == FloatSample::kFloat16 ? "<f2" : "<f4", shape);
  AppendSamples(values, sample, bytes);
  return bytes;
}

StoredDepth DecodeNpz(const path& file, std::string_view bytes, const std::string& key) {
  const ZipReader archive(file, bytes);
  std::vector<std::string> keys;
  for (const std::string& name : archive.names()) {
    if (name.ends_with(".npy")) keys.push_back(name.substr(0, name.size() - 4));
  }
  const auto listed = [&keys] {
    return keys.empty() ? std::string("none") : fmt::format("{}", fmt::join(keys, ", "));
  };
  std::string chosen = key;
  if (chosen.empty()) {
    chosen = keys.size() == 1 ? keys.front() : "depth";
  }
  if (std::find(keys.begin(), keys.end(), chosen) == keys.end()) {
    throw InputError(file, fmt::format("expected an array \"{}\", found {}", chosen, listed()));
  }
  StoredDepth depth = DecodeNpy(file, archive.Read(chosen + ".npy"));
  depth.format = DepthFileFormat::kNpz;
  depth.layer = chosen;
  return depth;
}

bool IsGzip(std::string_view bytes) { return bytes.starts_with("\x1f\x8b"); }

StoredDepth DecodeNpyGz(const path& file, std::string_view bytes) {
  StoredDepth depth = DecodeNpy(file, InflateGzip(file, bytes));
  depth.format = DepthFileFormat::kNpyGz;
  return depth;
}

}  // namespace raylift
