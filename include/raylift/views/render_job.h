// Renders all views of a scene to files: in parallel, again only what is missing, and so that a
// killed run, or several machines, leave the same files as one run that was left alone.

#pragma once

#include <atomic>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "raylift/jobs/shard.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/photographs.h"
#include "raylift/views/manifest.h"
#include "raylift/views/product.h"

namespace raylift {

struct RenderTask {
  View view;
  // OUT/PRODUCT/stem.FORMAT are the files; a relative path that stays below the folder.
  std::string stem;
};

struct RenderJobOptions {
  std::filesystem::path out;
  std::vector<ProductOutput> products;  // at least one, none twice
  FrameOptions frame = {};              // the maps are asked for by the products
  StorageOptions storage = {};
  int threads = 0;
  bool resume = false;  // keep the files of a former run that are complete and not stale
  // Render all again where there was a former run. With neither of the two its folder is refused.
  bool overwrite = false;
  Shard shard = {};
  // Where another run writes to the folder, wait until it has ended.
  bool wait = false;
  bool preview = false;  // also make OUT/preview.png
  // What was called, for summary.json, which then tells the times of the run as well. Empty: neither.
  std::string command = {};
};

// What a run says of each image that it has rendered.
struct RenderedImage {
  const ManifestEntry& entry;
  double render_s;
  double write_s;
  size_t rays;
};

struct RenderHooks {
  // Before the first image: how many are to render, and how many rays that takes.
  std::function<void(size_t images, size_t rays)> on_start = {};
  // From any thread, one call at a time.
  std::function<void(const RenderedImage&)> on_image = {};
  // Set from outside: no further image is begun.
  const std::atomic<bool>* stop = nullptr;
};

struct RenderSummary {
  size_t images = 0;  // that are complete, of this shard
  size_t rendered = 0;
  size_t kept = 0;        // of a former run
  size_t left = 0;        // not begun, as the run was stopped
  bool complete = false;  // all images of all shards are there
  // Of a former run, which stay in the folder although this one has nothing to do with them.
  std::vector<std::string> foreign_files = {};
  std::vector<std::string> warnings = {};  // of what there is to see: that it is nothing
  double coverage = 0;                     // share of the pixels that see the mesh
  std::optional<std::pair<float, float>> depth_range = std::nullopt;
  size_t dropped = 0;
  size_t bytes = 0;  // of all files
  size_t rays = 0;   // of the images that were rendered
  double seconds = 0;
  ManifestEntries entries = {};  // of the images that are complete, of this shard
};

// Writes to `options.out`:
//   PRODUCT/...           the files
//   manifest.jsonl        the options, the mesh and then each image; of a shard
//                         manifest.I-of-N.jsonl, until all shards are complete
//   summary.json, preview.png, README.txt (file_guide.h)   when all images are complete
// The bytes depend on neither threads, shards, interruptions nor the order of the tasks, but for what
// summary.json says of the run. Memory is
// that of the scene and of a few frames per thread. InputError naming the file where one cannot be
// written: what is complete stays, and `resume` does the rest. OptionError where a former run has
// left images in the folder and neither `resume` nor `overwrite` says what is to become of them.
RenderSummary RunRenderJob(const std::shared_ptr<const RayCaster>& scene,
                           std::vector<RenderTask> tasks, const RenderJobOptions& options,
                           const RenderHooks& hooks);

}  // namespace raylift
