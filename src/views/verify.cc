#include "raylift/views/verify.h"

#include <optional>

#include "base/hash.h"
#include <fmt/format.h>

#include "raylift/base/parallel.h"
#include "raylift/jobs/manifest_file.h"
#include "raylift/views/manifest.h"

namespace raylift {
namespace {

std::optional<std::string> FaultOf(const std::filesystem::path& out,
                                   const ManifestEntry::File& file) {
  std::error_code error;
  const auto size = std::filesystem::file_size(out / file.path, error);
  if (error) return "is missing";
  if (size != file.bytes) return fmt::format("has {} bytes, not {}", size, file.bytes);
  if (file.xxh3.empty()) return "has no checksum in the manifest";
  const auto hash = FileHash(out / file.path);
  if (!hash) return "cannot be read";
  if (*hash != file.xxh3) return "has other contents";
  return std::nullopt;
}

}  // namespace

Verification VerifyRenderedFiles(const std::filesystem::path& out, int threads) {
  ManifestEntries entries;
  for (const auto& manifest : ListManifests(out)) entries.merge(ReadManifest(manifest));
  std::vector<const ManifestEntry::File*> files;
  Verification verification{.images = entries.size()};
  for (const auto& [name, entry] : entries) {
    for (const ManifestEntry::File& file : entry.files) {
      files.push_back(&file);
      verification.bytes += file.bytes;
    }
  }
  verification.files = files.size();
  std::vector<std::optional<std::string>> faults(files.size());
  ParallelFor(files.size(), threads, [&](size_t i) { faults[i] = FaultOf(out, *files[i]); });
  for (size_t i = 0; i < files.size(); ++i) {
    if (faults[i]) verification.faults.push_back({files[i]->path, *faults[i]});
  }
  return verification;
}

}  // namespace raylift
