#include "raylift/jobs/folder_lock.h"

#include <cerrno>
#include <chrono>
#include <thread>

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr std::chrono::milliseconds kBetweenTries{100};

}  // namespace

FolderLock::FolderLock(const std::filesystem::path& folder, Mode mode, IfHeld if_held)
    : descriptor_(open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
  if (descriptor_ < 0) return;
  const int operation = mode == Mode::kExclusive ? LOCK_EX : LOCK_SH;
  try {
    while (flock(descriptor_, operation | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
      if (if_held == IfHeld::kFail) {
        throw InputError(folder, "another run is writing to this folder");
      }
      if (CallWatch* const watch = CallWatch::Current()) watch->Check();
      std::this_thread::sleep_for(kBetweenTries);
    }
  } catch (...) {
    close(descriptor_);
    throw;
  }
}

FolderLock::~FolderLock() {
  if (descriptor_ >= 0) close(descriptor_);
}

}  // namespace raylift
