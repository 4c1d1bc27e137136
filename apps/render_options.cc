#include "render_options.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "scene_arguments.h"
#include "scene_options.h"
#include "typed_options.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/views/file_guide.h"

namespace raylift {
namespace {

std::string FormatNames(Product product) {
  return fmt::format("{}", fmt::join(FormatsOf(product), "|"));
}

// "npy" is for the products that can be stored so, "depth=npy" for one.
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
  CheckThinning(selection.thinning);
  if (selection.scale.has_value() + selection.size.has_value() + selection.panorama.has_value() >
      1) {
    throw OptionError("give at most one of --scale, --size and --panorama");
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
  command
      .add_option("--geometry", flags.geometry,
                  "mesh:PATH[,build=low|medium]: PLY, OBJ, glTF, STL, ...; a.ply+b.ply,\n"
                  "tiles/*.ply or a folder, and several --geometry, are one scene; the\n"
                  "acceleration structure is built in medium quality by default; or\n"
                  "cloud:PATH[,key=value...], a point cloud, or splat:FILE[,key=value...],\n"
                  "Gaussian splats, as localize takes them")
      ->required()
      ->allow_extra_args(false)
      ->group("Scene");
  command.add_option("--model", flags.model, "Cameras: COLMAP model folder, text or binary")
      ->group("Scene");
  command
      .add_option("--cameras", flags.cameras,
                  "Cameras: list of name qw qx qy qz tx ty tz MODEL width height params...;\n"
                  "MODEL is one of COLMAP's or EQUIRECTANGULAR (without parameters); or a\n"
                  "transforms.json of nerfstudio or instant-ngp")
      ->group("Scene");
  command.add_option("--list-images", selection.list, "Only the images in this list")
      ->group("Scene");
  command.add_option("--glob", selection.glob, "Only images whose name matches, as in a shell")
      ->group("Scene");
  AddThinningOptions(command, selection.thinning, "of these (by name)", "Scene");
  AddParsedOption(command, "--scale", selection.scale, &ParsePositive,
                  "Factor of the images' sides; OUT/model then has their cameras")
      ->group("Scene");
  AddParsedOption(command, "--size", selection.size, &ParseSize,
                  "WIDTHxHEIGHT of all images; likewise")
      ->group("Scene");
  AddParsedOption(command, "--panorama", selection.panorama, &ParseSize,
                  "WIDTHxHEIGHT: an equirectangular panorama from each camera's place")
      ->group("Scene");
}

void AddProductOptions(CLI::App& command, RenderFlags& flags) {
  const std::string group = "Products";
  std::string formats;
  for (const Product product : AllValues<Product>()) {
    formats += fmt::format("\n  {}: {}", ToString(product), FormatNames(product));
  }
  AddParsedOption(
      command, "--products", flags.products, &ParseProducts,
      "Of depth (z), distance (along the ray), inverse_depth (1 / z), points (x, y, z),\n"
      "normals, color, triangle (the face of the mesh's file), object (which mesh of\n"
      "several), incidence (degrees), mask; separated by commas",
      "depth")
      ->group(group);
  command
      .add_option("--format", flags.formats,
                  "FORMAT or PRODUCT=FORMAT, repeatable; the first is the default:" + formats)
      ->allow_extra_args(false)
      ->group(group);
  DepthWriteOptions& floats = flags.job.storage.floats;
  AddEnumOption(command, "--exr-compression", floats.exr_compression,
                "{}; pxr24 keeps 24 of 32 bits")
      ->group(group);
  AddEnumOption(command, "--sample", floats.sample, "{}, of EXR, NPY and NPZ")->group(group);
  command.add_option("--png-step", floats.png_step, "Scene units per count of a 16-bit PNG")
      ->capture_default_str()
      ->group(group);
  AddEnumOption(command, "--out-of-range", floats.out_of_range,
                "{}: what to do with depth that a PNG or half cannot hold")
      ->group(group);
  command.add_flag("--deflate-npz", floats.deflate_npz, "Smaller NPZ files, written slower")
      ->group(group);
  command.add_option("--jpeg-quality", flags.job.storage.jpeg_quality, "1 to 100")
      ->capture_default_str()
      ->group(group);
  FrameOptions& frame = flags.job.frame;
  AddEnumOption(command, "--normals-in", frame.normals_in, "{}, of normals and points")
      ->group(group);
  AddEnumOption(command, "--shading", flags.shading, "{} (headlight where the mesh has no colors)",
                "auto")
      ->group(group);
  command
      .add_option("--supersampling", frame.color_options.samples_per_pixel_side,
                  "N: each pixel's color is the mean of N x N samples")
      ->capture_default_str()
      ->group(group);
  AddParsedOption(command, "--background", frame.color_options.background_rgb, &ParseRgb,
                  "RED,GREEN,BLUE where there is no surface", "0,0,0")
      ->group(group);
}

void AddFilesHelp(CLI::App& command) {
  command
      .add_flag_callback(
          "--help-files",
          [] {
            fmt::print("{}", FileGuide());
            throw CLI::Success();
          },
          "Print what the files of each product hold and exit; README.txt beside them says so too")
      ->configurable(false)
      ->group("Output");
}

void AddOutputOptions(CLI::App& command, RenderFlags& flags) {
  command
      .add_option("--out", flags.job.out,
                  "Folder for PRODUCT/NAME.FORMAT, manifest.jsonl and summary.json")
      ->required()
      ->group("Output");
  command
      .add_option("--pattern", flags.selection.pattern,
                  "Names of the files without extension: {name}, {dir}, {stem}, {base} of the\n"
                  "image; {name}.geometric for COLMAP, {dir}/{base}_depth for MeshLoc")
      ->capture_default_str()
      ->group("Output");
  command
      .add_option("--report", flags.report,
                  "Folder for one HTML page to look at (index.html): images, pictures, 3D view")
      ->group("Output");
  command
      .add_flag("--preview", flags.job.preview, "Also write preview.png, a sheet of small depths")
      ->group("Output");
  command
      .add_flag("--log-json", flags.log_json,
                "A line of JSON on stdout for each image, and no table")
      ->group("Output");
  AddJobOptions(command, flags.running, "Keep what the manifest says to be complete and not stale",
                "Render all again in a folder where a former run was; else it is refused");
}

}  // namespace

void AddRenderOptions(CLI::App& command, RenderFlags& flags) {
  AddSceneOption(command);
  AddInputOptions(command, flags);
  AddProductOptions(command, flags);
  AddOutputOptions(command, flags);
  AddFilesHelp(command);
  AddRunOptions(command, flags.run);
}

void CheckRenderFlags(const RenderFlags& flags) {
  flags.run.Check();
  if (flags.model.empty() == flags.cameras.empty()) {
    throw OptionError("give either --model or --cameras");
  }
  flags.running.Check();
  CheckSelection(flags.selection);
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

}  // namespace raylift
