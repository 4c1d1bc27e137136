#include "ply_header.h"

#include <algorithm>

#include "foreign_text.h"
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
    if (!count) {
      Fail("expected \"element NAME COUNT\"");
    }
    for (const PlyElement& element : header_.elements) {
      if (element.name == tokens[1]) Fail(fmt::format("a second element {}", Shown(tokens[1])));
    }
    header_.elements.push_back({std::string(tokens[1]), *count, {}});
  }

  void ParseProperty(const std::vector<std::string_view>& tokens) {
    if (header_.elements.empty()) {
      Fail("a property before the first element");
    }
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
    if (!type) {
      Fail(fmt::format("expected a PLY type, found \"{}\"", Shown(name)));
    }
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

}  // namespace

size_t SizeOf(PlyType type) {
  using enum PlyType;
  switch (type) {
    case kInt8:
    case kUint8:
      return 1;
    case kInt16:
    case kUint16:
      return 2;
    case kInt32:
    case kUint32:
    case kFloat:
      return 4;
    case kDouble:
      return 8;
  }
  return 0;
}

PlyHeader ParsePlyHeader(const std::filesystem::path& path, std::string_view contents) {
  return HeaderParser(path, contents).Parse();
}

}  // namespace raylift
