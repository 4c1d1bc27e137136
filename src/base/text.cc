#include "raylift/base/text.h"

#include <charconv>
#include <cmath>

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
    if (token.starts_with('-')) {
      return std::nullopt;
    }
  }
  T value{};
  const auto [end, error] = std::from_chars(token.data(), token.data() + token.size(), value);
  if (error != std::errc() || end != token.data() + token.size()) {
    return std::nullopt;
  }
  return value;
}

}  // namespace

std::vector<std::string_view> SplitTokens(std::string_view line) {
  std::vector<std::string_view> tokens;
  size_t i = 0;
  while (i < line.size()) {
    while (i < line.size() && IsBlank(line[i])) ++i;
    const size_t begin = i;
    while (i < line.size() && !IsBlank(line[i])) ++i;
    if (i > begin) {
      tokens.push_back(line.substr(begin, i - begin));
    }
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
    if (end == std::string_view::npos) {
      return parts;
    }
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

LineReader::LineReader(const std::filesystem::path& path)
    : path_(path), contents_(ReadFile(path)) {}

LineReader::LineReader(std::filesystem::path path_for_messages, std::string contents)
    : path_(std::move(path_for_messages)), contents_(std::move(contents)) {}

std::optional<std::string_view> LineReader::Next() {
  if (position_ >= contents_.size()) {
    return std::nullopt;
  }
  ++line_number_;
  size_t end = contents_.find('\n', position_);
  if (end == std::string::npos) {
    end = contents_.size();
  }
  std::string_view line(contents_.data() + position_, end - position_);
  position_ = end + 1;
  if (line.ends_with('\r')) {
    line.remove_suffix(1);
  }
  return line;
}

std::optional<std::string_view> LineReader::NextContent() {
  while (const auto line = Next()) {
    const std::string_view trimmed = Trim(*line);
    if (!trimmed.empty() && trimmed.front() != '#') {
      return trimmed;
    }
  }
  return std::nullopt;
}

void LineReader::Fail(std::string_view message) const {
  throw InputError(path_, fmt::format("line {}", line_number_), message);
}

double LineReader::Double(std::string_view token, std::string_view field) const {
  const auto value = ParseDouble(token);
  if (!value) {
    Fail(fmt::format("{}: expected a number, found \"{}\"", field, token));
  }
  if (!std::isfinite(*value)) {
    Fail(fmt::format("{}: expected a finite number, found \"{}\"", field, token));
  }
  return *value;
}

int64_t LineReader::Int(std::string_view token, std::string_view field) const {
  const auto value = ParseInt(token);
  if (!value) {
    Fail(fmt::format("{}: expected an integer, found \"{}\"", field, token));
  }
  return *value;
}

uint64_t LineReader::Uint(std::string_view token, std::string_view field) const {
  const auto value = ParseUint(token);
  if (!value) {
    Fail(fmt::format("{}: expected a non-negative integer, found \"{}\"", field, token));
  }
  return *value;
}

}  // namespace raylift
