#include "raylift/base/text.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>

#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

bool IsBlank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f'; }

template <typename T>
std::optional<T> ParseWhole(std::string_view token) {
  if (token.starts_with('+')) {  // from_chars takes none
    token.remove_prefix(1);
    if (token.starts_with('-')) return std::nullopt;
  }
  T value{};
  const auto [end, error] = std::from_chars(token.data(), token.data() + token.size(), value);
  if (error != std::errc() || end != token.data() + token.size()) return std::nullopt;
  return value;
}

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

// Counts the characters, not bytes, of UTF-8.
size_t Width(std::string_view text) {
  return static_cast<size_t>(std::count_if(text.begin(), text.end(), [](char c) {
    return (static_cast<unsigned char>(c) & 0xc0) != 0x80;
  }));
}

}  // namespace

std::vector<std::string_view> SplitTokens(std::string_view line) {
  std::vector<std::string_view> tokens;
  size_t i = 0;
  while (i < line.size()) {
    while (i < line.size() && IsBlank(line[i])) ++i;
    const size_t begin = i;
    while (i < line.size() && !IsBlank(line[i])) ++i;
    if (i > begin) tokens.push_back(line.substr(begin, i - begin));
  }
  return tokens;
}

std::string_view Trim(std::string_view text) {
  while (!text.empty() && (IsBlank(text.front()) || text.front() == '\n')) text.remove_prefix(1);
  while (!text.empty() && (IsBlank(text.back()) || text.back() == '\n')) text.remove_suffix(1);
  return text;
}

std::vector<std::string_view> SplitBy(std::string_view line, char separator) {
  std::vector<std::string_view> parts;
  while (true) {
    const size_t end = line.find(separator);
    parts.push_back(Trim(line.substr(0, end)));
    if (end == std::string_view::npos) return parts;
    line.remove_prefix(end + 1);
  }
}

std::optional<double> ParseDouble(std::string_view token) { return ParseWhole<double>(token); }
std::optional<int64_t> ParseInt(std::string_view token) { return ParseWhole<int64_t>(token); }
std::optional<uint64_t> ParseUint(std::string_view token) { return ParseWhole<uint64_t>(token); }

std::string FormatDouble(double value) {
  char buffer[32];
  const auto result = std::to_chars(buffer, buffer + sizeof(buffer), value);
  return {buffer, result.ptr};
}

LineReader::LineReader(const std::filesystem::path& path) : LineReader(path, ReadFile(path)) {}

LineReader::LineReader(std::filesystem::path path_for_messages, std::string contents)
    : path_(std::move(path_for_messages)), contents_(std::move(contents)) {
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";  // as Windows' editors write it
  if (contents_.starts_with(kByteOrderMark)) position_ = kByteOrderMark.size();
}

std::optional<std::string_view> LineReader::Next() {
  if (position_ >= contents_.size()) return std::nullopt;
  ++line_number_;
  size_t end = contents_.find('\n', position_);
  if (end == std::string::npos) end = contents_.size();
  std::string_view line(contents_.data() + position_, end - position_);
  position_ = end + 1;
  if (line.ends_with('\r')) line.remove_suffix(1);
  return line;
}

std::optional<std::string_view> LineReader::NextContent() {
  while (const auto line = Next()) {
    const std::string_view trimmed = Trim(*line);
    if (!trimmed.empty() && trimmed.front() != '#') return trimmed;
  }
  return std::nullopt;
}

void LineReader::Fail(std::string_view message) const {
  throw InputError(path_, fmt::format("line {}", line_number_), message);
}

double LineReader::Double(std::string_view token, std::string_view field) const {
  const auto value = ParseDouble(token);
  if (!value) Fail(fmt::format("{}: expected a number, found \"{}\"", field, token));
  if (!std::isfinite(*value)) {
    Fail(fmt::format("{}: expected a finite number, found \"{}\"", field, token));
  }
  return *value;
}

int64_t LineReader::Int(std::string_view token, std::string_view field) const {
  const auto value = ParseInt(token);
  if (!value) Fail(fmt::format("{}: expected an integer, found \"{}\"", field, token));
  return *value;
}

uint64_t LineReader::Uint(std::string_view token, std::string_view field) const {
  const auto value = ParseUint(token);
  if (!value) Fail(fmt::format("{}: expected a non-negative integer, found \"{}\"", field, token));
  return *value;
}

size_t EditDistance(std::string_view a, std::string_view b) {
  // Distances of the first i letters of a to the first j of b, for the last three i.
  std::vector<size_t> before(b.size() + 1), last(b.size() + 1), row(b.size() + 1);
  for (size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (size_t i = 1; i <= a.size(); ++i) {
    std::swap(before, last);
    std::swap(last, row);
    row[0] = i;
    for (size_t j = 1; j <= b.size(); ++j) {
      const size_t changed = last[j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1);
      row[j] = std::min({changed, last[j] + 1, row[j - 1] + 1});
      const bool swapped = i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1];
      if (swapped) row[j] = std::min(row[j], before[j - 2] + 1);
    }
  }
  return row[b.size()];
}

std::optional<std::string> ClosestName(std::string_view typed, std::span<const std::string> names) {
  std::optional<std::string> closest;
  size_t least = 0;
  for (const std::string& name : names) {
    const size_t distance = EditDistance(typed, name);
    if (3 * distance <= name.size() && (!closest || distance < least)) {
      closest = name;
      least = distance;
    }
  }
  return closest;
}

std::string DidYouMean(std::string_view typed, std::span<const std::string> names) {
  const auto closest = ClosestName(typed, names);
  return closest ? fmt::format("; did you mean {}?", *closest) : "";
}

std::string AlignColumns(std::span<const TableRow> rows) {
  if (rows.empty()) return {};
  std::vector<size_t> widths(rows.front().size(), 0);
  for (const TableRow& row : rows) {
    RAYLIFT_CHECK_EQ(row.size(), widths.size());
    for (size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], Width(row[i]));
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

namespace {

constexpr std::string_view kBase64Digits =
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

}  // namespace

std::string EncodeBase64(std::string_view bytes) {
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (size_t i = 0; i < bytes.size(); i += 3) {
    uint32_t group = 0;
    for (size_t k = 0; k < 3; ++k) {
      group = group << 8 | (i + k < bytes.size() ? static_cast<uint8_t>(bytes[i + k]) : 0U);
    }
    for (size_t k = 0; k < 4; ++k) {
      text += i + k <= bytes.size() ? kBase64Digits[group >> (18 - 6 * k) & 63] : '=';
    }
  }
  return text;
}

std::string DecodeBase64(std::string_view text) {
  static const std::array<int8_t, 256> values = [&] {
    std::array<int8_t, 256> table;
    table.fill(-1);
    for (size_t i = 0; i < kBase64Digits.size(); ++i) {
      table[static_cast<unsigned char>(kBase64Digits[i])] = static_cast<int8_t>(i);
    }
    return table;
  }();
  for (int i = 0; i < 2 && text.ends_with('='); ++i) text.remove_suffix(1);
  if (text.size() % 4 == 1) throw InputError("expected base64, found a text of another length");
  std::string bytes;
  bytes.reserve(text.size() / 4 * 3 + 2);
  uint32_t bits = 0;
  int num_bits = 0;
  for (const char c : text) {
    const int8_t value = values[static_cast<unsigned char>(c)];
    if (value < 0) throw InputError("expected base64, found another character");
    bits = bits << 6 | static_cast<uint32_t>(value);
    num_bits += 6;
    if (num_bits >= 8) {
      num_bits -= 8;
      bytes += static_cast<char>(bits >> num_bits & 0xFF);
    }
  }
  return bytes;
}

namespace {

// Returns the name with numbers of equal length.
std::string OrderKey(std::string_view name) {
  constexpr size_t kLengthOfNumber = 20;
  constexpr std::string_view kAllDigits = "0123456789";
  std::string key;
  while (!name.empty()) {
    std::string_view digits = name.substr(0, name.find_first_not_of(kAllDigits));
    name.remove_prefix(digits.size());
    digits.remove_prefix(std::min(digits.find_first_not_of('0'), digits.size()));
    if (digits.size() < kLengthOfNumber) key.append(kLengthOfNumber - digits.size(), '0');
    key += digits;
    const std::string_view text = name.substr(0, name.find_first_of(kAllDigits));
    key += text;
    name.remove_prefix(text.size());
  }
  return key;
}

}  // namespace

std::map<std::string, double> PlacesByNumbers(std::span<const std::string> names) {
  std::vector<std::pair<std::string, std::string>> sorted;
  for (const std::string& name : names) sorted.emplace_back(OrderKey(name), name);
  std::sort(sorted.begin(), sorted.end());
  std::map<std::string, double> places;
  for (const auto& [key, name] : sorted) places.emplace(name, static_cast<double>(places.size()));
  return places;
}

}  // namespace raylift
