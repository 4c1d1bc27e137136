#include "base/mapped_file.h"

#include <cerrno>
#include <cstring>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "raylift/base/error.h"

namespace raylift {

MappedFile::MappedFile(const std::filesystem::path& path) {
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  struct stat status {};
  if (file < 0 || fstat(file, &status) != 0) {
    const int error = errno;
    if (file >= 0) close(file);
    throw InputError(path, fmt::format("cannot be read: {}", std::strerror(error)));
  }
  if (!S_ISREG(status.st_mode)) {
    close(file);
    throw InputError(path, "expected a file, found a folder or a device");
  }
  size_ = static_cast<size_t>(status.st_size);
  void* mapped = MAP_FAILED;
  if (size_ > 0) mapped = mmap(nullptr, size_, PROT_READ, MAP_PRIVATE, file, 0);
  const int error = errno;
  close(file);
  if (size_ > 0 && mapped == MAP_FAILED) {
    throw InputError(path, fmt::format("cannot be read: {}", std::strerror(error)));
  }
  if (size_ > 0) {
    madvise(mapped, size_, MADV_SEQUENTIAL);
    data_ = static_cast<const char*>(mapped);
  }
}

MappedFile::~MappedFile() {
  if (data_ != nullptr) munmap(const_cast<char*>(data_), size_);
}

}  // namespace raylift
