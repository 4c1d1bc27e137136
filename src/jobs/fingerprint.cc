#include "jobs/fingerprint.h"

#include <algorithm>
#include <fstream>
#include <vector>

#include "base/hash.h"
#include "base/index_sets.h"
#include "base/input_paths.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"

namespace raylift {
namespace {

using std::filesystem::path;

constexpr size_t kPiece = size_t{1} << 20;
constexpr size_t kPieces = 64;

std::string SizeText(const path& file) {
  std::error_code error;
  const auto size = std::filesystem::file_size(file, error);
  return error ? "missing" : std::to_string(size);
}

path Absolute(const path& folder) {
  std::error_code error;
  const path absolute = std::filesystem::weakly_canonical(folder, error);
  return error ? folder : absolute;
}

}  // namespace

std::string FileFingerprint(const path& file) {
  std::error_code error;
  const auto size = std::filesystem::file_size(file, error);
  std::ifstream stream(file, std::ios::binary);
  if (error || !stream) return "missing";
  uint64_t hash = HashBytes64(std::to_string(size));
  std::string piece(kPiece, '\0');
  for (const size_t i : EvenlySpaced((size + kPiece - 1) / kPiece, kPieces)) {
    stream.clear();
    stream.seekg(static_cast<std::streamoff>(i * kPiece));
    stream.read(piece.data(), static_cast<std::streamsize>(kPiece));
    if (stream.bad()) throw InputError(file, "cannot be read to its end");
    hash = HashBytes64({piece.data(), static_cast<size_t>(stream.gcount())}, hash);
  }
  return fmt::format("{} {}", size, HexText(hash));
}

std::string SizesFingerprint(const path& folder, std::span<const std::string> names) {
  std::string text;
  for (const std::string& name : names) text += name + ' ' + SizeText(folder / name) + '\n';
  return fmt::format("{} {}", names.size(), HexText(HashBytes64(text)));
}

std::string FolderFingerprint(const path& folder, const path& except) {
  std::vector<std::string> names;
  const path from = Absolute(folder);
  const path not_from = Absolute(except);
  if (!IsFolder(from)) return FileFingerprint(from);
  for (const path& file : ListFilesBelow(from)) {
    if (!Below(file, not_from)) names.push_back(file.lexically_relative(from).string());
  }
  std::sort(names.begin(), names.end());
  return SizesFingerprint(from, names);
}

}  // namespace raylift
