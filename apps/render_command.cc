// raylift render: a mesh and cameras in, depth maps and other pictures out.

#include <algorithm>
#include <cstdio>
#include <memory>
#include <optional>

#include "base/progress.h"
#include "commands.h"
#include "interrupt.h"
#include "render_options.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <unistd.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/comparison/geometry_report.h"
#include "raylift/datasets/dataset.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/view_list.h"
#include "raylift/lifting/mesh_spec.h"
#include "raylift/views/mesh_scene.h"
#include "raylift/views/render_job.h"
#include "raylift/views/task_list.h"

namespace raylift {
namespace {

// What is going on before the first image, on stderr where that is a terminal.
class Steps {
 public:
  explicit Steps(bool quiet) : visible_(!quiet && isatty(STDERR_FILENO) != 0) {}
  ~Steps() {
    if (visible_) std::fputs("\r\033[K", stderr);
  }
  Steps(const Steps&) = delete;
  Steps& operator=(const Steps&) = delete;

  void Show(const std::string& step) const {
    if (visible_) std::fputs(fmt::format("\r{}\033[K", step).c_str(), stderr);
  }

 private:
  bool visible_;
};

void PrintJsonLine(const RenderedImage& image) {
  auto json = nlohmann::ordered_json::parse(ToJsonLine(image.entry));
  json.erase("key");
  json["coverage"] = image.entry.Coverage();
  json["render_ms"] = 1e3 * image.render_s;
  json["write_ms"] = 1e3 * image.write_s;
  json["rays"] = image.rays;
  fmt::print("{}\n", json.dump());
  std::fflush(stdout);
}

std::vector<View> ReadCameras(const RenderFlags& flags, std::vector<std::string>& warnings) {
  if (!flags.model.empty()) return ReadModelViews(flags.model, warnings);
  if (flags.cameras.extension() != ".json") return ReadViewList(flags.cameras);
  std::vector<View> views;
  for (const PosedImage& image : ReadTransforms(flags.cameras, warnings)) {
    views.push_back({image.name, image.camera, image.cam_from_world});
  }
  return views;
}

class RenderRun {
 public:
  RenderRun(const RenderFlags& flags, RenderJobOptions options)
      : flags_(flags), options_(std::move(options)) {
    std::vector<View> views = ReadCameras(flags, warnings_);
    if (const auto warning = StretchWarning(views, flags.selection)) {
      warnings_.push_back("--size: " + *warning);
    }
    tasks_ = SelectTasks(std::move(views), flags.selection);
    RefuseIdsOfPoints();
    if (!flags.report.empty()) RequireWritable(flags.report / "index.html");
    const Steps steps(flags.run.quiet);
    scene_ = LoadMeshScene(flags.geometry,
                           {.threads = flags.run.threads,
                            .on_step = [&steps](const std::string& s) { steps.Show(s); }});
    options_.frame.color_options.shading = ResolveShading(flags, *scene_.caster);
  }

  void Run() {
    warnings_.insert(warnings_.end(), scene_.warnings.begin(), scene_.warnings.end());
    PrintWarnings(warnings_);
    const size_t total = tasks_.size();
    RenderSummary summary;
    {
      const SignalGuard signals;
      std::optional<Progress> progress;
      const RenderHooks hooks{.on_start =
                                  [&](size_t images, size_t rays) {
                                    WriteModel();
                                    progress.emplace("images", images, flags_.run.Show());
                                    progress->CountAlso("Mrays", 1e-6 * static_cast<double>(rays));
                                  },
                              .on_image =
                                  [&](const RenderedImage& image) {
                                    if (flags_.log_json) PrintJsonLine(image);
                                    progress->Advance(1e-6 * static_cast<double>(image.rays));
                                  },
                              .stop = &SignalGuard::stop()};
      summary = RunRenderJob(scene_.caster, tasks_, options_, hooks);
    }
    if (!flags_.run.quiet && !flags_.log_json) Print(summary, total);
    if (summary.dropped > 0) {
      PrintWarning(fmt::format("{} values are stored as \"none\", as their format cannot hold them",
                               summary.dropped));
    }
    PrintWarnings(summary.warnings);
    if (!summary.foreign_files.empty()) {
      PrintWarning(fmt::format("{} files of a former run stay in {} and are not of this one: {}{}",
                               summary.foreign_files.size(), options_.out.string(),
                               summary.foreign_files.front(),
                               summary.foreign_files.size() > 1 ? ", ..." : ""));
    }
    if (!flags_.report.empty()) WriteReport(summary);
    if (summary.left > 0) {
      throw Interrupted(
          fmt::format("stopped by a signal with {} images left; --resume goes on", summary.left));
    }
  }

 private:
  void RefuseIdsOfPoints() const {
    const auto points = std::find_if(
        flags_.geometry.begin(), flags_.geometry.end(),
        [](const std::string& spec) { return SurfaceKindOf(spec) != SurfaceKind::kMesh; });
    const auto ids = std::find_if(options_.products.begin(), options_.products.end(),
                                  [](const ProductOutput& output) { return IsId(output.product); });
    if (points == flags_.geometry.end() || ids == options_.products.end()) return;
    throw OptionError("--geometry", *points,
                      fmt::format("a {} has no map of {}s: a mesh is needed",
                                  ToString(SurfaceKindOf(*points)), ToString(ids->product)));
  }

  std::string DescribeScene() const {
    if (const Surfels* surfels = scene_.caster->surfels()) {
      return fmt::format("point cloud: {} points", surfels->discs.size());
    }
    if (const Splats* splats = scene_.caster->splats()) {
      return fmt::format("splats: {} Gaussian{}", splats->means.size(),
                         splats->means.size() == 1 ? "" : "s");
    }
    const TriangleMesh& mesh = scene_.caster->mesh();
    return fmt::format("mesh: {} triangles, {} vertices", mesh.triangles.size(),
                       mesh.vertices.size());
  }

  void Print(const RenderSummary& summary, size_t total) const {
    constexpr double kMega = 1e6;
    fmt::print("{}; {:.1f} MB and {:.1f} MB to trace; read in {:.2f} s, built in {:.2f} s\n",
               DescribeScene(), static_cast<double>(scene_.mesh_bytes) / kMega,
               static_cast<double>(scene_.tree_bytes) / kMega, scene_.read_s, scene_.build_s);
    if (!options_.shard.IsAll()) {
      fmt::print("shard {}/{} of {} images{}\n", options_.shard.index, options_.shard.count, total,
                 summary.complete ? ": all shards are complete" : "");
    }
    const double seconds = std::max(summary.seconds, 1e-9);
    fmt::print("images: {} ({} rendered, {} kept{}); {:.1f} s, {:.1f} images/s, {:.1f} Mrays/s\n",
               summary.images, summary.rendered, summary.kept,
               summary.left > 0 ? fmt::format(", {} left", summary.left) : "", summary.seconds,
               static_cast<double>(summary.rendered) / seconds,
               static_cast<double>(summary.rays) / kMega / seconds);
    fmt::print("coverage: {:.1f} % of the pixels; depth {}; {:.1f} MB in {}\n",
               100 * summary.coverage,
               summary.depth_range ? fmt::format("{:.4g} to {:.4g}", summary.depth_range->first,
                                                 summary.depth_range->second)
                                   : "none",
               static_cast<double>(summary.bytes) / kMega, options_.out.string());
  }

  // Images of another size need cameras of their own.
  void WriteModel() const {
    if (!flags_.selection.size && !flags_.selection.scale) return;
    if (const auto model = ModelOf(tasks_)) {
      WriteColmapModel(options_.out / "model", *model, ColmapForm::kText);
    }
  }

  // Of the images of this shard that are complete.
  void WriteReport(const RenderSummary& summary) const {
    std::vector<RenderedView> images;
    for (const RenderTask& task : tasks_) {
      const auto found = summary.entries.find(task.view.name);
      if (found == summary.entries.end()) continue;
      const ManifestEntry& entry = found->second;
      images.push_back({task.view, entry.Coverage(), entry.depth_range});
      for (const ManifestEntry::File& file : entry.files) images.back().bytes += file.bytes;
    }
    std::vector<std::string> warnings = warnings_;
    warnings.insert(warnings.end(), summary.warnings.begin(), summary.warnings.end());
    WriteFile(flags_.report / "index.html",
              FormatRenderReport(
                  {.title = "Raylift: " + options_.out.string(),
                   .subtitle = fmt::format("{} of {} images; {}; {:.1f} % of the pixels covered",
                                           images.size(), tasks_.size(), DescribeScene(),
                                           100 * summary.coverage),
                   .scene = scene_.caster,
                   .colors = options_.frame.color_options,
                   .images = images,
                   .warnings = warnings,
                   .threads = flags_.run.threads}));
  }

  const RenderFlags& flags_;
  RenderJobOptions options_;
  std::vector<RenderTask> tasks_;
  MeshScene scene_;
  std::vector<std::string> warnings_;
};

}  // namespace

Command AddRenderCommand(CLI::App& program) {
  auto flags = std::make_shared<RenderFlags>();
  CLI::App* command = program.add_subcommand(
      "render", "Depth maps, normals, color, ids of a mesh for all images of a data set");
  AddRenderOptions(*command, *flags);
  command->footer(
      "SIGINT and SIGTERM finish the images in hand; the exit code then is 4, and 5 where a file\n"
      "cannot be written, as on a full disk: --resume goes on.\n"
      "Examples:\n"
      "  raylift render --geometry mesh:scene.ply --model sfm --out rendered --resume --preview\n"
      "  raylift render --geometry mesh:scene.ply --model sfm --out dense/stereo/depth_maps \\\n"
      "      --format bin --pattern {name}.geometric\n"
      "  raylift render --geometry mesh:tiles --model sfm --out rendered --shard auto \\\n"
      "      --products depth,normals,color --format normals=npy --format color=jpg --scale 0.5");
  return {command, [flags, command] {
            CheckRenderFlags(*flags);
            flags->job.command = CommandLine(*command);
            RenderRun(*flags, ResolveJob(*flags)).Run();
          }};
}

}  // namespace raylift
