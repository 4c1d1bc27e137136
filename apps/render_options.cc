#include "render_options.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "scene_arguments.h"
#include "scene_options.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

Product ResolveProduct(std::string_view option, const std::string& name) {
  const auto product = FromName<Product>(name);
  if (!product) {
    throw OptionError(option, name, "expected " + NameList<Product>());
  }
  return *product;
}

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
    if (for_one && output.product != ResolveProduct("--format", std::string(parts.front()))) {
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

std::vector<ProductOutput> ResolveProducts(const RenderFlags& flags) {
  std::vector<ProductOutput> outputs;
  for (const std::string_view name : SplitBy(flags.products, ',')) {
    const Product product = ResolveProduct("--products", std::string(name));
    if (std::any_of(outputs.begin(), outputs.end(),
                    [product](const ProductOutput& o) { return o.product == product; })) {
      throw OptionError("--products", flags.products, "a product stands twice");
    }
    outputs.push_back({product, std::string(FormatsOf(product).front())});
  }
  for (const std::string& text : flags.formats) SetFormat(text, outputs);
  return outputs;
}

template <NamedEnum Enum>
Enum ResolveName(std::string_view option, const std::string& text) {
  const auto value = FromName<Enum>(text);
  if (!value) throw OptionError(option, text, "expected " + NameList<Enum>());
  return *value;
}

StorageOptions ResolveStorage(const RenderFlags& flags) {
  StorageOptions storage;
  storage.floats.exr_compression =
      ResolveName<ExrCompression>("--exr-compression", flags.exr_compression);
  storage.floats.sample = ResolveName<FloatSample>("--sample", flags.sample);
  storage.floats.out_of_range =
      ResolveName<DepthWriteOptions::OutOfRange>("--out-of-range", flags.out_of_range);
  if (!(flags.png_step > 0)) {
    throw OptionError("--png-step", FormatDouble(flags.png_step), "must be positive");
  }
  storage.floats.png_step = flags.png_step;
  storage.floats.deflate_npz = flags.deflate_npz;
  if (flags.jpeg_quality < 1 || flags.jpeg_quality > 100) {
    throw OptionError("--jpeg-quality", std::to_string(flags.jpeg_quality), "must be 1 to 100");
  }
  storage.jpeg_quality = flags.jpeg_quality;
  return storage;
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

FrameOptions ResolveFrame(const RenderFlags& flags) {
  FrameOptions frame;
  frame.normals_in = ResolveName<FrameOptions::NormalsIn>("--normals-in", flags.normals_in);
  if (flags.supersampling < 1 || flags.supersampling > 16) {
    throw OptionError("--supersampling", std::to_string(flags.supersampling), "must be 1 to 16");
  }
  frame.color_options.samples_per_pixel_side = flags.supersampling;
  frame.color_options.background_rgb = ParseRgb("--background", flags.background);
  if (flags.shading != "auto" && !FromName<ColorOptions::Shading>(flags.shading)) {
    throw OptionError("--shading", flags.shading,
                      fmt::format("expected {}|auto", NameList<ColorOptions::Shading>()));
  }
  return frame;
}

void AddInputOptions(CLI::App& command, RenderFlags& flags) {
  command
      .add_option("--geometry", flags.geometry,
                  "mesh:PATH[,build=low|medium]: PLY, OBJ, glTF, STL, ...; a.ply+b.ply,\n"
                  "tiles/*.ply or a folder, and several --geometry, are one scene; the\n"
                  "acceleration structure is built in medium quality by default")
      ->required()
      ->allow_extra_args(false)
      ->group("Scene");
  command.add_option("--model", flags.model, "Cameras: COLMAP model folder, text or binary")
      ->group("Scene");
  command
      .add_option("--cameras", flags.cameras,
                  "Cameras: list of name qw qx qy qz tx ty tz MODEL width height params...;\n"
                  "MODEL is one of COLMAP's or EQUIRECTANGULAR (without parameters)")
      ->group("Scene");
  command.add_option("--list-images", flags.list_images, "Only the images in this list")
      ->group("Scene");
  command.add_option("--glob", flags.glob, "Only images whose name matches, as in a shell")
      ->group("Scene");
  AddThinningOptions(command, flags.thinning, "of these (by name)", "Scene");
  command.add_option("--scale", flags.scale, "Factor of the images' sides")->group("Scene");
  command.add_option("--size", flags.size, "WIDTHxHEIGHT of all images")->group("Scene");
  command
      .add_option("--panorama", flags.panorama,
                  "WIDTHxHEIGHT: an equirectangular panorama from each camera's place")
      ->group("Scene");
}

void AddProductOptions(CLI::App& command, RenderFlags& flags) {
  const std::string group = "Products";
  std::string formats;
  for (const Product product : AllValues<Product>()) {
    formats += fmt::format("\n  {}: {}", ToString(product), FormatNames(product));
  }
  command
      .add_option("--products", flags.products,
                  "Of depth (z), distance (along the ray), normals, color, triangle,\n"
                  "incidence (degrees), mask; separated by commas")
      ->capture_default_str()
      ->group(group);
  command
      .add_option("--format", flags.formats,
                  "FORMAT or PRODUCT=FORMAT, repeatable; the first is the default:" + formats)
      ->allow_extra_args(false)
      ->group(group);
  command
      .add_option("--exr-compression", flags.exr_compression,
                  NameList<ExrCompression>() + "; pxr24 keeps 24 of 32 bits")
      ->capture_default_str()
      ->group(group);
  command.add_option("--sample", flags.sample, NameList<FloatSample>() + ", of EXR, NPY and NPZ")
      ->capture_default_str()
      ->group(group);
  command.add_option("--png-step", flags.png_step, "Scene units per count of a 16-bit PNG")
      ->capture_default_str()
      ->group(group);
  command
      .add_option("--out-of-range", flags.out_of_range,
                  NameList<DepthWriteOptions::OutOfRange>() +
                      ": what to do with depth that a PNG or half cannot hold")
      ->capture_default_str()
      ->group(group);
  command.add_flag("--deflate-npz", flags.deflate_npz, "Smaller NPZ files, written slower")
      ->group(group);
  command.add_option("--jpeg-quality", flags.jpeg_quality, "1 to 100")
      ->capture_default_str()
      ->group(group);
  command.add_option("--normals-in", flags.normals_in, NameList<FrameOptions::NormalsIn>())
      ->capture_default_str()
      ->group(group);
  command
      .add_option(
          "--shading", flags.shading,
          NameList<ColorOptions::Shading>() + "|auto (headlight where the mesh has no colours)")
      ->capture_default_str()
      ->group(group);
  command
      .add_option("--supersampling", flags.supersampling,
                  "N: each pixel's colour is the mean of N x N samples")
      ->capture_default_str()
      ->group(group);
  command.add_option("--background", flags.background, "RED,GREEN,BLUE where there is no surface")
      ->capture_default_str()
      ->group(group);
}

void AddOutputOptions(CLI::App& command, RenderFlags& flags) {
  command
      .add_option("--out", flags.out,
                  "Folder for PRODUCT/NAME.FORMAT, manifest.jsonl and summary.json")
      ->required()
      ->group("Output");
  command
      .add_option("--pattern", flags.pattern,
                  "Names of the files without extension: {name}, {dir}, {stem}, {base} of the\n"
                  "image; {name}.geometric for COLMAP, {dir}/{base}_depth for MeshLoc")
      ->capture_default_str()
      ->group("Output");
  command.add_flag("--preview", flags.preview, "Also write preview.png, a sheet of small depths")
      ->group("Output");
  command
      .add_flag("--log-json", flags.log_json,
                "A line of JSON on stdout for each image, and no table")
      ->group("Output");
  command
      .add_flag("--resume", flags.resume,
                "Keep what the manifest says to be complete and not stale")
      ->group("Running");
  command
      .add_option("--shard", flags.shard,
                  "i/n: only the i-th of n parts, by a hash of the names (i from 0 or from 1:\n"
                  "n/n is 0/n); auto: from SLURM's or Open MPI's environment")
      ->capture_default_str()
      ->group("Running");
}

}  // namespace

void AddRenderOptions(CLI::App& command, RenderFlags& flags) {
  AddSceneOption(command);
  AddInputOptions(command, flags);
  AddProductOptions(command, flags);
  AddOutputOptions(command, flags);
  AddRunOptions(command, flags.run);
}

void CheckSources(const RenderFlags& flags) {
  flags.run.Check();
  if (flags.model.empty() == flags.cameras.empty()) {
    throw OptionError("give either --model or --cameras");
  }
}

TaskSelection ResolveSelection(const RenderFlags& flags) {
  TaskSelection selection{.list = flags.list_images,
                          .glob = flags.glob,
                          .thinning = flags.thinning,
                          .pattern = flags.pattern};
  CheckThinning(flags.thinning);
  if (!flags.scale.empty()) {
    selection.scale = ParsePositive("--scale", flags.scale);
  }
  if (!flags.size.empty()) selection.size = ParseSize("--size", flags.size);
  if (!flags.panorama.empty()) selection.panorama = ParseSize("--panorama", flags.panorama);
  const int sizes = (flags.scale.empty() ? 0 : 1) + (flags.size.empty() ? 0 : 1) +
                    (flags.panorama.empty() ? 0 : 1);
  if (sizes > 1) throw OptionError("give at most one of --scale, --size and --panorama");
  return selection;
}

RenderJobOptions ResolveJob(const RenderFlags& flags) {
  return {.out = flags.out,
          .products = ResolveProducts(flags),
          .frame = ResolveFrame(flags),
          .storage = ResolveStorage(flags),
          .threads = flags.run.threads,
          .resume = flags.resume,
          .shard = ParseShard(flags.shard, &EnvironmentVariable),
          .preview = flags.preview};
}

ColorOptions::Shading ResolveShading(const RenderFlags& flags, const TriangleMesh& mesh) {
  const bool has_colors = !mesh.vertex_colors_rgb.empty() || !mesh.triangle_textures.empty();
  return FromName<ColorOptions::Shading>(flags.shading)
      .value_or(has_colors ? ColorOptions::Shading::kUnlit : ColorOptions::Shading::kHeadlight);
}

}  // namespace raylift
