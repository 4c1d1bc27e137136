// Depth maps in numpy's NPY, NPZ and gzipped NPY. Format: numpy's lib/format.py.

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <set>

#include "io/binary/inflate.h"
#include "io/binary/zip_archive.h"
#include "io/depth/depth_formats.h"
#include "io/depth/sample_rounding.h"
#include <Eigen/Core>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr std::string_view kMagic("\x93NUMPY", 6);

struct NpyHeader {
  std::string descr;
  bool fortran_order = false;
  std::vector<uint64_t> shape;
  size_t data_offset = 0;
};

// The header is a Python dictionary of a string, a truth value and a tuple of integers.
class NpyHeaderParser {
 public:
  NpyHeaderParser(const path& file, std::string_view text) : file_(file), text_(text) {}

  NpyHeader Parse() {
    NpyHeader header;
    Expect('{');
    while (!Accept('}')) {
      const std::string key = ParseString();
      Expect(':');
      if (key == "descr") {
        header.descr = ParseDescr();
      } else if (key == "fortran_order") {
        header.fortran_order = ParseTruth();
      } else if (key == "shape") {
        header.shape = ParseShape();
      } else {
        Fail(fmt::format("unknown key \"{}\"", key));
      }
      seen_.insert(key);
      if (!Accept(',')) {
        Expect('}');
        break;
      }
    }
    if (seen_.size() != 3) {
      Fail("expected the keys descr, fortran_order and shape");
    }
    return header;
  }

 private:
  [[noreturn]] void Fail(std::string_view message) const {
    throw InputError(file_, "NPY header", message);
  }

  // For messages, on one line.
  std::string_view Upcoming() const {
    return text_.substr(0, std::min<size_t>(text_.find('\n'), 12));
  }

  void SkipSpace() {
    while (!text_.empty() && (text_[0] == ' ' || text_[0] == '\n')) text_.remove_prefix(1);
  }
  bool Accept(char c) {
    SkipSpace();
    if (text_.empty() || text_[0] != c) return false;
    text_.remove_prefix(1);
    return true;
  }
  void Expect(char c) {
    if (!Accept(c)) Fail(fmt::format("expected \"{}\", found \"{}\"", c, Upcoming()));
  }

  std::string ParseString() {
    const char quote = Accept('"') ? '"' : '\'';
    if (quote == '\'') Expect('\'');
    const size_t end = text_.find(quote);
    if (end == std::string_view::npos || end == 0) Fail("expected a text in quotes");
    std::string value(text_.substr(0, end));
    text_.remove_prefix(end + 1);
    return value;
  }

  std::string ParseDescr() {
    SkipSpace();
    if (text_.starts_with('[')) Fail("expected numbers, found records");
    return ParseString();
  }

  bool ParseTruth() {
    SkipSpace();
    for (const std::string_view word : {"True", "False"}) {
      if (text_.starts_with(word)) {
        text_.remove_prefix(word.size());
        return word == "True";
      }
    }
    Fail("expected True or False for fortran_order");
  }

  std::vector<uint64_t> ParseShape() {
    std::vector<uint64_t> shape;
    Expect('(');
    while (!Accept(')')) {
      SkipSpace();
      const size_t end = text_.find_first_not_of("0123456789");
      const auto value = ParseUint(text_.substr(0, end));
      if (!value) Fail(fmt::format("expected a shape, found \"{}\"", Upcoming()));
      shape.push_back(*value);
      text_.remove_prefix(std::min(end, text_.size()));
      if (!Accept(',')) {
        Expect(')');
        break;
      }
    }
    return shape;
  }

  const path& file_;
  std::string_view text_;
  std::set<std::string> seen_;
};

NpyHeader ReadHeader(const path& file, std::string_view bytes) {
  const auto fail_short = [&file] { throw InputError(file, "NPY header", "the file ends here"); };
  if (bytes.size() < 10) fail_short();
  const int major = static_cast<unsigned char>(bytes[6]);
  if (major < 1 || major > 3) {
    throw InputError(file, "NPY header", fmt::format("unknown version {}", major));
  }
  const size_t length_bytes = major == 1 ? 2 : 4;
  const size_t text_offset = 8 + length_bytes;
  if (bytes.size() < text_offset) fail_short();
  uint32_t length = 0;
  std::memcpy(&length, bytes.data() + 8, length_bytes);
  if (bytes.size() - text_offset < length) fail_short();
  NpyHeader header = NpyHeaderParser(file, bytes.substr(text_offset, length)).Parse();
  header.data_offset = text_offset + length;
  return header;
}

struct Sides {
  uint64_t width, height;
};

// (H, W), with any sides of 1 before and after.
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

template <typename Sample>
Sample Load(const char* data, bool swap) {
  std::array<char, sizeof(Sample)> bytes;
  std::memcpy(bytes.data(), data, sizeof(Sample));
  if (swap) std::reverse(bytes.begin(), bytes.end());
  return std::bit_cast<Sample>(bytes);
}

struct HalfBits {
  uint16_t bits;
  explicit operator float() const {
    return static_cast<float>(Eigen::numext::bit_cast<Eigen::half>(bits));
  }
};

template <typename Sample>
void Convert(const char* data, bool swap, std::span<float> values) {
  for (size_t i = 0; i < values.size(); ++i) {
    values[i] = static_cast<float>(Load<Sample>(data + i * sizeof(Sample), swap));
  }
}

struct SampleType {
  std::string_view code, name;
  size_t num_bytes;
  void (*convert)(const char* data, bool swap, std::span<float> values);
};
constexpr std::array<SampleType, 12> kSampleTypes = {{
    {"f2", "float16", 2, &Convert<HalfBits>},
    {"f4", "float32", 4, &Convert<float>},
    {"f8", "float64", 8, &Convert<double>},
    {"u1", "uint8", 1, &Convert<uint8_t>},
    {"u2", "uint16", 2, &Convert<uint16_t>},
    {"u4", "uint32", 4, &Convert<uint32_t>},
    {"u8", "uint64", 8, &Convert<uint64_t>},
    {"i1", "int8", 1, &Convert<int8_t>},
    {"i2", "int16", 2, &Convert<int16_t>},
    {"i4", "int32", 4, &Convert<int32_t>},
    {"i8", "int64", 8, &Convert<int64_t>},
    {"b1", "bool", 1, &Convert<uint8_t>},
}};

const SampleType& FindSampleType(const path& file, const std::string& descr) {
  for (const SampleType& type : kSampleTypes) {
    if (descr.size() == 3 && std::string_view("<>|=").find(descr[0]) != std::string_view::npos &&
        std::string_view(descr).substr(1) == type.code) {
      return type;
    }
  }
  throw InputError(file, "NPY header",
                   fmt::format("expected numbers (f2, f4, f8, u1 to u8, i1 to i8), found \"{}\"{}",
                               descr, descr.find('O') != std::string::npos ? " (objects)" : ""));
}

std::vector<float> Transposed(const std::vector<float>& columns, uint64_t width, uint64_t height) {
  std::vector<float> rows(columns.size());
  for (uint64_t y = 0; y < height; ++y) {
    for (uint64_t x = 0; x < width; ++x) rows[y * width + x] = columns[x * height + y];
  }
  return rows;
}

}  // namespace

bool IsNpy(std::string_view bytes) { return bytes.starts_with(kMagic); }

StoredDepth DecodeNpy(const path& file, std::string_view bytes) {
  if (!IsNpy(bytes)) throw InputError(file, "expected an NPY array, found something else");
  const NpyHeader header = ReadHeader(file, bytes);
  const SampleType& type = FindSampleType(file, header.descr);
  const auto [width, height] = FindSides(file, header);
  const size_t num_data_bytes = bytes.size() - header.data_offset;
  CheckClaimedSize(file, width, height, num_data_bytes / type.num_bytes);
  std::vector<float> values(width * height);
  type.convert(bytes.data() + header.data_offset, header.descr[0] == '>', values);

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
  const size_t unpadded = kMagic.size() + 4 + text.size() + 1;
  text += std::string((64 - unpadded % 64) % 64, ' ') + '\n';
  std::string bytes(kMagic);
  bytes +=
      {'\x01', '\x00', static_cast<char>(text.size() & 0xff), static_cast<char>(text.size() >> 8)};
  return bytes + text;
}

void AppendSamples(std::span<const float> values, FloatSample sample, std::string& bytes) {
  if (sample == FloatSample::kFloat32) {
    bytes.append(reinterpret_cast<const char*>(values.data()), values.size_bytes());
    return;
  }
  std::vector<uint16_t> halves(values.size());
  DepthWriteReport ignored;
  RoundToHalf(values, halves, ignored);
  bytes.append(reinterpret_cast<const char*>(halves.data()), halves.size() * sizeof(uint16_t));
}

std::string EncodeNpy(const FloatPlane& plane, FloatSample sample) {
  const bool half = sample == FloatSample::kFloat16;
  std::string bytes = NpyHeaderBytes(half ? "<f2" : "<f4",
                                     fmt::format("({}, {})", plane.height_px, plane.width_px));
  AppendSamples(plane.values, sample, bytes);
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

std::string EncodeNpz(const path& file, const FloatPlane& plane, FloatSample sample,
                      const std::string& key, bool deflate) {
  return MakeZip(file, key + ".npy", EncodeNpy(plane, sample),
                 deflate ? ZipMethod::kDeflate : ZipMethod::kStore);
}

StoredDepth DecodeNpyGz(const path& file, std::string_view bytes) {
  StoredDepth depth = DecodeNpy(file, InflateGzip(file, bytes));
  depth.format = DepthFileFormat::kNpyGz;
  return depth;
}

}  // namespace raylift
