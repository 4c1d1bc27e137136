// Format: numpy's lib/format.py.

#include "io/binary/npy_array.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <set>
#include <type_traits>

#include "base/bytes.h"
#include <Eigen/Core>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using std::filesystem::path;

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

  // Returns what comes next on the line, for messages.
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

struct HalfBits {
  uint16_t bits;
  explicit operator float() const {
    return static_cast<float>(Eigen::numext::bit_cast<Eigen::half>(bits));
  }
  explicit operator double() const { return static_cast<float>(*this); }
};

template <typename Sample, typename Value>
void Convert(const char* data, bool swap, std::span<Value> values) {
  for (size_t i = 0; i < values.size(); ++i) {
    values[i] = static_cast<Value>(LoadNumber<Sample>(data + i * sizeof(Sample), swap));
  }
}

template <typename Sample>
constexpr NpySamples Samples(std::string_view code, std::string_view name, size_t num_bytes) {
  return {code, name, num_bytes, &Convert<Sample, float>, &Convert<Sample, double>};
}

constexpr std::array<NpySamples, 12> kSamples = {{
    Samples<HalfBits>("f2", "float16", 2),
    Samples<float>("f4", "float32", 4),
    Samples<double>("f8", "float64", 8),
    Samples<uint8_t>("u1", "uint8", 1),
    Samples<uint16_t>("u2", "uint16", 2),
    Samples<uint32_t>("u4", "uint32", 4),
    Samples<uint64_t>("u8", "uint64", 8),
    Samples<int8_t>("i1", "int8", 1),
    Samples<int16_t>("i2", "int16", 2),
    Samples<int32_t>("i4", "int32", 4),
    Samples<int64_t>("i8", "int64", 8),
    Samples<uint8_t>("b1", "bool", 1),
}};

}  // namespace

bool IsNpy(std::string_view bytes) { return bytes.starts_with(kNpyMagic); }

NpyHeader ReadNpyHeader(const path& file, std::string_view bytes) {
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

const NpySamples& SamplesOf(const path& file, const NpyHeader& header) {
  const std::string& descr = header.descr;
  for (const NpySamples& type : kSamples) {
    if (descr.size() == 3 && std::string_view("<>|=").find(descr[0]) != std::string_view::npos &&
        std::string_view(descr).substr(1) == type.code) {
      return type;
    }
  }
  throw InputError(file, "NPY header",
                   fmt::format("expected numbers (f2, f4, f8, u1 to u8, i1 to i8), found \"{}\"{}",
                               descr, descr.find('O') != std::string::npos ? " (objects)" : ""));
}

template <typename Value>
NpyArray<Value> DecodeNpyArray(const path& file, std::string_view bytes) {
  if (!IsNpy(bytes)) throw InputError(file, "expected an NPY array, found something else");
  const NpyHeader header = ReadNpyHeader(file, bytes);
  const NpySamples& type = SamplesOf(file, header);
  const uint64_t num_in_file = (bytes.size() - header.data_offset) / type.num_bytes;
  uint64_t count = 1;  // of an array without dimensions, too
  bool fits = true;
  for (const uint64_t side : header.shape) {
    fits = fits && (side == 0 || count <= num_in_file / side);
    count *= side;
  }
  if (!fits || count > num_in_file) {
    throw InputError(file, fmt::format("expected an array of shape ({}), the file holds {} values",
                                       fmt::join(header.shape, ", "), num_in_file));
  }
  NpyArray<Value> array{header.shape, std::vector<Value>(count), type.name};
  if constexpr (std::is_same_v<Value, float>) {
    type.to_float(bytes.data() + header.data_offset, header.swapped(), array.values);
  } else {
    type.to_double(bytes.data() + header.data_offset, header.swapped(), array.values);
  }
  if (!header.fortran_order || header.shape.size() < 2) return array;
  if (header.shape.size() > 2) {
    throw InputError(file, "expected at most two dimensions in Fortran's order");
  }
  const uint64_t rows = header.shape[0], columns = header.shape[1];
  const std::vector<Value> by_column = array.values;
  for (uint64_t r = 0; r < rows; ++r) {
    for (uint64_t c = 0; c < columns; ++c) array.values[r * columns + c] = by_column[c * rows + r];
  }
  return array;
}

template NpyArray<float> DecodeNpyArray(const path& file, std::string_view bytes);
template NpyArray<double> DecodeNpyArray(const path& file, std::string_view bytes);

}  // namespace raylift
