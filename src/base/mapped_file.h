#pragma once

#include <cstddef>
#include <filesystem>
#include <string_view>

namespace raylift {

// Maps a file into memory; pages are read as they are accessed.
class MappedFile {
 public:
  // Throws InputError where the file is missing, a folder or not readable.
  explicit MappedFile(const std::filesystem::path& path);
  ~MappedFile();
  MappedFile(const MappedFile&) = delete;
  MappedFile& operator=(const MappedFile&) = delete;

  // Returns the file's bytes, valid as long as the object lives and the file is not truncated by
  // others.
  std::string_view contents() const { return {data_, size_}; }

 private:
  const char* data_ = nullptr;
  size_t size_ = 0;
};

}  // namespace raylift
