// Whether the files of a rendering job are still as they were written.

#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace raylift {

struct FileFault {
  std::string file;  // relative to the folder
  std::string what;
};

struct Verification {
  size_t images = 0;
  size_t files = 0;
  size_t bytes = 0;
  std::vector<FileFault> faults = {};  // by the names of the images
};

// Reads all files that the folder's manifests list and compares sizes and checksums.
Verification VerifyRenderedFiles(const std::filesystem::path& out, int threads);

}  // namespace raylift
