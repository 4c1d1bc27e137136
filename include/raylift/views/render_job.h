// Renders all views of a scene to files: in parallel, only those that are missing, and so that a
// killed run, or several machines, leave the same files as one uninterrupted run.

#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "raylift/base/enum_names.h"
#include "raylift/io/depth_file.h"
#include "raylift/jobs/shard.h"
#include "raylift/jobs/task_job.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/scene/photographs.h"
#include "raylift/surfaces/triangle_mesh.h"

namespace raylift {

enum class Product {
  kDepth,         // z along the optical axis; 0 = none
  kDistance,      // along the ray; 0 = none
  kInverseDepth,  // 1 / depth: disparity over baseline and focal length; 0 = none
  kPoints,        // x, y, z of what is seen; NaN = none
  kNormals,       // unit, toward the camera; 0 = none
  kColor,         // RGB
  kTriangle,      // face of the mesh's file, from 0; 4294967295 = none
  kObject,        // which of the meshes, from 0; 4294967295 = none
  kInstance,      // which node, group or city object (SurfaceLabel); likewise
  kSemantic,      // which material or class of a table (SurfaceLabel); likewise
  kIncidence,     // angle between normal and ray, degrees; -1 = none
  kMask,          // 255 where there is a surface
};
template <>
inline constexpr auto kEnumNames<Product> = std::to_array<EnumName<Product>>({
    {Product::kDepth, "depth"},
    {Product::kDistance, "distance"},
    {Product::kInverseDepth, "inverse_depth"},
    {Product::kPoints, "points"},
    {Product::kNormals, "normals"},
    {Product::kColor, "color"},
    {Product::kTriangle, "triangle"},
    {Product::kObject, "object"},
    {Product::kInstance, "instance"},
    {Product::kSemantic, "semantic"},
    {Product::kIncidence, "incidence"},
    {Product::kMask, "mask"},
});

// Returns whether a product has x, y, z per pixel.
constexpr bool IsVector(Product product) {
  return product == Product::kNormals || product == Product::kPoints;
}

// Returns whether a product has integers per pixel.
constexpr bool IsId(Product product) {
  using enum Product;
  return product == kTriangle || product == kObject || product == kInstance || product == kSemantic;
}

// Returns the values of kInverseDepth for a frame with a map of depth.
std::vector<float> InverseDepths(const Frame& frame);

// Returns the values of a product of ids for a frame of this mesh with a map of triangles.
std::vector<uint32_t> IdsOf(Product product, const Frame& frame, const TriangleMesh& mesh);

struct ProductOutput {
  Product product;
  std::string format;  // one of FormatsOf(product); also the files' extension
};

// Returns whether an output holds colors: a picture, or a cloud of points, which has normals as
// well.
inline bool HasColors(const ProductOutput& output) {
  return output.product == Product::kColor || output.format == "ply";
}

// Returns the formats that can hold a product, the default first: of "npy", "exr", "npz", "png",
// "tiff", "bin" (COLMAP), "pfm", "jpg", "ply".
std::span<const std::string_view> FormatsOf(Product product);

// Returns the names of an EXR file's channels, separated by commas.
std::string_view ExrChannels(Product product);

struct StorageOptions {
  DepthWriteOptions floats;  // `format` and `layer` are set for each file
  int jpeg_quality = 92;
};

// Sets the maps that the products need in `options`.
void Request(std::span<const ProductOutput> products, FrameOptions& options);

struct WrittenFile {
  std::filesystem::path file;
  size_t bytes = 0;
  size_t dropped = 0;  // values that the format could not hold
};

// Writes one product of a frame of this mesh. Throws as WriteDepthFile() does; thread safe.
WrittenFile WriteProduct(const std::filesystem::path& file, const ProductOutput& output,
                         const Frame& frame, const TriangleMesh& mesh,
                         const StorageOptions& options);

struct ManifestEntry {
  std::string name;
  size_t place = 0;  // in the list of the job's images
  std::string key;   // of everything that the files' bytes depend on
  std::string camera;
  size_t pixels = 0;
  size_t hits = 0;
  std::optional<std::pair<float, float>> depth_range = std::nullopt;  // nullopt: nothing was hit
  size_t dropped = 0;  // values that a format could not hold
  std::vector<PromisedFile> files = {};

  double Coverage() const {
    return pixels == 0 ? 0 : static_cast<double>(hits) / static_cast<double>(pixels);
  }
};

using ManifestEntries = std::map<std::string, ManifestEntry>;  // by name

// Reads the entries of a manifest. A last line that was cut off by a crash, lines that cannot be
// parsed and a missing file count as absent.
ManifestEntries ReadManifest(const std::filesystem::path& path);

// Returns an entry as one line of JSON.
std::string ToJsonLine(const ManifestEntry& entry);

// The formats of other tools in which the job's cameras are written, beside the products.
enum class CameraFiles {
  kTransforms,  // OUT/transforms.json
  kMvsnet,      // OUT/cams, OUT/pair.txt
};
template <>
inline constexpr auto kEnumNames<CameraFiles> = std::to_array<EnumName<CameraFiles>>({
    {CameraFiles::kTransforms, "transforms", "",
     "nerfstudio's transforms.json, with depth_file_path (npy or png)"},
    {CameraFiles::kMvsnet, "mvsnet", "",
     "cams/00000000_cam.txt, ... by name and pair.txt, for --pattern {index}"},
});

struct RenderTask {
  PosedImage view;
  // The files are OUT/PRODUCT/stem.FORMAT; a relative path that stays below the folder.
  std::string stem;
};

struct RenderJobOptions {
  std::filesystem::path out;
  std::vector<ProductOutput> products;  // at least one, none twice
  FrameOptions frame = {};              // the maps are asked for by the products
  StorageOptions storage = {};
  int threads = 0;
  bool resume = false;  // keep the files of a former run that are complete and not stale
  // Renders all views anew where there was a former run. With neither of the two a folder with a
  // former run is refused.
  bool overwrite = false;
  Shard shard = {};
  // Waits until another run that writes to the folder has ended.
  bool wait = false;
  std::vector<CameraFiles> camera_files = {};
  // The transforms name photographs in this folder or, where it is empty, the color images that are
  // rendered.
  std::filesystem::path photographs = {};
  bool preview = false;  // also make OUT/preview.png
  // The command line, which timing.jsonl holds with the run's times. Where it is empty, no such
  // file is written.
  std::string command = {};
};

// The report of a run on an image that it has rendered.
struct RenderedImage {
  const ManifestEntry& entry;
  double render_s;
  double write_s;
  size_t rays;
};

struct RenderHooks {
  // Is called before the first image with the number of images to render, and of their rays.
  std::function<void(size_t images, size_t rays)> on_start = {};
  // Is called from any thread, one call at a time.
  std::function<void(const RenderedImage&)> on_image = {};
  // Is set from outside to stop: no further image is begun.
  const std::atomic<bool>* stop = nullptr;
};

// The sums over a job's images.
struct JobTotals {
  size_t pixels = 0, hits = 0, dropped = 0, bytes = 0;
  std::optional<std::pair<float, float>> depth_range = std::nullopt;

  // Returns the share of the pixels that see the mesh.
  double Coverage() const {
    return pixels == 0 ? 0 : static_cast<double>(hits) / static_cast<double>(pixels);
  }
};

struct RenderSummary {
  size_t images = 0;  // that are complete, of this shard
  size_t rendered = 0;
  size_t kept = 0;        // of a former run
  size_t left = 0;        // not begun, as the run was stopped
  bool complete = false;  // all images of all shards are there
  // Files of a former run in the folder that do not belong to this one.
  std::vector<std::string> foreign_files = {};
  std::vector<std::string> warnings = {};  // of what there is to see: that it is nothing
  JobTotals totals = {};
  size_t rays = 0;  // of the images that were rendered
  double seconds = 0;
  ManifestEntries entries = {};  // of the images that are complete, of this shard
};

// Writes to `options.out`:
//   PRODUCT/...           the files
//   instance.txt, semantic.txt   what the ids of these products are called (surface_labels.h)
//   manifest.jsonl        the options, the mesh and then each image; of a shard
//                         manifest.I-of-N.jsonl, until all shards are complete
//   summary.json, preview.png, README.txt (file_guide.h)   when all images are complete
// and timing.jsonl, which tells of the run. All other bytes depend on neither threads, shards,
// interruptions nor the order of the tasks. Memory is that of the scene and of a few frames per
// thread. Throws InputError naming the file where one cannot be written: what is complete stays,
// and `resume` does the rest. Throws OptionError where a former run has left images in the folder
// and neither `resume` nor `overwrite` says what is to become of them.
RenderSummary RunRenderJob(const std::shared_ptr<const RayCaster>& scene,
                           std::vector<RenderTask> tasks, const RenderJobOptions& options,
                           const RenderHooks& hooks);

}  // namespace raylift
