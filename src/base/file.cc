#include "raylift/base/file.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cctype>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <mutex>
#include <set>
#include <system_error>
#include <utility>
#include <vector>

#include "base/hash.h"
#include "base/input_paths.h"
#include <fcntl.h>
#include <fmt/format.h>
#include <linux/magic.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

// Tells apart where process numbers are given: machines that share a folder, which may have one
// name, and containers.
const std::string& ThisHost() {
  static const std::string host = [] {
    char name[256] = {};
    gethostname(name, sizeof(name) - 1);
    std::string start;  // of the machine
    std::ifstream("/proc/sys/kernel/random/boot_id") >> start;
    std::error_code ignored;
    const auto numbers = std::filesystem::read_symlink("/proc/self/ns/pid", ignored);
    return HexText(HashBytes64(name + start + numbers.string())).substr(0, 8);
  }();
  return host;
}

// Returns a name beside the target, so that the rename stays on one file system; unique to host,
// process and call.
std::filesystem::path TemporaryName(const std::filesystem::path& path) {
  static std::atomic<unsigned> counter{0};
  return path.parent_path() / fmt::format(".{}.{}-{}-{}.tmp{}", path.stem().string(), ThisHost(),
                                          getpid(), counter++, path.extension().string());
}

struct TemporaryFile {
  std::filesystem::path target;
  std::string host;
  pid_t process;
};

// Parses ".STEM.HOST-PROCESS-COUNT.tmp.EXTENSION" or, for a target without extension,
// ".STEM....tmp".
std::optional<TemporaryFile> ParseTemporary(const std::filesystem::path& path) {
  std::filesystem::path name = path.filename();
  std::filesystem::path extension;
  if (name.stem().extension() == ".tmp") {
    extension = name.extension();
    name = name.stem();
  }
  if (name.extension() != ".tmp") return std::nullopt;
  name = name.stem();
  const std::string stem = name.stem().string(), writer = name.extension().string();
  if (!stem.starts_with('.') || writer.empty()) return std::nullopt;
  const std::vector<std::string_view> parts = SplitBy(std::string_view(writer).substr(1), '-');
  if (parts.size() != 3 || parts[0].empty()) return std::nullopt;
  const auto process = ParseInt(parts[1]), count = ParseInt(parts[2]);
  if (!process || !count || *process <= 0 || *count < 0) return std::nullopt;
  return TemporaryFile{path.parent_path() / (stem.substr(1) + extension.string()),
                       std::string(parts[0]), static_cast<pid_t>(*process)};
}

// Lists and settings are far smaller.
constexpr size_t kMostOfPipe = size_t{256} << 20;

class OpenFile {
 public:
  explicit OpenFile(int descriptor) : descriptor_(descriptor) {}
  ~OpenFile() {
    if (descriptor_ >= 0) close(descriptor_);
  }
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;

  int descriptor() const { return descriptor_; }

 private:
  int descriptor_;
};

// Returns whether it is one of a shell: a file system of its own has them.
bool IsPipeWithoutName(int descriptor, const struct stat& status) {
  struct statfs file_system {};
  return S_ISFIFO(status.st_mode) && fstatfs(descriptor, &file_system) == 0 &&
         file_system.f_type == PIPEFS_MAGIC;
}

thread_local CommittedFiles* committed_files = nullptr;

enum class Synced { kContents, kFolder, kFileSystem };

int Sync(int descriptor, Synced what) {
  switch (what) {
    case Synced::kContents:
      return fdatasync(descriptor);
    case Synced::kFolder:
      return fsync(descriptor);
    case Synced::kFileSystem:
      return syncfs(descriptor);
  }
  return 0;
}

void SyncOne(const std::filesystem::path& path, Synced what) {
  const OpenFile file(open(path.empty() ? "." : path.c_str(), O_RDONLY | O_CLOEXEC));
  if (file.descriptor() >= 0 && Sync(file.descriptor(), what) == 0) return;
  if (CannotSyncHere(errno)) return;
  throw OutputError(path, fmt::format("cannot be synced: {}", std::strerror(errno)));
}

// Many files take 5 ms each by themselves and less than .1 ms each at once.
constexpr size_t kMostSyncedAlone = 4;

// Returns whether the process has ended; false, too, where that cannot be told.
bool HasEnded(const TemporaryFile& file) {
  return file.host == ThisHost() && kill(file.process, 0) != 0 && errno == ESRCH;
}

}  // namespace

bool CannotSyncHere(int error) {
  constexpr std::array kErrors = {EINVAL, ENOTSUP, ENOSYS, EACCES, EPERM, ENOENT};
  return std::find(kErrors.begin(), kErrors.end(), error) != kErrors.end();
}

void RequireRegularFile(const std::filesystem::path& path) {
  using enum std::filesystem::file_type;
  std::error_code error;
  const auto type = std::filesystem::status(path, error).type();
  if (type == regular) return;
  if (type == not_found) throw InputError(path, "no such file");
  if (type == none) {
    throw InputError(path, fmt::format("cannot be read: {}", error.message()));
  }
  const bool is_pipe = type == fifo || type == socket;
  throw InputError(path, fmt::format("expected a file, found a {}", type == directory ? "folder"
                                                                    : is_pipe         ? "pipe"
                                                                                      : "device"));
}

bool FilesMayBeAnywhere() {
  const char* value = std::getenv("RAYLIFT_FILES_ANYWHERE");
  return value != nullptr && std::string_view(value) == "1";
}

std::optional<std::filesystem::path> Below(const std::filesystem::path& file,
                                           const std::filesystem::path& folder) {
  std::filesystem::path below = file.lexically_relative(folder);
  if (below.empty() || *below.begin() == "..") return std::nullopt;
  return below;
}

bool MayBeRead(const std::string& named) {
  const std::filesystem::path file = std::filesystem::path(named).lexically_normal();
  return FilesMayBeAnywhere() || (file.is_relative() && !file.empty() && *file.begin() != ".." &&
                                  named.find("://") == std::string::npos);
}

bool Exists(const std::filesystem::path& path) {
  std::error_code ignored;
  return std::filesystem::exists(path, ignored);
}

bool IsFolder(const std::filesystem::path& path) {
  std::error_code ignored;
  return std::filesystem::is_directory(path, ignored);
}

bool IsFile(const std::filesystem::path& path) {
  std::error_code ignored;
  return std::filesystem::is_regular_file(path, ignored);
}

std::string ReadFile(const std::filesystem::path& path) {
  // Without O_NONBLOCK, a pipe with a name waits for somebody to write.
  const OpenFile file(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  struct stat status {};
  if (file.descriptor() < 0 || fstat(file.descriptor(), &status) != 0) {
    const int error = errno;
    RequireRegularFile(path);
    throw InputError(path, fmt::format("cannot be read: {}", std::strerror(error)));
  }
  const bool is_pipe = IsPipeWithoutName(file.descriptor(), status);
  if (!is_pipe) RequireRegularFile(path);
  fcntl(file.descriptor(), F_SETFL, O_RDONLY);
  std::string contents;
  contents.reserve(static_cast<size_t>(status.st_size));
  char buffer[1 << 16];
  for (;;) {
    const ssize_t count = read(file.descriptor(), buffer, sizeof(buffer));
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) throw InputError(path, "cannot be read to its end");
    if (count == 0) return contents;
    contents.append(buffer, static_cast<size_t>(count));
    if (is_pipe && contents.size() > kMostOfPipe) {
      throw InputError(
          path, fmt::format("the pipe holds more than {} MB: give a file", kMostOfPipe >> 20));
    }
  }
}

std::vector<std::filesystem::path> ListFilesBelow(const std::filesystem::path& folder) {
  namespace fs = std::filesystem;
  std::vector<fs::path> files;
  std::error_code error, ignored;
  std::vector<fs::path> way = {fs::canonical(folder, error)};
  constexpr auto kFollow = fs::directory_options::follow_directory_symlink;
  for (fs::recursive_directory_iterator entry(folder, kFollow, error), end; !error && entry != end;
       entry.increment(error)) {
    if (entry->is_regular_file(ignored)) files.push_back(entry->path());
    if (!entry->is_directory(ignored)) continue;
    way.resize(static_cast<size_t>(entry.depth()) + 1);
    way.push_back(fs::canonical(entry->path(), ignored));
    const bool leads_back = std::find(way.begin(), way.end() - 1, way.back()) != way.end() - 1;
    if (leads_back) entry.disable_recursion_pending();
  }
  if (error) {
    throw InputError(folder, fmt::format("cannot be listed: {}", error.message()));
  }
  std::sort(files.begin(), files.end());
  return files;
}

std::string Lower(std::string_view text) {
  std::string lower(text);
  std::transform(lower.begin(), lower.end(), lower.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return lower;
}

std::string LowerExtension(const std::filesystem::path& path) {
  return Lower(path.extension().string());
}

void WriteFile(const std::filesystem::path& path, std::string_view contents) {
  WriteFile(path, std::span(&contents, 1));
}

void WriteFile(const std::filesystem::path& path, std::span<const std::string_view> parts) {
  AtomicFile file(path);
  {
    std::ofstream stream(file.temporary_path(), std::ios::binary);
    for (const std::string_view part : parts) {
      stream.write(part.data(), static_cast<std::streamsize>(part.size()));
    }
    stream.close();
    if (!stream) {
      throw OutputError(path, fmt::format("cannot be written: {}", std::strerror(errno)));
    }
  }
  file.Commit();
}

void RequireWritable(const std::filesystem::path& path) {
  if (IsFolder(path)) {
    throw OutputError(path, "cannot be written: it is a folder");
  }
  const AtomicFile file(path);
  if (!std::ofstream(file.temporary_path(), std::ios::binary)) {
    throw OutputError(path, fmt::format("cannot be written: {}", std::strerror(errno)));
  }
}

std::optional<std::filesystem::path> TargetOfTemporary(const std::filesystem::path& path) {
  auto file = ParseTemporary(path);
  if (!file) return std::nullopt;
  return std::move(file->target);
}

void RemoveLeftTemporaries(const std::filesystem::path& folder) {
  std::vector<std::filesystem::path> left;
  std::error_code error;
  for (std::filesystem::recursive_directory_iterator entry(folder, error), end;
       !error && entry != end; entry.increment(error)) {
    const auto file = ParseTemporary(entry->path());
    if (file && HasEnded(*file)) left.push_back(entry->path());
  }
  for (const std::filesystem::path& path : left) std::filesystem::remove(path, error);
}

std::filesystem::path PathBelow(const std::filesystem::path& folder,
                                const std::filesystem::path& name) {
  std::filesystem::path file = folder;
  for (const std::filesystem::path& part : name.relative_path()) {
    if (part != "..") file /= part;
  }
  return file;
}

void MakeFolders(const std::filesystem::path& folder) {
  static std::mutex mutex;  // what another thread has made is synced when it is found
  const std::lock_guard<std::mutex> lock(mutex);
  std::error_code error;
  std::vector<std::filesystem::path> parents;
  for (std::filesystem::path made = folder; !made.empty() && !std::filesystem::exists(made, error);
       made = made.parent_path()) {
    parents.push_back(made.parent_path());
  }
  if (parents.empty()) return;
  std::filesystem::create_directories(folder, error);
  if (error) {
    throw OutputError(folder, fmt::format("the folder cannot be made: {}", error.message()));
  }
  for (const std::filesystem::path& parent : parents) SyncOne(parent, Synced::kFolder);
}

AtomicFile::AtomicFile(std::filesystem::path path) : path_(std::move(path)) {
  MakeFolders(path_.parent_path());
  temporary_path_ = TemporaryName(path_);
}

AtomicFile::~AtomicFile() {
  if (!committed_) {
    std::error_code ignored;
    std::filesystem::remove(temporary_path_, ignored);
  }
}

void AtomicFile::Commit() {
  using enum CommittedFiles::Sync;
  const bool syncs = committed_files == nullptr || committed_files->sync_ == kAtOnce;
  if (syncs) SyncOne(temporary_path_, Synced::kContents);
  std::error_code error;
  std::filesystem::rename(temporary_path_, path_, error);
  if (error) throw OutputError(path_, fmt::format("cannot be written: {}", error.message()));
  committed_ = true;
  if (syncs) SyncOne(path_.parent_path(), Synced::kFolder);
  if (committed_files != nullptr) committed_files->paths_.push_back(path_);
}

void SyncFiles(std::span<const std::filesystem::path> files) {
  const bool alone = files.size() <= kMostSyncedAlone;
  std::set<std::filesystem::path> folders;
  std::set<dev_t> synced;
  for (const std::filesystem::path& file : files) {
    struct stat status {};
    if (alone || stat(file.c_str(), &status) != 0) {
      SyncOne(file, Synced::kContents);
      folders.insert(file.parent_path());
    } else if (synced.insert(status.st_dev).second) {
      SyncOne(file, Synced::kFileSystem);
    }
  }
  for (const std::filesystem::path& folder : folders) SyncOne(folder, Synced::kFolder);
}

CommittedFiles::CommittedFiles(Sync sync) : outer_(committed_files), sync_(sync) {
  committed_files = this;
}

CommittedFiles::~CommittedFiles() { committed_files = outer_; }

}  // namespace raylift
