// Keeps two runs from writing to the same folder at the same time. Private to views.

#pragma once

#include <filesystem>

namespace raylift {

class FolderLock {
 public:
  // kShared: shards of one job write side by side.
  enum class Mode { kExclusive, kShared };

  // InputError where another run holds the folder; file systems without locks have none.
  FolderLock(const std::filesystem::path& folder, Mode mode);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int descriptor_;
};

}  // namespace raylift
