// A fingerprint tells a job's input in a few characters, so that a run that goes on can tell
// whether they are the same: by contents and sizes, as times of files change where these are
// copied.

#pragma once

#include <filesystem>
#include <span>
#include <string>

namespace raylift {

// Returns "SIZE HASH", or "missing". Of a file beyond 64 MB only so much is read, in evenly spaced
// pieces.
std::string FileFingerprint(const std::filesystem::path& file);

// Returns the fingerprint of many files, by their names and sizes: "COUNT HASH". They need not be
// there.
std::string SizesFingerprint(const std::filesystem::path& folder,
                             std::span<const std::string> names);
// Returns the fingerprint of all files below `folder` except those below `except`.
std::string FolderFingerprint(const std::filesystem::path& folder,
                              const std::filesystem::path& except);

}  // namespace raylift
