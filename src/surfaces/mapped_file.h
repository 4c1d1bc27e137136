// A file in memory, read page by page as it is looked at.

#pragma once

#include <cstddef>
#include <filesystem>
#include <string_view>

namespace raylift {

class MappedFile {
 public:
  // InputError where the file is missing, a folder or not readable.
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
