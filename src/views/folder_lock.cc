#include "folder_lock.h"

#include <cerrno>

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include "raylift/base/error.h"

namespace raylift {

FolderLock::FolderLock(const std::filesystem::path& folder, Mode mode)
    : descriptor_(open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
  if (descriptor_ < 0) return;
  const int operation = mode == Mode::kExclusive ? LOCK_EX : LOCK_SH;
  if (flock(descriptor_, operation | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
    close(descriptor_);
    throw InputError(folder, "another run is writing to this folder");
  }
}

FolderLock::~FolderLock() {
  if (descriptor_ >= 0) close(descriptor_);
}

}  // namespace raylift
