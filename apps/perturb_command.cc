// raylift perturb: depth maps in, worse depth maps out.

#include <atomic>
#include <cstdio>
#include <memory>

#include "commands.h"
#include "options.h"
#include "scene_arguments.h"
#include "scene_options.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/parallel.h"
#include "raylift/base/progress.h"
#include "raylift/evaluation/depth_perturbation.h"
#include "raylift/io/depth_file.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/localization/references.h"
#include "raylift/renderers/view_renderer.h"
#include "raylift/views/product.h"

namespace raylift {
namespace {

using std::filesystem::path;

struct PerturbFlags {
  ReferenceFlags references;
  std::string geometry;
  std::string format = "exr";
  path out;
  DepthPerturbation perturbation;
  RunFlags run;
};

// The map as it is: stored maps keep their size, a surface is seen at the image's. None where there is
// no map of an image.
std::optional<DepthMap> LoadMap(const NamedGeometry& geometry, const PosedImage& image) {
  if (const auto surface = geometry.Surface()) {
    return RenderDepth(*surface, image.camera, image.cam_from_world, 1);
  }
  const auto map = geometry.maps->Load(image);
  return map != nullptr ? std::optional(*map) : std::nullopt;
}

// Where `--geometry depth:OUT` finds it without being told.
path FileOfImage(const path& folder, const std::string& image, const std::string& format) {
  return PathBelow(folder, image).replace_extension(format);
}

// PNG holds millimetres, all others scene units.
DepthWriteOptions WriteOptionsOf(const PerturbFlags& flags) {
  DepthWriteOptions options;
  options.out_of_range = DepthWriteOptions::OutOfRange::kDrop;
  if (!DepthFileFormatFromName(path("map." + flags.format)) || flags.format == "pgm" ||
      flags.format == "npy.gz" || flags.format == "depth") {
    throw OptionError("--format", flags.format,
                      fmt::format("expected {}", fmt::join(FormatsOf(Product::kDepth), "|")));
  }
  return options;
}

void Run(const PerturbFlags& flags, const std::string& options_json) {
  flags.run.Check();
  flags.references.Check();
  flags.perturbation.Validate();
  const DepthWriteOptions write_options = WriteOptionsOf(flags);
  const LoadedReferences loaded = LoadReferences(flags.references.model, flags.references.thinning);
  const std::vector<PosedImage>& images = loaded.references.images;
  const NamedGeometry geometry =
      MakeGeometrySource(flags.geometry, {.model = flags.references.model,
                                          .references = images,
                                          .thinned_out = loaded.references.thinned_out,
                                          .threads = flags.run.threads});
  if (geometry.Surface() == nullptr && geometry.maps == nullptr) {
    throw OptionError("--geometry", flags.geometry, "must be a mesh, a point cloud or depth maps");
  }
  PrintWarnings(loaded.warnings);
  PrintWarnings(geometry.warnings);
  RequireWritable(flags.out / "perturbation.json");
  std::atomic<size_t> written{0};
  std::atomic<size_t> dropped{0};
  {
    Progress progress("maps", images.size(), flags.run.Show());
    ParallelFor(images.size(), flags.run.threads, [&](size_t i) {
      if (const auto map = LoadMap(geometry, images[i])) {
        const DepthMap worse = PerturbDepth(*map, flags.perturbation, images[i].name);
        const DepthWriteReport report = WriteDepthFile(
            FileOfImage(flags.out, images[i].name, flags.format), worse, write_options);
        dropped += report.dropped;
        ++written;
      }
      progress.Advance();
    });
  }
  WriteFile(flags.out / "perturbation.json", options_json);
  if (dropped > 0) {
    PrintWarning(fmt::format("{} values that {} cannot hold were stored as holes", dropped.load(),
                             flags.format));
  }
  if (!flags.run.quiet) {
    fmt::print("wrote {} depth maps: {}\n", written.load(), flags.out.string());
  }
}

void AddPerturbationOptions(CLI::App& command, DepthPerturbation& values) {
  const std::string group = "Perturbation, in the order of application";
  const auto add = [&](const char* name, auto& value, const char* help) {
    command.add_option(name, value, help)->capture_default_str()->group(group);
  };
  add("--scale", values.scale, "One factor for all images");
  add("--scale-sigma", values.scale_sigma, "A factor per image: standard deviation of its ln");
  add("--warp", values.warp_sigma, "A smooth field of factors per image: deviation of their ln");
  add("--bubbles", values.bubbles, "Smooth domes per image");
  add("--bubble-height", values.bubble_height, "Of the domes, as a share of the depth");
  add("--floaters", values.floaters, "Small blobs per image in front of the surface");
  add("--flying", values.flying_share, "Share of the pixels at depth edges that fly between");
  add("--noise", values.noise_sigma, "Gaussian noise, scene units");
  add("--relative-noise", values.relative_noise_sigma, "Gaussian noise, as a share of the depth");
  add("--quantize", values.quantization_step, "Round to multiples of this, scene units");
  add("--holes", values.hole_share, "Share of the pixels to remove, in blobs");
  add("--seed", values.seed, "Seed of all random choices");
}

}  // namespace

Command AddPerturbCommand(CLI::App& program) {
  auto flags = std::make_shared<PerturbFlags>();
  CLI::App* command =
      program.add_subcommand("perturb", "Depth maps made worse on purpose, to test with");
  AddSceneOption(*command);
  AddReferenceOptions(*command, flags->references);
  command->add_option("--geometry", flags->geometry, GeometryHelp())->required();
  command->add_option("--out", flags->out, "Folder for the maps, DIR/STEM.FORMAT of each image")
      ->required()
      ->group("Output");
  command
      ->add_option("--format", flags->format,
                   fmt::format("{}; png in millimetres, bin as COLMAP has it",
                               fmt::join(FormatsOf(Product::kDepth), "|")))
      ->capture_default_str()
      ->group("Output");
  AddPerturbationOptions(*command, flags->perturbation);
  AddRunOptions(*command, flags->run);
  command->footer(
      "Example:\n"
      "  raylift perturb --model sfm --geometry mesh:scene.ply --out warped --warp 0.05\n"
      "  raylift compare --model sfm --geometry mesh=mesh:scene.ply \\\n"
      "      --geometry warped=depth:warped --truth mesh");
  return {command, [flags, command] { Run(*flags, EffectiveOptionsJson(*command)); }};
}

}  // namespace raylift
