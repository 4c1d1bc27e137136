// What the manifest of a rendering job (jobs/manifest_file.h) says of an image whose files are
// complete.

#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace raylift {

struct ManifestEntry {
  std::string name;
  std::string key;  // of everything that the files' bytes depend on
  std::string camera;
  size_t pixels = 0;
  size_t hits = 0;
  std::optional<std::pair<float, float>> depth_range = std::nullopt;  // none: nothing was hit
  size_t dropped = 0;  // values that a format could not hold
  struct File {
    std::string path;  // relative to the output folder
    size_t bytes = 0;
    std::string xxh3 = {};  // FileHash(); empty: a manifest of before there were any
  };
  std::vector<File> files = {};

  double Coverage() const {
    return pixels == 0 ? 0 : static_cast<double>(hits) / static_cast<double>(pixels);
  }
};

using ManifestEntries = std::map<std::string, ManifestEntry>;  // by name

// The entries of a manifest. A last line that was cut off by a crash, and lines that make no sense,
// count as not there; so does a missing file.
ManifestEntries ReadManifest(const std::filesystem::path& path);

// The whole file at once: `header`, one line of JSON on the job, then the entries by name.
// InputError naming the file where it cannot be written.
void WriteManifest(const std::filesystem::path& path, const std::string& header,
                   const ManifestEntries& entries);

// One line of JSON.
std::string ToJsonLine(const ManifestEntry& entry);

}  // namespace raylift
