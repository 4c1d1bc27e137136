// Depth maps in OpenEXR.

#include <algorithm>
#include <array>
#include <cctype>
#include <new>
#include <optional>
#include <utility>

#include "base/bytes.h"
#include "base/input_paths.h"
#include "base/read_limits.h"
#include "io/depth/depth_formats.h"
#include <ImathBox.h>
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfInputPart.h>
#include <OpenEXR/ImfMultiPartInputFile.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfPartType.h>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr std::string_view kMagicOfExr("\x76\x2f\x31\x01", 4);

// The type of file positions differs between OpenEXR's versions.
using Position = decltype(std::declval<Imf::IStream&>().tellg());

class MemoryInput final : public Imf::IStream {
 public:
  explicit MemoryInput(std::string_view bytes) : IStream("memory"), bytes_(bytes) {}

  bool read(char target[], int count) override {
    const auto wanted = static_cast<size_t>(count);
    if (count < 0 || position_ > bytes_.size() || bytes_.size() - position_ < wanted) {
      throw std::runtime_error("the file ends too early");
    }
    bytes_.copy(target, wanted, position_);
    position_ += wanted;
    return position_ < bytes_.size();
  }
  Position tellg() override { return position_; }
  void seekg(Position position) override { position_ = position; }

 private:
  std::string_view bytes_;
  size_t position_ = 0;
};

class MemoryOutput final : public Imf::OStream {
 public:
  MemoryOutput() : OStream("memory") {}

  void write(const char source[], int count) override {
    const auto size = static_cast<size_t>(count);
    if (position_ + size > bytes_.size()) bytes_.resize(position_ + size);
    std::copy(source, source + size, bytes_.begin() + static_cast<std::ptrdiff_t>(position_));
    position_ += size;
  }
  Position tellp() override { return position_; }
  void seekp(Position position) override { position_ = position; }

  std::string TakeBytes() { return std::move(bytes_); }

 private:
  std::string bytes_;
  size_t position_ = 0;
};

// Refuses attributes that claim more memory than the file has, as OpenEXR allocates it before it
// reads them.
class AttributeCheck {
 public:
  AttributeCheck(const path& file, std::string_view bytes) : file_(file), bytes_(bytes) {}

  void Run() {
    constexpr uint32_t kMultiPart = 1 << 12;
    const bool is_multi_part = (Number("version") & kMultiPart) != 0;
    // An empty name ends a header, and one more the headers of several parts.
    do {
      for (auto name = Text(); !name.empty(); name = Text()) CheckAttribute(name);
    } while (is_multi_part && !bytes_.starts_with('\0'));
  }

 private:
  void CheckAttribute(std::string_view name) {
    const std::string_view type = Text();
    const uint64_t size = Number(name);
    if (size > bytes_.size()) {
      Fail(name, fmt::format("it claims {} bytes, the file has {} more", size, bytes_.size()));
    }
    AttributeCheck value(file_, bytes_.substr(0, size));
    bytes_.remove_prefix(size);
    if (type == "chlist") {
      while (!value.Text().empty()) value.Skip(name, 16);
    } else if (type == "stringvector") {
      while (!value.bytes_.empty()) value.Skip(name, value.Number(name));
    } else if (type == "preview") {
      const uint64_t width = value.Number(name), height = value.Number(name);
      value.Skip(name, 4 * width * height);
    } else {
      value.Skip(name, SizeOf(type).value_or(size));
    }
    if (!value.bytes_.empty()) {
      Fail(name, fmt::format("it is {} bytes longer than its type", value.bytes_.size()));
    }
  }

  // Returns the size of types that OpenEXR reads without regard to the size that the file gives.
  static std::optional<uint64_t> SizeOf(std::string_view type) {
    static constexpr auto kSizes = std::to_array<std::pair<std::string_view, uint64_t>>(
        {{"box2i", 16},      {"box2f", 16},   {"chromaticities", 32},
         {"compression", 1}, {"double", 8},   {"envmap", 1},
         {"float", 4},       {"int", 4},      {"keycode", 28},
         {"lineOrder", 1},   {"m33f", 36},    {"m33d", 72},
         {"m44f", 64},       {"m44d", 128},   {"rational", 8},
         {"tiledesc", 9},    {"timecode", 8}, {"v2i", 8},
         {"v2f", 8},         {"v2d", 16},     {"v3i", 12},
         {"v3f", 12},        {"v3d", 24},     {"deepImageState", 1}});
    for (const auto& [known, size] : kSizes) {
      if (known == type) return size;
    }
    return std::nullopt;
  }

  void Skip(std::string_view name, uint64_t size) {
    if (size > bytes_.size()) {
      Fail(name, fmt::format("it takes {} bytes, and has {}", size, bytes_.size()));
    }
    bytes_.remove_prefix(size);
  }

  std::string_view Text() {
    const size_t end = bytes_.find('\0');
    if (end == std::string_view::npos) Fail("header", "the file ends here");
    const std::string_view text = bytes_.substr(0, end);
    bytes_.remove_prefix(end + 1);
    return text;
  }

  uint32_t Number(std::string_view name) {
    if (bytes_.size() < sizeof(uint32_t)) Fail(name, "the file ends here");
    const auto number = LoadNumber<uint32_t>(bytes_.data());
    bytes_.remove_prefix(sizeof(number));
    return number;
  }

  [[noreturn]] void Fail(std::string_view name, std::string_view message) const {
    constexpr size_t kMaxShown = 40;
    throw InputError(
        file_, fmt::format("EXR attribute {}", Printable(std::string(name.substr(0, kMaxShown)))),
        message);
  }

  const path& file_;
  std::string_view bytes_;
};

struct ChannelOfFile {
  int part;
  std::string name;     // within the part
  std::string display;  // "part.name" where there are several parts
};

std::vector<ChannelOfFile> ListChannels(const Imf::MultiPartInputFile& file) {
  std::vector<ChannelOfFile> channels;
  for (int part = 0; part < file.parts(); ++part) {
    const Imf::Header& header = file.header(part);
    if (header.hasType() && !Imf::isImage(header.type())) continue;  // deep data
    const bool named = file.parts() > 1 && header.hasName();
    for (auto it = header.channels().begin(); it != header.channels().end(); ++it) {
      const std::string name = it.name();
      channels.push_back({part, name, named ? header.name() + "." + name : name});
    }
  }
  return channels;
}

// Returns whether a channel has the name: "Z" names the channel Z, and that of a layer or a part as
// well ("View.Depth.Z").
bool IsNamed(const ChannelOfFile& channel, const std::string& name) {
  const std::string display = Lower(channel.display);
  return display == name || display.ends_with("." + name);
}

ChannelOfFile FindChannel(const path& file, const std::vector<ChannelOfFile>& channels,
                          const std::string& wanted) {
  if (channels.empty()) {
    throw InputError(file, "expected a flat image with a channel, found none");
  }
  const std::vector<std::string> names = wanted.empty()
                                             ? std::vector<std::string>{"z", "depth", "r", "y"}
                                             : std::vector<std::string>{Lower(wanted)};
  for (const std::string& name : names) {
    for (const ChannelOfFile& channel : channels) {
      if (IsNamed(channel, name)) return channel;
    }
  }
  if (!wanted.empty()) {
    std::string there;
    for (const ChannelOfFile& channel : channels) {
      there += (there.empty() ? "" : ", ") + channel.display;
    }
    throw InputError(file, fmt::format("expected a channel \"{}\", found {}", wanted, there));
  }
  return channels.front();
}

struct Window {
  int64_t x, y;
  uint64_t width, height;
  bool operator==(const Window&) const = default;
};

Window WindowOf(const Imath::Box2i& box) {
  const int64_t width = int64_t{box.max.x} - box.min.x + 1;
  const int64_t height = int64_t{box.max.y} - box.min.y + 1;
  return {box.min.x, box.min.y, static_cast<uint64_t>(std::max<int64_t>(width, 0)),
          static_cast<uint64_t>(std::max<int64_t>(height, 0))};
}

// Returns how many pixels of one channel a file can hold at most. The lossy DCT runs before
// deflate.
uint64_t MaxPixels(Imf::Compression compression, Imf::PixelType type, uint64_t num_bytes) {
  if (compression == Imf::DWAA_COMPRESSION || compression == Imf::DWAB_COMPRESSION) {
    return 4 * kMaxDeflateRatio * num_bytes;
  }
  return kMaxDeflateRatio * num_bytes / (type == Imf::HALF ? 2 : 4);
}

// Returns the data window's values in the display window, 0 where it has none.
std::vector<float> InDisplayWindow(const std::vector<float>& data, const Window& from,
                                   const Window& to) {
  std::vector<float> values(to.width * to.height, 0.0f);
  const int64_t first = std::max(from.x, to.x);
  const int64_t last =
      std::min(from.x + static_cast<int64_t>(from.width), to.x + static_cast<int64_t>(to.width));
  if (first >= last) return values;
  for (uint64_t row = 0; row < to.height; ++row) {
    const int64_t from_row = to.y + static_cast<int64_t>(row) - from.y;
    if (from_row < 0 || from_row >= static_cast<int64_t>(from.height)) continue;
    const float* source = data.data() + from_row * static_cast<int64_t>(from.width);
    std::copy(source + (first - from.x), source + (last - from.x),
              values.data() + static_cast<int64_t>(row * to.width) + (first - to.x));
  }
  return values;
}

std::string_view SampleName(Imf::PixelType type) {
  return type == Imf::HALF ? "float16" : type == Imf::FLOAT ? "float32" : "uint32";
}

StoredDepth ReadChannel(const path& file, Imf::MultiPartInputFile& input,
                        const ChannelOfFile& found, uint64_t num_bytes) {
  const Imf::Header& header = input.header(found.part);
  const Imf::Channel& channel = header.channels()[found.name.c_str()];
  if (channel.xSampling != 1 || channel.ySampling != 1) {
    throw InputError(file, fmt::format("channel {}", found.display),
                     "expected a value for every pixel, found a subsampled channel");
  }
  const Window data = WindowOf(header.dataWindow());
  const Window display = WindowOf(header.displayWindow());
  const uint64_t max_pixels = MaxPixels(header.compression(), channel.type, num_bytes);
  CheckClaimedSize(file, data.width, data.height, max_pixels);
  CheckClaimedSize(file, display.width, display.height, max_pixels);

  std::vector<float> values(data.width * data.height);
  Imf::FrameBuffer buffer;
  buffer.insert(found.name, Imf::Slice::Make(Imf::FLOAT, values.data(), header.dataWindow(),
                                             sizeof(float), sizeof(float) * data.width));
  Imf::InputPart part(input, found.part);
  part.setFrameBuffer(buffer);
  part.readPixels(header.dataWindow().min.y, header.dataWindow().max.y);

  StoredDepth depth;
  depth.width_px = static_cast<int>(display.width);
  depth.height_px = static_cast<int>(display.height);
  depth.values = data == display ? std::move(values) : InDisplayWindow(values, data, display);
  depth.format = DepthFileFormat::kExr;
  depth.sample_type = SampleName(channel.type);
  depth.layer = found.display;
  return depth;
}

Imf::Compression ToImf(ExrCompression compression) {
  switch (compression) {
    case ExrCompression::kNone:
      return Imf::NO_COMPRESSION;
    case ExrCompression::kZips:
      return Imf::ZIPS_COMPRESSION;
    case ExrCompression::kZip:
      return Imf::ZIP_COMPRESSION;
    case ExrCompression::kPiz:
      return Imf::PIZ_COMPRESSION;
    case ExrCompression::kPxr24:
      return Imf::PXR24_COMPRESSION;
    case ExrCompression::kDwaa:
      return Imf::DWAA_COMPRESSION;
  }
  RAYLIFT_CHECK(false);
}

// Samples of one channel as they go into the file.
struct ChannelSamples {
  std::string name;
  std::vector<uint16_t> halves;  // where the file holds float16
  const char* data;
  size_t bytes_per_sample;
};

ChannelSamples MakeSamples(const ExrChannel& channel, FloatSample sample) {
  ChannelSamples samples;
  samples.name = channel.name;
  if (sample == FloatSample::kFloat16) {
    samples.halves.resize(channel.values.size());
    DepthWriteReport ignored;
    RoundToHalf(channel.values, samples.halves, ignored);
    samples.data = reinterpret_cast<const char*>(samples.halves.data());
    samples.bytes_per_sample = sizeof(uint16_t);
  } else {
    samples.data = reinterpret_cast<const char*>(channel.values.data());
    samples.bytes_per_sample = sizeof(float);
  }
  return samples;
}

std::string EncodeSlices(const path& file, PlaneSize size, Imf::PixelType type,
                         std::span<const ChannelSamples> channels, ExrCompression compression) {
  try {
    Imf::Header header(size.width_px, size.height_px);
    header.compression() = ToImf(compression);
    Imf::FrameBuffer buffer;
    for (const ChannelSamples& channel : channels) {
      header.channels().insert(channel.name, Imf::Channel(type));
      // OpenEXR's slices are for reading and writing alike; here they are only read.
      buffer.insert(channel.name,
                    Imf::Slice(type, const_cast<char*>(channel.data), channel.bytes_per_sample,
                               channel.bytes_per_sample * static_cast<size_t>(size.width_px)));
    }
    MemoryOutput stream;
    {
      Imf::OutputFile output(stream, header, 0);
      output.setFrameBuffer(buffer);
      output.writePixels(size.height_px);
    }
    return stream.TakeBytes();
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    throw InputError(file, fmt::format("the EXR file cannot be made: {}", Printable(error.what())));
  }
}

}  // namespace

bool IsExr(std::string_view bytes) { return bytes.starts_with(kMagicOfExr); }

StoredDepth DecodeExr(const path& file, std::string_view bytes, const std::string& channel) {
  AttributeCheck(file, bytes.substr(kMagicOfExr.size())).Run();
  MemoryInput stream(bytes);
  try {
    Imf::MultiPartInputFile input(stream, 0);
    return ReadChannel(file, input, FindChannel(file, ListChannels(input), channel), bytes.size());
  } catch (const InputError&) {
    throw;
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    throw InputError(file, fmt::format("the EXR file cannot be read: {}", Printable(error.what())));
  }
}

std::string EncodeExr(const path& file, PlaneSize size, std::span<const ExrChannel> channels,
                      ExrCompression compression, FloatSample sample) {
  const Imf::PixelType type = sample == FloatSample::kFloat16 ? Imf::HALF : Imf::FLOAT;
  std::vector<ChannelSamples> samples;
  samples.reserve(channels.size());
  for (const ExrChannel& channel : channels) samples.push_back(MakeSamples(channel, sample));
  return EncodeSlices(file, size, type, samples, compression);
}

std::string EncodeExrIndices(const path& file, PlaneSize size, std::span<const uint32_t> indices,
                             ExrCompression compression) {
  const ChannelSamples samples{
      "id", {}, reinterpret_cast<const char*>(indices.data()), sizeof(uint32_t)};
  return EncodeSlices(file, size, Imf::UINT, std::span(&samples, 1), compression);
}

}  // namespace raylift
