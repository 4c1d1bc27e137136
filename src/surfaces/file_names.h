// Names of files, and words of theirs in messages.

#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace raylift {

// The files that "a.ply+b.obj", "tiles/*.ply" or a folder (all files with these extensions in it)
// name, sorted within each part. A file whose own name holds "+" or "*" is that file. InputError
// where a part names no file; `kind`, as "mesh", is for the message.
std::vector<std::filesystem::path> ListFiles(const std::string& files,
                                             std::span<const std::string_view> extensions,
                                             std::string_view kind);

std::string Lower(std::string_view text);
std::string LowerExtension(const std::filesystem::path& path);

// A word for a message: its beginning, in printable ASCII.
std::string Shown(std::string_view token);

}  // namespace raylift
