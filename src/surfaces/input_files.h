// Files that are read: their names, words of theirs in messages, and their bytes in memory.

#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace raylift {

// Lists the files that "a.ply+b.obj", "tiles/*.ply" or a folder (all files with these extensions in
// it) name, sorted within each part. A file whose own name holds "+" or "*" is that file; a folder
// that holds the file `index` is that one. Throws InputError where a part names no file; `kind`, as
// "mesh", is for the message.
std::vector<std::filesystem::path> ListFiles(const std::string& files,
                                             std::span<const std::string_view> extensions,
                                             std::string_view kind, std::string_view index = {});

// A word for a message: its beginning, in printable ASCII.
std::string Shown(std::string_view token);

// The path that a URI without a scheme says: "%2e" is a dot, and a backslash is taken for a slash.
std::string DecodedUri(std::string_view uri);

// A file in memory, read page by page as it is looked at.
class MappedFile {
 public:
  // Throws InputError where the file is missing, a folder or not readable.
  explicit MappedFile(const std::filesystem::path& path);
  ~MappedFile();
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;

  // Valid as long as the object lives and the file is not cut short by others.
  std::string_view contents() const { return {data_, size_}; }

 private:
  const char* data_ = nullptr;
  size_t size_ = 0;
};

// Gives back the memory of a part of a mapped file's contents, which comes back from the file if
// it is looked at again.
void ReleaseMapped(std::string_view part);

// Asks for large pages for memory that is about to be filled: first touch is what costs.
void AdviseLargePages(void* data, size_t size_bytes);

}  // namespace raylift
