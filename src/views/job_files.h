// Names and contents of the files that a rendering job keeps beside the pictures. Private to
// views.

#pragma once

#include <chrono>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/surfaces/triangle_mesh.h"
#include "raylift/views/render_job.h"

namespace raylift {

// JSON of all that the bytes of the files depend on, but for the views.
std::string JobHeader(const RayCaster& scene, const RenderJobOptions& options);

// The first line of its manifest: that of which job, of how many images.
std::string ManifestHeader(const std::string& header, size_t images);

// Of everything that a view's files depend on.
std::string TaskKey(const std::string& header, const RenderTask& task);

// "PRODUCT/stem.FORMAT" of each product.
std::vector<std::string> TaskFiles(const RenderTask& task, std::span<const ProductOutput> products);

// Removes what a killed run has left of these files: half-written ones under temporary names.
void RemoveLeftovers(const std::filesystem::path& out, std::span<const std::string> files);

// The run that has completed a job.
struct RunRecord {
  std::string command;
  std::chrono::system_clock::time_point started;
  double seconds = 0;
  size_t rendered = 0;
  size_t kept = 0;
};

// summary.json of a complete job.
std::string SummaryJson(const std::string& header, const ManifestEntries& entries,
                        const std::vector<std::string>& warnings,
                        const std::optional<RunRecord>& run);

}  // namespace raylift
