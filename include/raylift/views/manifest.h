// What is done of a rendering job: a line of JSON for each image, added the moment its files are
// complete, so that a killed run can go on where it was.

#pragma once

#include <cstddef>
#include <filesystem>
#include <map>
#include <mutex>
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

// The first line, which WriteManifest calls the header; empty where there is none.
std::string ReadManifestHeader(const std::filesystem::path& path);

// The whole file at once: `header`, one line of JSON on the job, then the entries by name.
// InputError naming the file where it cannot be written.
void WriteManifest(const std::filesystem::path& path, const std::string& header,
                   const ManifestEntries& entries);

// Adds lines to a manifest that is there. Thread safe.
class ManifestAppender {
 public:
  explicit ManifestAppender(std::filesystem::path path);
  ~ManifestAppender();
  ManifestAppender(const ManifestAppender&) = delete;
  ManifestAppender& operator=(const ManifestAppender&) = delete;

  void Append(const ManifestEntry& entry);

 private:
  std::filesystem::path path_;
  std::mutex mutex_;
  int descriptor_;
};

// One line of JSON.
std::string ToJsonLine(const ManifestEntry& entry);

}  // namespace raylift
