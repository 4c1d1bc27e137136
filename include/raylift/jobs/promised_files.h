// The files that a job's manifest promises: those that a task has written, and in the end the
// results. Whoever goes on with the job or ends it looks whether they are there.

#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace raylift {

struct PromisedFile {
  std::string path;  // relative to the job's folder
  size_t bytes = 0;
  // As `xxhsum -H3` writes it. Empty: the contents are of one run alone.
  std::string xxh3 = {};
};

struct FileFault {
  std::string file;  // relative to the folder
  std::string what;
};

struct Verification {
  size_t tasks = 0;
  size_t files = 0;
  size_t bytes = 0;
  std::vector<FileFault> faults = {};  // in the order of the manifests
};

// Reads all files that the folder's manifests promise and compares sizes and checksums.
Verification VerifyFiles(const std::filesystem::path& out, int threads);

}  // namespace raylift
