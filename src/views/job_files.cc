#include "views/job_files.h"

#include <algorithm>
#include <ctime>
#include <set>
#include <unordered_set>

#include "base/hash.h"
#include "base/json_text.h"
#include "base/statistics.h"
#include "io/text/line_tokens.h"
#include "views/surface_labels.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;
using std::filesystem::path;

Json ColorJson(const ColorOptions& options) {
  const Eigen::Vector3d& sun = options.sun_direction_in_world;
  return {{"shading", ToString(options.shading)},
          {"samples_per_pixel_side", options.samples_per_pixel_side},
          {"sun_direction", {sun.x(), sun.y(), sun.z()}},
          {"ambient", options.ambient},
          {"background_rgb", options.background_rgb},
          {"untextured_rgb", options.untextured_rgb}};
}

// Hashes which triangle is called what, and by which ids.
uint64_t LabelHash(const TriangleMesh& mesh) {
  std::string names;
  for (const SurfaceLabel& label : mesh.labels) {
    names += fmt::format("{} {}\n{} {}\n", label.instance, label.instance_name, label.semantic,
                         label.semantic_name);
  }
  return HashBytes64(AsBytes(std::span(mesh.triangle_labels)), HashBytes64(names));
}

Json ProductJson(const ProductOutput& output, const RenderJobOptions& options) {
  const DepthWriteOptions& floats = options.storage.floats;
  Json json = {{"format", output.format}};
  const bool is_float = output.product != Product::kColor && output.product != Product::kMask;
  if (output.format == "exr") {
    json["channels"] = ExrChannels(output.product);
    json["compression"] = ToString(floats.exr_compression);
  }
  if (output.format == "npz") json["deflate"] = floats.deflate_npz;
  if (is_float && !IsId(output.product)) json["sample"] = ToString(floats.sample);
  if (is_float && output.format == "png") {
    if (!IsId(output.product)) json["step"] = floats.png_step;
    json["png_compression"] = floats.png_compression;
  }
  if (is_float) json["out_of_range"] = ToString(floats.out_of_range);
  if (output.format == "jpg") json["quality"] = options.storage.jpeg_quality;
  if (HasColors(output)) json["color"] = ColorJson(options.frame.color_options);
  if (IsVector(output.product)) json["in"] = ToString(options.frame.normals_in);
  return json;
}

// Returns a time as 2026-01-31T23:59:59Z.
std::string UtcText(std::chrono::system_clock::time_point time) {
  const std::time_t seconds = std::chrono::system_clock::to_time_t(time);
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  char text[32];
  return {text, std::strftime(text, sizeof(text), "%Y-%m-%dT%H:%M:%SZ", &utc)};
}

using Box = Eigen::AlignedBox3d;

std::string Text(const Box& box) {
  const Eigen::Vector3d& low = box.min();
  const Eigen::Vector3d& high = box.max();
  return fmt::format("({:.4g}, {:.4g}, {:.4g}) to ({:.4g}, {:.4g}, {:.4g})", low.x(), low.y(),
                     low.z(), high.x(), high.y(), high.z());
}

Box BoxOf(const RayCaster& scene) {
  Box box;
  if (const Surfels* surfels = scene.surfels()) {
    for (const Eigen::Vector4f& disc : surfels->discs) {
      box.extend(surfels->origin_in_world + disc.head<3>().cast<double>());
    }
    return box;
  }
  if (const Splats* splats = scene.splats()) {
    for (const Eigen::Vector3f& mean : splats->means) {
      box.extend(splats->origin_in_world + mean.cast<double>());
    }
    return box;
  }
  const TriangleMesh& mesh = scene.mesh();
  for (uint32_t i = 0; i < mesh.vertices.size(); ++i) box.extend(mesh.VertexInWorld(i));
  return box;
}

// Returns whether the cameras stand in the mesh's box or no further from it than it is large.
bool AreNear(const Box& cameras, const Box& mesh) {
  return cameras.exteriorDistance(mesh) <= mesh.diagonal().norm();
}

std::string Reason(const Box& cameras, const Box& mesh) {
  if (AreNear(cameras, mesh)) {
    return "they look elsewhere: are the axes turned (axes=), or the poses inverted?";
  }
  for (const double factor : {1000.0, 100.0, 10.0}) {
    for (const double scale : {factor, 1 / factor}) {
      const Box scaled(scale * mesh.min(), scale * mesh.max());
      if (AreNear(cameras, scaled) && cameras.diagonal().norm() <= 10 * scaled.diagonal().norm()) {
        return fmt::format("is it in another unit (with scale={:g} they would meet)?", scale);
      }
    }
  }
  return "is it in another frame (scale=, axes=, shift=)?";
}

}  // namespace

std::string JobHeader(const RayCaster& scene, const RenderJobOptions& options) {
  Json json = {{"raylift_version", RAYLIFT_VERSION}};
  const std::string hash = HexText(SurfaceHash(scene, options.threads));
  if (const Surfels* surfels = scene.surfels()) {
    json["cloud"] = {{"points", surfels->discs.size()}, {"hash", hash}};
  } else if (const Splats* splats = scene.splats()) {
    json["splats"] = {{"gaussians", splats->means.size()}, {"hash", hash}};
  } else {
    const TriangleMesh& mesh = scene.mesh();
    json["mesh"] = {
        {"vertices", mesh.vertices.size()}, {"triangles", mesh.triangles.size()}, {"hash", hash}};
  }
  Json products = Json::object();
  for (const ProductOutput& output : options.products) {
    products[std::string(ToString(output.product))] = ProductJson(output, options);
  }
  json["products"] = std::move(products);
  const bool any_labels =
      std::any_of(options.products.begin(), options.products.end(),
                  [](const ProductOutput& output) { return HasNames(output.product); });
  if (any_labels) json["labels"] = HexText(LabelHash(scene.mesh()));
  return json.dump();
}

std::string ManifestHeader(const std::string& header, size_t images) {
  const Json line = {{"command", "render"}, {"tasks", images}, {"job", Json::parse(header)}};
  return line.dump();
}

std::string TaskKey(const std::string& header, const RenderTask& task) {
  return HexText(
      HashBytes64(fmt::format("{}\n{}\n{}\n{} {}", header, task.view.name, task.stem,
                              task.view.camera.ToString(), FormatPose(task.view.cam_from_world))));
}

std::string TaskFile(const RenderTask& task, const ProductOutput& output) {
  return fmt::format("{}/{}.{}", ToString(output.product), task.stem, output.format);
}

std::vector<std::string> TaskFiles(const RenderTask& task,
                                   std::span<const ProductOutput> products) {
  std::vector<std::string> files;
  for (const ProductOutput& output : products) files.push_back(TaskFile(task, output));
  return files;
}

void RemoveLeftovers(const path& out, std::span<const std::string> files) {
  std::set<path> folders;
  std::unordered_set<std::string> ours;
  for (const std::string& file : files) {
    const path target = out / file;
    folders.insert(target.parent_path());
    ours.insert(target.string());
  }
  for (const path& folder : folders) {
    std::error_code error;
    std::vector<path> leftovers;
    for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
      const auto target = TargetOfTemporary(entry.path());
      if (target && ours.contains(target->string())) leftovers.push_back(entry.path());
    }
    for (const path& leftover : leftovers) std::filesystem::remove(leftover, error);
  }
}

JobTotals TotalsOf(const ManifestEntries& entries) {
  JobTotals totals;
  for (const auto& [name, entry] : entries) {
    totals.pixels += entry.pixels;
    totals.hits += entry.hits;
    totals.dropped += entry.dropped;
    for (const PromisedFile& file : entry.files) totals.bytes += file.bytes;
    if (!entry.depth_range) continue;
    auto& range = totals.depth_range;
    const auto [low, high] = *entry.depth_range;
    range = range ? std::pair(std::min(range->first, low), std::max(range->second, high))
                  : std::pair(low, high);
  }
  return totals;
}

std::string SummaryJson(const std::string& header, const ManifestEntries& entries,
                        const std::vector<std::string>& warnings) {
  const JobTotals totals = TotalsOf(entries);
  Json empty = Json::array();
  double least_coverage = 1;
  for (const auto& [name, entry] : entries) {
    least_coverage = std::min(least_coverage, entry.Coverage());
    if (entry.hits == 0) empty.push_back(name);
  }
  Json json = {{"images", entries.size()},
               {"pixels", totals.pixels},
               {"coverage", totals.Coverage()},
               {"least_coverage", entries.empty() ? 0 : least_coverage},
               {"images_without_surface", std::move(empty)},
               {"depth_range", nullptr},
               {"dropped_values", totals.dropped},
               {"bytes", totals.bytes},
               {"warnings", warnings},
               {"job", Json::parse(header)}};
  if (const auto& range = totals.depth_range) json["depth_range"] = {range->first, range->second};
  return JsonText(json, 2) + '\n';
}

std::string TimingJson(const RunRecord& run) {
  return JsonText(Json{{"command", run.command},
                       {"started", UtcText(run.started)},
                       {"seconds", run.seconds},
                       {"rendered", run.rendered},
                       {"kept", run.kept}}) +
         '\n';
}

std::string WhyTheMeshIsUnseen(const RayCaster& scene,
                               const std::vector<Eigen::Vector3d>& camera_centers) {
  RAYLIFT_CHECK(!camera_centers.empty());
  const Box mesh_box = BoxOf(scene);
  Box camera_box;
  for (const Eigen::Vector3d& center : camera_centers) camera_box.extend(center);
  return fmt::format("none of {} images sees the {}, which is at {}; the cameras are at {}: {}",
                     camera_centers.size(), ToString(scene.kind()), Text(mesh_box),
                     Text(camera_box), Reason(camera_box, mesh_box));
}

std::optional<std::string> AskForUnit(const std::vector<Eigen::Vector3d>& camera_centers,
                                      std::vector<double> farthest) {
  constexpr size_t kFewest = 10;  // fewer may be a rig
  constexpr double kLargestRatio = 100;
  constexpr double kOneSpot = 1e-5;  // of the depth: a camera that turns tells nothing
  Box box;
  for (const Eigen::Vector3d& center : camera_centers) box.extend(center);
  const double spread = box.isEmpty() ? 0 : box.diagonal().norm();
  if (farthest.size() < kFewest) return std::nullopt;
  const double depth = QuantileInPlace(std::span(farthest), 0.75);
  if (depth <= kLargestRatio * spread || spread <= kOneSpot * depth) return std::nullopt;
  return fmt::format(
      "images show surfaces {:.3g} units away, and their cameras stand within {:.3g}: unless that "
      "is far terrain or a sky, is the scene in another unit than the cameras (scale=0.001)?",
      depth, spread);
}

}  // namespace raylift
