#include "surfaces/file_names.h"

#include <algorithm>
#include <cctype>

#include <fmt/format.h>
#include <glob.h>

#include "raylift/base/error.h"
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
                            std::string_view kind) {
  std::error_code ignored;
  if (std::filesystem::is_regular_file(files, ignored)) return {files};
  std::vector<path> listed;
  for (const std::string_view part_view : SplitBy(files, '+')) {
    const std::string part(part_view);
    std::vector<path> of_part = {part};
    if (std::filesystem::is_directory(part, ignored)) {
      of_part = FilesIn(part, extensions, kind);
    } else if (!std::filesystem::exists(part, ignored) &&
               part.find_first_of("*?[") != std::string::npos) {
      of_part = MatchingFiles(part, kind);
    }
    listed.insert(listed.end(), of_part.begin(), of_part.end());
  }
  return listed;
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

std::string Shown(std::string_view token) {
  std::string text(token.substr(0, 40));
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c < ' ' || c > '~'; }, '?');
  return text;
}

}  // namespace raylift
