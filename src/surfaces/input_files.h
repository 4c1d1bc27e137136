// Opens files for reading: their names, words for messages, and their bytes in memory.

#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/mapped_file.h"

namespace raylift {

// Lists the files that "a.ply+b.obj", "tiles/*.ply" or a folder (all files with these extensions in
// it) name, sorted within each part. A file whose own name holds "+" or "*" is that file; a folder
// that holds the file `index` stands for that file. Throws InputError where a part names no file;
// its message says `kind`, as "mesh".
std::vector<std::filesystem::path> ListFiles(const std::string& files,
                                             std::span<const std::string_view> extensions,
                                             std::string_view kind, std::string_view index = {});

// Returns the beginning of a word in printable ASCII, for a message.
std::string Shown(std::string_view token);

// Returns the path that a URI without a scheme stands for: "%2e" is a dot, and a backslash is taken
// for a slash.
std::string DecodedUri(std::string_view uri);

// Gives back the memory of a part of a mapped file's contents, which comes back from the file if
// it is looked at again.
void ReleaseMapped(std::string_view part);

// Asks for large pages for memory that is about to be filled: first touch is what costs.
void AdviseLargePages(void* data, size_t size_bytes);

}  // namespace raylift
