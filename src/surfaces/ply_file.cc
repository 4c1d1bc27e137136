#include "surfaces/ply_file.h"

#include <bit>

#include "base/bytes.h"
#include "surfaces/input_files.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

std::optional<PlyType> PlyTypeFromName(std::string_view name) {
  using enum PlyType;
  static constexpr std::pair<std::string_view, PlyType> kNames[] = {
      {"char", kInt8},   {"int8", kInt8},     {"uchar", kUint8},   {"uint8", kUint8},
      {"short", kInt16}, {"int16", kInt16},   {"ushort", kUint16}, {"uint16", kUint16},
      {"int", kInt32},   {"int32", kInt32},   {"uint", kUint32},   {"uint32", kUint32},
      {"float", kFloat}, {"float32", kFloat}, {"double", kDouble}, {"float64", kDouble},
  };
  for (const auto& [known, type] : kNames) {
    if (known == name) return type;
  }
  return std::nullopt;
}

class HeaderParser {
 public:
  HeaderParser(const std::filesystem::path& path, std::string_view contents)
      : path_(path), contents_(contents) {}

  PlyHeader Parse() {
    if (NextLine() != "ply") {
      throw InputError(path_, "expected a PLY file, whose first line is \"ply\"");
    }
    bool has_format = false;
    while (true) {
      const std::string_view line = NextLine();
      const auto tokens = SplitTokens(line);
      if (tokens.empty()) continue;
      const std::string_view keyword = tokens[0];
      if (keyword == "end_header") break;
      if (keyword == "format") {
        ParseFormat(tokens);
        has_format = true;
      } else if (keyword == "element") {
        ParseElement(tokens);
      } else if (keyword == "property") {
        ParseProperty(tokens);
      } else if (keyword == "comment") {
        ParseComment(line, tokens);
      } else if (keyword != "obj_info") {
        Fail(fmt::format("expected a PLY header line, found \"{}\"", Shown(keyword)));
      }
    }
    if (!has_format) {
      throw InputError(path_, "header", "expected a line \"format ...\", found none");
    }
    header_.size_bytes = position_;
    return std::move(header_);
  }

 private:
  std::string_view NextLine() {
    const size_t end = contents_.find('\n', position_);
    if (end == std::string_view::npos) {
      throw InputError(path_, "header", "the file ends before \"end_header\"");
    }
    std::string_view line = contents_.substr(position_, end - position_);
    position_ = end + 1;
    ++line_number_;
    return Trim(line);
  }

  [[noreturn]] void Fail(std::string_view message) const {
    throw InputError(path_, fmt::format("line {}", line_number_), message);
  }

  void ParseFormat(const std::vector<std::string_view>& tokens) {
    using enum PlyHeader::Format;
    const std::string_view name = tokens.size() > 1 ? tokens[1] : "";
    if (name == "ascii") {
      header_.format = kAscii;
    } else if (name == "binary_little_endian") {
      header_.format = kLittleEndian;
    } else if (name == "binary_big_endian") {
      header_.format = kBigEndian;
    } else {
      Fail(fmt::format(
          "expected format ascii, binary_little_endian or binary_big_endian, found \"{}\"",
          Shown(name)));
    }
  }

  void ParseElement(const std::vector<std::string_view>& tokens) {
    const auto count = tokens.size() == 3 ? ParseUint(tokens[2]) : std::nullopt;
    if (!count) Fail("expected \"element NAME COUNT\"");
    for (const PlyElement& element : header_.elements) {
      if (element.name == tokens[1]) Fail(fmt::format("a second element {}", Shown(tokens[1])));
    }
    header_.elements.push_back({std::string(tokens[1]), *count, {}});
  }

  void ParseProperty(const std::vector<std::string_view>& tokens) {
    if (header_.elements.empty()) Fail("a property before the first element");
    const bool is_list = tokens.size() > 1 && tokens[1] == "list";
    if (tokens.size() != (is_list ? 5u : 3u)) {
      Fail("expected \"property TYPE NAME\" or \"property list TYPE TYPE NAME\"");
    }
    PlyProperty property;
    property.name = tokens.back();
    property.type = Type(tokens[tokens.size() - 2]);
    if (is_list) {
      property.count_type = Type(tokens[2]);
      if (*property.count_type == PlyType::kFloat || *property.count_type == PlyType::kDouble) {
        Fail("expected an integer type for the length of a list");
      }
    }
    header_.elements.back().properties.push_back(std::move(property));
  }

  PlyType Type(std::string_view name) const {
    const auto type = PlyTypeFromName(name);
    if (!type) Fail(fmt::format("expected a PLY type, found \"{}\"", Shown(name)));
    return *type;
  }

  void ParseComment(std::string_view line, const std::vector<std::string_view>& tokens) {
    if (tokens.size() >= 3 && tokens[1] == "TextureFile") {
      header_.texture_files.emplace_back(
          line.substr(static_cast<size_t>(tokens[2].data() - line.data())));
    }
  }

  const std::filesystem::path& path_;
  std::string_view contents_;
  size_t position_ = 0;
  int line_number_ = 0;
  PlyHeader header_;
};

size_t RowBytes(const std::filesystem::path& path, const PlyElement& element) {
  size_t bytes = 0;
  for (const PlyProperty& property : element.properties) {
    if (property.count_type) {
      throw InputError(path, fmt::format("element {}", element.name),
                       fmt::format("expected single numbers, found the list {}", property.name));
    }
    bytes += SizeOf(property.type);
  }
  return bytes;
}

}  // namespace

PlyHeader ParsePlyHeader(const std::filesystem::path& path, std::string_view contents) {
  return HeaderParser(path, contents).Parse();
}

PlyColumns::PlyColumns(const std::filesystem::path& path, const PlyHeader& header,
                       std::string_view contents, std::string_view name)
    : path_(path),
      swap_bytes_((header.format == PlyHeader::Format::kBigEndian) !=
                  (std::endian::native == std::endian::big)) {
  if (header.format == PlyHeader::Format::kAscii) {
    throw InputError(path, "header", "expected format binary_little_endian, found ascii");
  }
  contents.remove_prefix(header.size_bytes);
  for (const PlyElement& element : header.elements) {
    const size_t row_bytes = RowBytes(path, element);
    const uint64_t room = row_bytes == 0 ? 0 : contents.size() / row_bytes;
    if (element.count > room) {
      throw InputError(path, fmt::format("element {}", element.name),
                       fmt::format("the header claims {} of them, the file has room for {}",
                                   element.count, room));
    }
    if (element.name == name) {
      element_ = element;
      row_bytes_ = row_bytes;
      num_rows_ = element.count;
      rows_ = contents.substr(0, num_rows_ * row_bytes);
      return;
    }
    contents.remove_prefix(element.count * row_bytes);
  }
  throw InputError(path, "header", fmt::format("expected the element {}", name));
}

std::optional<PlyColumns::Column> PlyColumns::Find(std::string_view property) const {
  size_t offset = 0;
  for (const PlyProperty& known : element_.properties) {
    if (known.name == property) return Column{offset, known.type};
    offset += SizeOf(known.type);
  }
  return std::nullopt;
}

PlyColumns::Column PlyColumns::Get(std::string_view property) const {
  const auto column = Find(property);
  if (!column) {
    throw InputError(path_, fmt::format("element {}", element_.name),
                     fmt::format("expected the property {}", property));
  }
  return *column;
}

PlyColumns::Column PlyColumns::Get(std::string_view property, PlyType type) const {
  const Column column = Get(property);
  if (column.type != type) {
    throw InputError(path_, fmt::format("element {}, {}", element_.name, property),
                     "is not of the type that this layout has");
  }
  return column;
}

double PlyColumns::At(size_t row, const Column& column) const {
  const char* const from = rows_.data() + row * row_bytes_ + column.offset;
  return WithPlyValue(column.type, [&](auto value) {
    return static_cast<double>(LoadNumber<decltype(value)>(from, swap_bytes_));
  });
}

}  // namespace raylift
