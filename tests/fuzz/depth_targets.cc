// Depth maps and photographs.

#include <array>

#include "fuzz/fuzz_targets.h"
#include <fmt/format.h>
#include <zlib.h>

#include "raylift/base/error.h"
#include "raylift/io/depth_file.h"
#include "raylift/io/image_file.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/scene/image.h"

namespace raylift {
namespace {

constexpr int kWidth = 5, kHeight = 3;

void ReadDepth(std::string_view bytes) {
  const StoredDepth depth = ParseDepthFile("map", std::string(bytes));
  RAYLIFT_CHECK_EQ(depth.values.size(),
                   static_cast<size_t>(depth.width_px) * static_cast<size_t>(depth.height_px));
}

// The format is told by the content, and fuzzing soon finds OpenEXR's, the slowest: that has a
// target of its own.
void ReadOtherDepth(std::string_view bytes) {
  if (!bytes.starts_with("v/1\x01")) ReadDepth(bytes);
}

std::string DepthFile(const std::string& name, const DepthWriteOptions& options = {}) {
  std::array<float, kWidth * kHeight> values{};
  for (size_t i = 0; i < values.size(); ++i) values[i] = 0.5f + 0.25f * static_cast<float>(i);
  const auto file = ScratchFolder() / name;
  WriteDepthFile(file, FloatPlane(kWidth, kHeight, values), options);
  return TakeFile(file);
}

std::vector<std::string> ExrSeeds() {
  std::vector<std::string> seeds;
  for (const ExrCompression compression : AllValues<ExrCompression>()) {
    seeds.push_back(DepthFile("seed.exr", {.exr_compression = compression}));
  }
  seeds.push_back(DepthFile("seed.exr", {.sample = FloatSample::kFloat16, .layer = "View.Z"}));
  return seeds;
}

std::string Gzipped(const std::string& text) {
  z_stream stream{};
  std::string bytes(text.size() + 100, '\0');
  RAYLIFT_CHECK_EQ(deflateInit2(&stream, 9, Z_DEFLATED, 16 + MAX_WBITS, 8, Z_DEFAULT_STRATEGY),
                   Z_OK);
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(text.data()));
  stream.avail_in = static_cast<uInt>(text.size());
  stream.next_out = reinterpret_cast<Bytef*>(bytes.data());
  stream.avail_out = static_cast<uInt>(bytes.size());
  RAYLIFT_CHECK_EQ(deflate(&stream, Z_FINISH), Z_STREAM_END);
  bytes.resize(stream.total_out);
  deflateEnd(&stream);
  return bytes;
}

// The maps of all references in one file; here there is one.
void ReadBundle(std::string_view bytes) {
  const auto file = PutFile("bundle.npz", bytes);
  const PosedImage image{
      "a", Camera(CameraModel::kPinhole, kWidth, kHeight, std::vector<double>{5, 5, 2.5, 1.5}), {}};
  const NamedGeometry geometry = MakeGeometrySource(
      fmt::format("depth:{},layer=depth", file.string()), {.references = {&image, 1}});
  const auto map = geometry.maps->Load(image);
  RAYLIFT_CHECK(map != nullptr);
}

uint32_t BigEndianAt(const std::string& bytes, size_t at) {
  uint32_t value = 0;
  for (size_t i = 0; i < 4; ++i) value = value << 8 | static_cast<uint8_t>(bytes[at + i]);
  return value;
}

// The checksum of each chunk.
void RepairPng(std::string& bytes) {
  for (size_t at = 8; at + 12 <= bytes.size();) {
    const size_t size = BigEndianAt(bytes, at);
    if (size > bytes.size() - at - 12) return;
    const auto sum =
        crc32(0, reinterpret_cast<const Bytef*>(&bytes[at + 4]), static_cast<uInt>(size + 4));
    for (size_t i = 0; i < 4; ++i)
      bytes[at + 8 + size + i] = static_cast<char>(sum >> (24 - 8 * i));
    at += size + 12;
  }
}

void ReadPicture(std::string_view bytes) {
  const auto file = PutFile("picture.png", bytes);
  const PlaneSize size = ReadImageSize(file);
  const Image image = ReadImage(file, ImageChannels::kRgb);
  RAYLIFT_CHECK_EQ(image.width_px, size.width_px);
  RAYLIFT_CHECK_EQ(image.height_px, size.height_px);
}

// 2 x 1 pixels of 24 bits.
std::string Bmp() {
  std::string bytes(54 + 8, '\0');
  bytes.replace(0, 2, "BM");
  for (const auto& [at, value] :
       {std::pair(2, 62), std::pair(10, 54), std::pair(14, 40), std::pair(18, 2), std::pair(22, 1),
        std::pair(26, 1), std::pair(28, 24)}) {
    bytes[static_cast<size_t>(at)] = static_cast<char>(value);
  }
  return bytes;
}

std::vector<std::string> PictureSeeds(const char* name) {
  std::vector<std::string> seeds;
  for (const int channels : {1, 3}) {
    Image image{16, 8, channels, {}};
    for (int i = 0; i < 16 * 8 * channels; ++i) image.data.push_back(static_cast<uint8_t>(i * 7));
    const auto file = ScratchFolder() / name;
    WriteImage(file, image);
    seeds.push_back(TakeFile(file));
  }
  return seeds;
}

std::vector<std::string> One(std::string seed) { return {std::move(seed)}; }

constexpr std::string_view kNpyWords =
    "NUMPY {'descr': '<f4', '>f8' '|u1' 'fortran_order': True, False, 'shape': (3, 5), } "
    "18446744073709551615 4294967296 (0,";

}  // namespace

std::vector<FuzzTarget> DepthFuzzTargets() {
  return {
      {"depth_exr", ReadDepth, ExrSeeds,
       "channels chlist compression dataWindow box2i displayWindow lineOrder pixelAspectRatio "
       "tiles tiledesc type scanlineimage tiledimage deepscanline chunkCount name version Z Y"},
      {"depth_png", ReadOtherDepth, [] { return One(DepthFile("seed.png")); },
       "IHDR IDAT IEND PLTE tRNS gAMA", RepairPng},
      {"depth_tiff", ReadOtherDepth, [] { return One(DepthFile("seed.tiff")); }, "II* MM II+"},
      {"depth_pgm", ReadOtherDepth,
       [] {
         return std::vector<std::string>{"P5\n3 2\n255\nabcdef", "P5 # c\n1 2 65535\nabcd"};
       },
       "P5 # 65535 18446744073709551615 4294967296"},
      {"depth_npy", ReadOtherDepth,
       [] {
         return std::vector<std::string>{DepthFile("seed.npy"),
                                         DepthFile("half.npy", {.sample = FloatSample::kFloat16})};
       },
       kNpyWords},
      {"depth_bundle", ReadBundle, [] { return One(DepthFile("seed.npz")); }, kNpyWords},
      {"depth_npz", ReadOtherDepth,
       [] {
         return std::vector<std::string>{DepthFile("seed.npz"),
                                         DepthFile("seed.npz", {.deflate_npz = true})};
       },
       "PK depth.npy"},
      {"depth_npy_gz", ReadOtherDepth, [] { return One(Gzipped(DepthFile("seed.npy"))); },
       kNpyWords},
      {"depth_colmap", ReadOtherDepth, [] { return One(DepthFile("seed.bin")); },
       "& 1& 65536& 18446744073709551615&"},
      {"depth_pfm", ReadOtherDepth, [] { return One(DepthFile("seed.pfm")); },
       "Pf PF # -1 1e-320 nan 4294967296 18446744073709551615"},
      {"depth_raw",
       [](std::string_view bytes) {
         ParseDepthFile("map", std::string(bytes), {.raw_size = PlaneSize{2, 2}});
       },
       [] { return One(std::string(16, '\x40')); }},
      {"image_png", ReadPicture, [] { return PictureSeeds("seed.png"); },
       "IHDR IDAT IEND PLTE tRNS gAMA eXIf acTL", RepairPng},
      {"image_jpeg", ReadPicture, [] { return PictureSeeds("seed.jpg"); }, "JFIF Exif"},
      {"image_other", ReadPicture,
       [] {
         return std::vector<std::string>{Bmp(), "P6 2 1 255 abcdef"};
       },
       "BM II* MM RIFF WEBP VP8X VP8L P1 P2 P3 P4 P5 P6 65535 1000000"},
  };
}

}  // namespace raylift
