// Tables as text: aligned for reading, and CSV.

#pragma once

#include <span>
#include <string>
#include <vector>

namespace raylift {

using TableRow = std::vector<std::string>;

// The first column to the left, the others to the right; all rows are as long as the first.
std::string AlignColumns(std::span<const TableRow> rows);

// One line of RFC 4180 with its end; fields are quoted where they must be.
std::string CsvLine(const TableRow& fields);

// Control characters, which would break the lines of a table, become question marks.
std::string Printable(std::string text);

}  // namespace raylift
