// Checks files that come from outside: only regular ones are read, as others may never end.

#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace raylift {

// Checks a file for readers that open it themselves. Throws InputError where it is missing or not a
// regular file.
void RequireRegularFile(const std::filesystem::path& path);

// Returns all regular files below a folder, sorted. Links to folders are followed, but for those
// that lead back. Throws InputError where a folder cannot be read.
std::vector<std::filesystem::path> ListFilesBelow(const std::filesystem::path& folder);

// Returns a file's path from a folder that it lies in or below, or is; nullopt where it does not.
// Goes by what both paths say, links or not.
std::optional<std::filesystem::path> Below(const std::filesystem::path& file,
                                           const std::filesystem::path& folder);

// Return names and extensions in lower case (ASCII), for comparisons.
std::string Lower(std::string_view text);
std::string LowerExtension(const std::filesystem::path& path);

// Returns whether a file may have parts of it anywhere. It can read what its user may not have
// meant to show: only where the environment's RAYLIFT_FILES_ANYWHERE is 1.
bool FilesMayBeAnywhere();

// Returns whether a file that another one names may be read: it lies in or below that one's folder,
// or may be anywhere.
bool MayBeRead(const std::string& named);

}  // namespace raylift
