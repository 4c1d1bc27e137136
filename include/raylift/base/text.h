// Plain text files of numbers and names, read strictly, so that a wrong token is an error with its
// line; and what else is done with names, numbers and tables as text.

#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace raylift {

// Returns the white-space separated tokens of a line; views into it.
std::vector<std::string_view> SplitTokens(std::string_view line);

// Returns the tokens of a line separated by `separator`, each trimmed; views into it.
std::vector<std::string_view> SplitBy(std::string_view line, char separator);

std::string_view Trim(std::string_view text);

// Returns the whole token as a number; nullopt if it is none. Accepts non-finite doubles, too.
std::optional<double> ParseDouble(std::string_view token);
std::optional<int64_t> ParseInt(std::string_view token);
std::optional<uint64_t> ParseUint(std::string_view token);

// Returns the shortest text that reads back as the same double.
std::string FormatDouble(double value);

// Walks the lines of a text and knows where it is, for the messages.
class LineReader {
 public:
  // Reads the file. Throws InputError where it cannot be read.
  explicit LineReader(const std::filesystem::path& path);
  LineReader(std::filesystem::path path_for_messages, std::string contents);

  // Returns the next line without its end (LF or CRLF); nullopt at the end of the file.
  std::optional<std::string_view> Next();

  // Returns the next line that is neither blank nor a `#` comment; nullopt if there is none.
  std::optional<std::string_view> NextContent();

  int line_number() const { return line_number_; }
  const std::filesystem::path& path() const { return path_; }

  // Throws InputError "FILE: line N: MESSAGE".
  [[noreturn]] void Fail(std::string_view message) const;

  // Returns the finite number, or the count, that a token holds; `field` names it in the message.
  double Double(std::string_view token, std::string_view field) const;
  int64_t Int(std::string_view token, std::string_view field) const;
  uint64_t Uint(std::string_view token, std::string_view field) const;

 private:
  std::filesystem::path path_;
  std::string contents_;
  size_t position_ = 0;
  int line_number_ = 0;
};

// Returns the fewest letters to change, add, leave out or swap with their neighbor to turn `a` into
// `b`.
size_t EditDistance(std::string_view a, std::string_view b);

// Returns the one of `names` with the fewest such mistakes, the first of several; nullopt if they
// are more than a third of its letters.
std::optional<std::string> ClosestName(std::string_view typed, std::span<const std::string> names);

// Returns "; did you mean NAME?", or nothing.
std::string DidYouMean(std::string_view typed, std::span<const std::string> names);

using TableRow = std::vector<std::string>;

// Returns the rows as aligned text: the first column flush left, the others flush right. All rows
// are as long as the first.
std::string AlignColumns(std::span<const TableRow> rows);

// Returns one line of CSV (RFC 4180) with its end; fields are quoted where they must be.
std::string CsvLine(const TableRow& fields);

// Returns the text with question marks for control characters, which would break the lines of a
// table.
std::string Printable(std::string text);

// Returns bytes in Base64 (RFC 4648).
std::string EncodeBase64(std::string_view bytes);
// Returns the bytes. Throws InputError where the text is no Base64. The padding may be left out.
std::string DecodeBase64(std::string_view text);

// Returns each name's place, from 0, in the order of the numbers in the names: img_2 is before
// img_10.
std::map<std::string, double> PlacesByNumbers(std::span<const std::string> names);

}  // namespace raylift
