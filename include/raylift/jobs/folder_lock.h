// Keeps two runs from writing to the same folder at the same time.

#pragma once

#include <filesystem>

namespace raylift {

class FolderLock {
 public:
  // kShared: shards of one job write side by side.
  enum class Mode { kExclusive, kShared };
  // kWait: a watch of the call (base/parallel.h) can end the waiting.
  enum class IfHeld { kFail, kWait };

  // InputError where another run holds the folder; file systems without locks have none.
  FolderLock(const std::filesystem::path& folder, Mode mode, IfHeld if_held = IfHeld::kFail);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int descriptor_;
};

}  // namespace raylift
