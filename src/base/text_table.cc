#include "raylift/base/text_table.h"

#include <algorithm>
#include <string_view>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

std::string CsvField(const std::string& text) {
  const bool is_plain = text.find_first_of(",\"\r\n") == std::string::npos && Trim(text) == text;
  if (is_plain) return text;
  std::string quoted = "\"";
  for (const char c : text) {
    quoted += c;
    if (c == '"') quoted += c;
  }
  return quoted + '"';
}

// Characters, not bytes, of UTF-8.
size_t Width(std::string_view text) {
  return static_cast<size_t>(std::count_if(text.begin(), text.end(), [](char c) {
    return (static_cast<unsigned char>(c) & 0xc0) != 0x80;
  }));
}

}  // namespace

std::string AlignColumns(std::span<const TableRow> rows) {
  if (rows.empty()) return {};
  std::vector<size_t> widths(rows.front().size(), 0);
  for (const TableRow& row : rows) {
    RAYLIFT_CHECK_EQ(row.size(), widths.size());
    for (size_t i = 0; i < row.size(); ++i) {
      widths[i] = std::max(widths[i], Width(row[i]));
    }
  }
  std::string text;
  for (const TableRow& row : rows) {
    for (size_t i = 0; i < row.size(); ++i) {
      const std::string padding(widths[i] - Width(row[i]), ' ');
      text += i == 0 ? row[i] + padding : "  " + padding + row[i];
    }
    text += '\n';
  }
  return text;
}

std::string CsvLine(const TableRow& fields) {
  std::string line;
  for (size_t i = 0; i < fields.size(); ++i) {
    line += i > 0 ? "," : "";
    line += CsvField(fields[i]);
  }
  return line + '\n';
}

std::string Printable(std::string text) {
  for (char& c : text) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
  }
  return text;
}

}  // namespace raylift
