#include "surfaces/input_files.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstring>

#include "base/input_paths.h"
#include <fmt/format.h>
#include <glob.h>
#include <sys/mman.h>
#include <unistd.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using std::filesystem::path;

std::vector<path> FilesIn(const path& folder, std::span<const std::string_view> extensions,
                          std::string_view kind) {
  std::vector<path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const bool is_one = std::find(extensions.begin(), extensions.end(),
                                  LowerExtension(entry.path())) != extensions.end();
    if (entry.is_regular_file() && is_one) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  if (files.empty()) {
    throw InputError(folder, fmt::format("expected {} files in the folder, found none", kind));
  }
  return files;
}

std::vector<path> MatchingFiles(const std::string& pattern, std::string_view kind) {
  glob_t found{};
  const int status = glob(pattern.c_str(), 0, nullptr, &found);
  std::vector<path> files(found.gl_pathv, found.gl_pathv + found.gl_pathc);
  globfree(&found);
  if (status != 0 || files.empty())
    throw InputError(pattern, fmt::format("no {} file matches", kind));
  return files;
}

}  // namespace

std::vector<path> ListFiles(const std::string& files, std::span<const std::string_view> extensions,
                            std::string_view kind, std::string_view index) {
  if (IsFile(files)) return {files};
  std::vector<path> listed;
  for (const std::string_view part_view : SplitBy(files, '+')) {
    const std::string part(part_view);
    std::vector<path> of_part = {part};
    if (!index.empty() && IsFile(path(part) / index)) {
      of_part = {path(part) / index};
    } else if (IsFolder(part)) {
      of_part = FilesIn(part, extensions, kind);
    } else if (!Exists(part) && part.find_first_of("*?[") != std::string::npos) {
      of_part = MatchingFiles(part, kind);
    }
    listed.insert(listed.end(), of_part.begin(), of_part.end());
  }
  return listed;
}

std::string DecodedUri(std::string_view uri) {
  std::string text;
  for (size_t i = 0; i < uri.size(); ++i) {
    unsigned code = 0;
    const char* const digits = uri.data() + i + 1;
    const bool is_code = uri[i] == '%' && i + 2 < uri.size() &&
                         std::from_chars(digits, digits + 2, code, 16).ptr == digits + 2;
    text += is_code ? static_cast<char>(code) : uri[i] == '\\' ? '/' : uri[i];
    if (is_code) i += 2;
  }
  return text;
}

std::string Shown(std::string_view token) {
  std::string text(token.substr(0, 40));
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c < ' ' || c > '~'; }, '?');
  return text;
}

void ReleaseMapped(std::string_view part) {
  const auto page = static_cast<uintptr_t>(sysconf(_SC_PAGESIZE));
  const auto begin = reinterpret_cast<uintptr_t>(part.data());
  const uintptr_t first = (begin + page - 1) / page * page;  // whole pages only
  const uintptr_t last = (begin + part.size()) / page * page;
  if (last > first) {
    madvise(const_cast<char*>(part.data()) + (first - begin), last - first, MADV_DONTNEED);
  }
}

void AdviseLargePages(void* data, size_t size_bytes) {
#if defined(MADV_HUGEPAGE)
  constexpr size_t kLargePage = size_t{2} << 20;
  const auto begin = reinterpret_cast<uintptr_t>(data);
  const uintptr_t first = (begin + kLargePage - 1) / kLargePage * kLargePage;
  const uintptr_t last = (begin + size_bytes) / kLargePage * kLargePage;
  if (last > first) {
    // Advice may be refused.
    madvise(static_cast<char*>(data) + (first - begin), last - first, MADV_HUGEPAGE);
  }
#else
  static_cast<void>(data);
  static_cast<void>(size_bytes);
#endif
}

}  // namespace raylift
