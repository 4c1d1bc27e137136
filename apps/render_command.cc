// raylift render: renders depth maps and other pictures of a mesh from given cameras.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/argument_files.h"
#include "apps/command_line.h"
#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/job_options.h"
#include "apps/options.h"
#include "base/progress.h"
#include "lifting/mesh_spec.h"
#include "views/job_files.h"
#include "views/mesh_scene.h"
#include "views/task_list.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <unistd.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/datasets/dataset.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/query_list.h"
#include "raylift/report/geometry_report.h"
#include "raylift/scene/photographs.h"
#include "raylift/views/render_job.h"

namespace raylift {
namespace {

struct RenderFlags {
  std::vector<std::string> geometry;
  std::filesystem::path model, cameras, semantics;
  TaskSelection selection;
  RenderJobOptions job;  // all but what follows
  std::vector<Product> products = {Product::kDepth};
  std::vector<std::string> formats;
  std::optional<ColorOptions::Shading> shading;  // nullopt: by whether the mesh has colors
  JobFlags running;
  bool log_json = false;
  std::filesystem::path report;
  RunFlags run;
};

std::string FormatNames(Product product) {
  return fmt::format("{}", fmt::join(FormatsOf(product), "|"));
}

// Sets a format: "npy" of all products that can be stored so, "depth=npy" of one.
void SetFormat(const std::string& text, std::vector<ProductOutput>& outputs) {
  const auto parts = SplitBy(text, '=');
  const bool for_one = parts.size() == 2;
  const std::string format(parts.back());
  bool used = false;
  for (ProductOutput& output : outputs) {
    if (for_one && output.product != ParseEnum<Product>("--format", parts.front())) {
      continue;
    }
    const auto known = FormatsOf(output.product);
    if (std::find(known.begin(), known.end(), format) != known.end()) {
      output.format = format;
      used = true;
    } else if (for_one) {
      throw OptionError("--format", text, fmt::format("expected {}", FormatNames(output.product)));
    }
  }
  if (!used) {
    throw OptionError("--format", text, "none of the --products is stored in this format");
  }
}

std::vector<Product> ParseProducts(std::string_view option, const std::string& text) {
  std::vector<Product> products;
  for (const std::string_view name : SplitBy(text, ',')) {
    const auto product = ParseEnum<Product>(option, name);
    if (std::find(products.begin(), products.end(), product) != products.end()) {
      throw OptionError(option, text, "a product stands twice");
    }
    products.push_back(product);
  }
  return products;
}

std::vector<ProductOutput> ResolveProducts(const RenderFlags& flags) {
  std::vector<ProductOutput> outputs;
  for (const Product product : flags.products) {
    outputs.push_back({product, std::string(FormatsOf(product).front())});
  }
  for (const std::string& text : flags.formats) SetFormat(text, outputs);
  return outputs;
}

void CheckStorage(const StorageOptions& storage) {
  if (!(storage.floats.png_step > 0)) {
    throw OptionError("--png-step", FormatDouble(storage.floats.png_step), "must be positive");
  }
  if (storage.jpeg_quality < 1 || storage.jpeg_quality > 100) {
    throw OptionError("--jpeg-quality", std::to_string(storage.jpeg_quality), "must be 1 to 100");
  }
}

void CheckSelection(const TaskSelection& selection) {
  CheckSubsampling(selection.subsampling);
  if (selection.scale.has_value() + selection.size.has_value() + selection.panorama.has_value() +
          selection.cubemap.has_value() >
      1) {
    throw OptionError("give at most one of --scale, --size, --panorama and --cubemap");
  }
}

std::array<uint8_t, 3> ParseRgb(std::string_view option, const std::string& text) {
  const auto parts = SplitBy(text, ',');
  std::array<uint8_t, 3> rgb{};
  bool good = parts.size() == 3;
  for (size_t i = 0; good && i < 3; ++i) {
    const auto value = ParseInt(parts[i]);
    good = value && *value >= 0 && *value <= 255;
    if (good) rgb[i] = static_cast<uint8_t>(*value);
  }
  if (!good) throw OptionError(option, text, "expected RED,GREEN,BLUE of 0 to 255");
  return rgb;
}

void AddInputOptions(CLI::App& command, RenderFlags& flags) {
  TaskSelection& selection = flags.selection;
  const OptionGroup scene(command, "Scene");
  scene
      .Add("--geometry", flags.geometry,
           "mesh:PATH[,build=low|medium]: PLY, OBJ, glTF, STL, ..., 3D Tiles\n"
           "(DIR/tileset.json); a.ply+b.ply, tiles/*.ply or a folder, and several\n"
           "--geometry, are one scene; the acceleration structure is built in medium\n"
           "quality by default; or\n"
           "dsm:FILE[,ortho=FILE], a surface model, cloud:PATH[,key=value...], a point\n"
           "cloud, or splat:FILE[,key=value...], Gaussian splats, as localize takes them")
      .Required()
      .OnePerUse();
  scene.Add("--model", flags.model, "Cameras: COLMAP model folder, text or binary");
  scene.Add("--cameras", flags.cameras,
            "Cameras: list of name qw qx qy qz tx ty tz MODEL width height params...;\n"
            "MODEL is one of COLMAP's or EQUIRECTANGULAR (without parameters); or a\n"
            "transforms.json of nerfstudio or instant-ngp");
  scene.Add("--list-images", selection.list, "Only the images in this list");
  scene.Add("--glob", selection.glob, "Only images whose name matches, as in a shell");
  AddSubsamplingOptions(scene, selection.subsampling, "of these (by name)");
  scene.AddParsed("--scale", selection.scale, &ParsePositive,
                  "Factor of the images' sides; OUT/model then has their cameras");
  scene.AddParsed("--size", selection.size, &ParseSize, "WIDTHxHEIGHT of all images; likewise");
  scene.AddParsed("--panorama", selection.panorama, &ParseSize,
                  "WIDTHxHEIGHT: an equirectangular panorama from each camera's place");
  scene.AddParsed(
      "--cubemap", selection.cubemap, &ParseSide,
      "SIDE in pixels: six pinholes of 90 degrees from each camera's place,\n"
      "NAME/front (with the camera's axes), right, back, left (turned about its y), up\n"
      "and down (up's lower edge and down's upper one are front's); likewise");
}

void AddProductOptions(CLI::App& command, RenderFlags& flags) {
  const OptionGroup group(command, "Products");
  std::string formats;
  for (const Product product : AllValues<Product>()) {
    formats += fmt::format("\n  {}: {}", ToString(product), FormatNames(product));
  }
  group.AddParsed(
      "--products", flags.products, &ParseProducts,
      "Of depth (z), distance (along the ray), inverse_depth (1 / z), points (x, y, z),\n"
      "normals, color, triangle (the face of the mesh's file), object (which mesh of\n"
      "several), instance (which node, group or city object), semantic (which material,\n"
      "kind of surface or class of --semantics), incidence (degrees), mask; separated by\n"
      "commas",
      "depth");
  group
      .Add("--format", flags.formats,
           "FORMAT or PRODUCT=FORMAT, repeatable; the first is the default:" + formats)
      .OnePerUse();
  group.Add("--semantics", flags.semantics,
            "Table of ID PATTERN for the product semantic: what materials, nodes, groups or\n"
            "city objects with such names are (* and ? as in a shell; the first line that\n"
            "fits); instance.txt and semantic.txt in OUT say which names there are");
  DepthWriteOptions& floats = flags.job.storage.floats;
  group.Add("--exr-compression", floats.exr_compression, "{}; pxr24 keeps 24 of 32 bits");
  group.Add("--sample", floats.sample, "{}, of NPY, EXR and NPZ");
  group.Add("--png-step", floats.png_step, "Scene units per count of a 16-bit PNG");
  group.Add("--out-of-range", floats.out_of_range,
            "{}: what to do with depth that a PNG or half cannot hold");
  group.Flag("--deflate-npz", floats.deflate_npz, "Smaller NPZ files, written slower");
  group.Add("--jpeg-quality", flags.job.storage.jpeg_quality, "1 to 100");
  FrameOptions& frame = flags.job.frame;
  group.Add("--normals-in", frame.normals_in, "{}, of normals and points");
  group.Add("--shading", NamedValue(flags.shading, "auto"),
            "{} (headlight where the mesh has no colors)");
  group.Add("--supersampling", frame.color_options.samples_per_pixel_side,
            "N: each pixel's color is the mean of N x N samples");
  group.AddParsed("--background", frame.color_options.background_rgb, &ParseRgb,
                  "RED,GREEN,BLUE where there is no surface", "0,0,0");
}

void AddOutputOptions(CLI::App& command, RenderFlags& flags) {
  const OptionGroup output(command, "Output");
  output
      .Add("--out", flags.job.out,
           "Folder for PRODUCT/NAME.FORMAT, manifest.jsonl and summary.json")
      .Required();
  output.Add("--pattern", flags.selection.pattern,
             "Names of the files without extension: {name}, {dir}, {stem}, {base} of the\n"
             "image, or {index}, its place by name; {name}.geometric for COLMAP, "
             "{dir}/{base}_depth for MeshLoc");
  output.AddList("--camera-files", flags.job.camera_files,
                 "Also the cameras for other tools: list of {}\n" + Descriptions<CameraFiles>());
  output.Add("--photographs", flags.job.photographs,
             "Of transforms: folder of the photographs (default: the product color)");
  output.Add("--report", flags.report,
             "Folder for one HTML page to look at (index.html): images, pictures, 3D view");
  output.Flag("--preview", flags.job.preview, "Also write preview.png, a sheet of small depths");
  output.Flag("--log-json", flags.log_json,
              "A line of JSON on stdout for each image, and no table");
  AddJobOptions(command, flags.running, "Keep what the manifest says to be complete and not stale",
                "Render all again in a folder where a former run was; else it is refused");
}

void AddRenderOptions(CLI::App& command, RenderFlags& flags) {
  AddSceneOption(command);
  AddInputOptions(command, flags);
  AddProductOptions(command, flags);
  AddOutputOptions(command, flags);
  OptionGroup(command, "Output")
      .Print(
          "--help-files", &FileGuide,
          "Print what the files of each product hold and exit; README.txt beside them says so too")
      .NotConfigurable();
  AddRunOptions(command, flags.run);
}

void CheckRenderFlags(const RenderFlags& flags) {
  flags.run.Check();
  if (flags.model.empty() == flags.cameras.empty()) {
    throw OptionError("give either --model or --cameras");
  }
  flags.running.Check();
  CheckSelection(flags.selection);
  const TaskSelection& selection = flags.selection;
  if (!flags.job.photographs.empty() && (selection.scale || selection.size || selection.cubemap)) {
    throw OptionError("--photographs are not those of --scale, --size or --cubemap");
  }
  const auto& products = flags.products;
  if (!flags.semantics.empty() &&
      std::find(products.begin(), products.end(), Product::kSemantic) == products.end()) {
    throw OptionError("--semantics", flags.semantics.string(), "needs the product semantic");
  }
  CheckStorage(flags.job.storage);
  const int supersampling = flags.job.frame.color_options.samples_per_pixel_side;
  if (supersampling < 1 || supersampling > 16) {
    throw OptionError("--supersampling", std::to_string(supersampling), "must be 1 to 16");
  }
}

RenderJobOptions ResolveJob(const RenderFlags& flags) {
  RenderJobOptions job = flags.job;
  job.products = ResolveProducts(flags);
  job.threads = flags.run.threads;
  job.resume = flags.running.resume;
  job.overwrite = flags.running.overwrite;
  job.shard = flags.running.Resolve();
  return job;
}

ColorOptions::Shading ResolveShading(const RenderFlags& flags, const RayCaster& scene) {
  return flags.shading.value_or(scene.HasColors() ? ColorOptions::Shading::kUnlit
                                                  : ColorOptions::Shading::kHeadlight);
}

// Shows the steps before the first image, on stderr where that is a terminal.
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

std::vector<PosedImage> ReadCameras(const RenderFlags& flags, std::vector<std::string>& warnings) {
  if (!flags.model.empty()) return ReadModelViews(flags.model, warnings);
  if (flags.cameras.extension() != ".json") return ReadViewList(flags.cameras);
  return ReadTransforms(flags.cameras, warnings);
}

class RenderRun {
 public:
  RenderRun(const RenderFlags& flags, RenderJobOptions options)
      : flags_(flags), options_(std::move(options)) {
    std::vector<PosedImage> views = ReadCameras(flags, warnings_);
    if (const auto warning = StretchWarning(views, flags.selection)) {
      warnings_.push_back("--size: " + *warning);
    }
    tasks_ = SelectTasks(std::move(views), flags.selection);
    RefuseIdsOfPoints();
    if (!flags.report.empty()) RequireWritable(flags.report / "index.html");
    const Steps steps(flags.run.quiet);
    scene_ = LoadMeshScene(flags.geometry,
                           {.threads = flags.run.threads,
                            .semantics = flags.semantics,
                            .on_step = [&steps](const std::string& s) { steps.Show(s); }});
    options_.frame.color_options.shading = ResolveShading(flags, *scene_.caster);
  }

  void Run() {
    warnings_.insert(warnings_.end(), scene_.warnings.begin(), scene_.warnings.end());
    PrintWarnings(warnings_);
    const size_t total = tasks_.size();
    RenderSummary summary;
    {
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
    if (summary.totals.dropped > 0) {
      PrintWarning(fmt::format("{} values are stored as \"none\", as their format cannot hold them",
                               summary.totals.dropped));
    }
    PrintWarnings(summary.warnings);
    if (!summary.foreign_files.empty()) {
      PrintWarning(fmt::format("{} files of a former run stay in {} and are not of this one: {}{}",
                               summary.foreign_files.size(), options_.out.string(),
                               summary.foreign_files.front(),
                               summary.foreign_files.size() > 1 ? ", ..." : ""));
    }
    if (!flags_.report.empty()) WriteReport(summary);
    RequireNoneLeft(summary.left, "images");
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
               100 * summary.totals.Coverage(),
               summary.totals.depth_range
                   ? fmt::format("{:.4g} to {:.4g}", summary.totals.depth_range->first,
                                 summary.totals.depth_range->second)
                   : "none",
               static_cast<double>(summary.totals.bytes) / kMega, options_.out.string());
  }

  // Writes a model where the images have another size: they need cameras of their own.
  void WriteModel() const {
    const TaskSelection& selection = flags_.selection;
    if (!selection.size && !selection.scale && !selection.cubemap) return;
    if (const auto model = ModelOf(tasks_)) {
      WriteColmapModel(options_.out / "model", *model, ColmapForm::kText);
    }
  }

  // Writes the page of this shard's images that are complete.
  void WriteReport(const RenderSummary& summary) const {
    std::vector<RenderedView> images;
    for (const RenderTask& task : tasks_) {
      const auto found = summary.entries.find(task.view.name);
      if (found == summary.entries.end()) continue;
      const ManifestEntry& entry = found->second;
      images.push_back({task.view, entry.Coverage(), entry.depth_range});
      for (const PromisedFile& file : entry.files) images.back().bytes += file.bytes;
    }
    std::vector<std::string> warnings = warnings_;
    warnings.insert(warnings.end(), summary.warnings.begin(), summary.warnings.end());
    WriteFile(flags_.report / "index.html",
              FormatRenderReport(
                  {.title = "Raylift: " + options_.out.string(),
                   .subtitle = fmt::format("{} of {} images; {}; {:.1f} % of the pixels covered",
                                           images.size(), tasks_.size(), DescribeScene(),
                                           100 * summary.totals.Coverage()),
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
  CLI::App& command = AddCommand(
      program, "render", "Depth maps, normals, color, ids of a mesh for all images of a data set");
  AddRenderOptions(command, *flags);
  SetFooter(
      command,
      "SIGINT and SIGTERM finish the images in hand; the exit code then is 4, and 5 where a file\n"
      "cannot be written, as on a full disk: --resume goes on.\n"
      "Examples:\n"
      "  raylift render --geometry mesh:scene.ply --model sfm --out rendered --resume --preview\n"
      "  raylift render --geometry mesh:scene.ply --model sfm --out dense/stereo/depth_maps \\\n"
      "      --format bin --pattern {name}.geometric\n"
      "  raylift render --geometry mesh:tiles --model sfm --out rendered --shard auto \\\n"
      "      --products depth,normals,color --format normals=npy --format color=jpg --scale 0.5");
  return {&command, [flags, &command] {
            CheckRenderFlags(*flags);
            flags->job.command = CommandLine(command);
            RenderRun(*flags, ResolveJob(*flags)).Run();
          }};
}

}  // namespace raylift
