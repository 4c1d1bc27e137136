#include "raylift/base/file.h"

#include <atomic>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <system_error>

#include <fmt/format.h>
#include <unistd.h>

#include "raylift/base/output_error.h"

namespace raylift {
namespace {

// Beside the target, so that the rename stays on one file system; unique to process and call.
std::filesystem::path TemporaryName(const std::filesystem::path& path) {
  static std::atomic<unsigned> counter{0};
  return path.parent_path() / fmt::format(".{}.{}-{}.tmp{}", path.stem().string(), getpid(),
                                          counter++, path.extension().string());
}

// ".PID-COUNT"
bool IsProcessAndCount(std::string_view text) {
  const size_t hyphen = text.find('-');
  const auto is_number = [](std::string_view digits) {
    return !digits.empty() && digits.find_first_not_of("0123456789") == std::string_view::npos;
  };
  return text.starts_with('.') && hyphen != std::string_view::npos &&
         is_number(text.substr(1, hyphen - 1)) && is_number(text.substr(hyphen + 1));
}

}  // namespace

std::string ReadFile(const std::filesystem::path& path) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status)) {
    throw InputError(path, "no such file");
  }
  if (std::filesystem::is_directory(status)) {
    throw InputError(path, "expected a file, found a folder");
  }
  std::ifstream stream(path, std::ios::binary);
  if (!stream) {
    throw InputError(path, fmt::format("cannot be read: {}", std::strerror(errno)));
  }
  std::string contents;
  const auto size = std::filesystem::file_size(path, error);
  if (!error) {
    contents.reserve(size);
  }
  char buffer[1 << 16];
  while (stream.read(buffer, sizeof(buffer)) || stream.gcount() > 0) {
    contents.append(buffer, static_cast<size_t>(stream.gcount()));
  }
  if (stream.bad()) {
    throw InputError(path, "cannot be read to its end");
  }
  return contents;
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
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored)) {
    throw OutputError(path, "cannot be written: it is a folder");
  }
  const AtomicFile file(path);
  if (!std::ofstream(file.temporary_path(), std::ios::binary)) {
    throw OutputError(path, fmt::format("cannot be written: {}", std::strerror(errno)));
  }
}

std::optional<std::filesystem::path> TargetOfTemporary(const std::filesystem::path& path) {
  // ".STEM.PID-COUNT.tmp.EXTENSION" or, of a target without one, ".STEM.PID-COUNT.tmp".
  std::filesystem::path name = path.filename();
  std::filesystem::path extension;
  if (name.stem().extension() == ".tmp") {
    extension = name.extension();
    name = name.stem();
  }
  if (name.extension() != ".tmp") return std::nullopt;
  name = name.stem();
  if (!IsProcessAndCount(name.extension().string())) return std::nullopt;
  const std::string stem = name.stem().string();
  if (!stem.starts_with('.')) return std::nullopt;
  return path.parent_path() / (stem.substr(1) + extension.string());
}

std::filesystem::path PathBelow(const std::filesystem::path& folder,
                                const std::filesystem::path& name) {
  std::filesystem::path file = folder;
  for (const std::filesystem::path& part : name.relative_path()) {
    if (part != "..") file /= part;
  }
  return file;
}

AtomicFile::AtomicFile(std::filesystem::path path) : path_(std::move(path)) {
  if (path_.has_parent_path()) {
    std::error_code error;
    std::filesystem::create_directories(path_.parent_path(), error);
    if (error) {
      throw OutputError(path_.parent_path(),
                        fmt::format("the folder cannot be made: {}", error.message()));
    }
  }
  temporary_path_ = TemporaryName(path_);
}

AtomicFile::~AtomicFile() {
  if (!committed_) {
    std::error_code ignored;
    std::filesystem::remove(temporary_path_, ignored);
  }
}

void AtomicFile::Commit() {
  std::error_code error;
  std::filesystem::rename(temporary_path_, path_, error);
  if (error) {
    throw OutputError(path_, fmt::format("cannot be written: {}", error.message()));
  }
  committed_ = true;
}

}  // namespace raylift
