#pragma once

#include <cstddef>
#include <filesystem>
#include <string_view>

namespace raylift {

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

}  // namespace raylift
