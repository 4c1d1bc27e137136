// raylift map: packs a scene into one file.

#include <cstddef>
#include <filesystem>
#include <memory>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "apps/argument_files.h"
#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/options.h"
#include "base/progress.h"
#include "io/map/packed_map.h"
#include "localization/matching/feature_store.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/io/hloc_files.h"
#include "raylift/io/image_file.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/scene.h"
#include "raylift/localization/scene_calibration.h"
#include "raylift/mapping/map_packing.h"

namespace raylift {

enum class MapAction { kPack, kAdd, kRemove, kList };
template <>
inline constexpr auto kEnumNames<MapAction> = std::to_array<EnumName<MapAction>>({
    {MapAction::kPack, "pack", "", "make a map of the references of --model"},
    {MapAction::kAdd, "add", "", "add those of --model that it has not yet"},
    {MapAction::kRemove, "remove", "", "take the references NAMES out"},
    {MapAction::kList, "list", "", "print the names of its references"},
});

namespace {

using std::filesystem::path;

struct MapFlags {
  MapAction action = MapAction::kPack;
  path file;
  std::vector<std::string> names;
  ReferenceFlags references;
  path images, features, cache, scene_calibration;
  std::string geometry;
  int max_features = FrontEndOptions{}.max_features;
  MapOptions options;
  RunFlags run;

  bool Packs() const { return action == MapAction::kPack || action == MapAction::kAdd; }
};

void Check(const MapFlags& flags) {
  flags.run.Check();
  flags.references.Check();
  const std::string action(ToString(flags.action));
  if (flags.names.empty() == (flags.action == MapAction::kRemove)) {
    throw OptionError(flags.names.empty() ? "map remove: expected NAMES of references"
                                          : fmt::format("map {} takes no NAMES", action));
  }
  if (!flags.Packs()) {
    RefuseWith("map " + action, {{"--model", !flags.references.model.empty()},
                                 {"--geometry", !flags.geometry.empty()},
                                 {"--images", !flags.images.empty()},
                                 {"--features", !flags.features.empty()}});
    return;
  }
  if (flags.references.model.empty()) {
    throw OptionError(fmt::format("--model is required for map {}", action));
  }
  if (flags.geometry.empty()) {
    throw OptionError(fmt::format("--geometry is required for map {}", action));
  }
  if (!flags.images.empty() && !flags.features.empty()) {
    throw OptionError("--images and --features do not go together");
  }
  if (flags.images.empty() && flags.features.empty() && !flags.references.HaveFeatures()) {
    throw OptionError("--images or --features are required, one of them");
  }
  RequireAtLeast("--max-features", flags.max_features, 1);
  if (flags.geometry.starts_with("sfm")) {
    throw OptionError("--geometry", flags.geometry,
                      "expected depth maps, a mesh, a point cloud or splats: the points of a model "
                      "are no depth");
  }
}

// Returns the keys of a specification that say how depth is sampled and how far it is used, which
// the depth itself does not tell.
std::string SamplingKeys(const std::string& spec) {
  std::string kept;
  for (const std::string_view key : SplitBy(spec, ',')) {
    for (const std::string_view name : {"interpolation=", "max_jump=", "first_sample_px=", "near=",
                                        "far=", "max_incidence_deg=", "max_depth_jump="}) {
      if (key.starts_with(name)) kept += fmt::format(",{}", key);
    }
  }
  return kept;
}

// Gives the features of references, from a file, the cache, or their photographs.
class FeatureGiver {
 public:
  FeatureGiver(const MapFlags& flags, std::span<const PosedImage> images) : flags_(flags) {
    if (!flags.features.empty()) {
      file_ = std::make_shared<const FeatureFile>(flags.features);
    } else if (!flags.cache.empty()) {
      std::vector<ImageFile> files;
      for (const PosedImage& image : images) {
        files.push_back({image.name, flags.images / image.name});
      }
      store_ = ExtractOrReadFeatures(files, {.folder = flags.cache,
                                             .max_features = flags.max_features,
                                             .threads = flags.run.threads,
                                             .show_progress = !flags.run.quiet});
    }
  }

  Features Of(const PosedImage& image) const {
    Features features = Read(image);
    if (features.image_width_px > 0) {
      RequireSizeOf(image.camera, image.name, {features.image_width_px, features.image_height_px},
                    flags_.images / image.name);
    }
    return features;
  }
  std::vector<std::string> Warnings() const {
    return file_ ? file_->Warnings() : std::vector<std::string>();
  }

 private:
  Features Read(const PosedImage& image) const {
    if (file_) return file_->Read(image.name);
    if (store_) return store_->Get(image.name)->features;
    return ExtractFrontEndFeatures(ReadImage(flags_.images / image.name, ImageChannels::kGray),
                                   flags_.max_features);
  }

  const MapFlags& flags_;
  std::shared_ptr<const FeatureFile> file_;    // or
  std::shared_ptr<const FeatureStore> store_;  // or neither
};

// Returns the part of a scene's calibration that a map keeps, as JSON; empty where nothing is
// known.
std::string ToKeep(const std::shared_ptr<const SceneCalibration>& calibration) {
  if (calibration == nullptr) return {};
  SceneCalibration kept = *calibration;
  kept.confidences.clear();
  return FormatSceneCalibration(kept);
}

// Returns the calibration that is named; empty where none is.
std::string NamedCalibration(const MapFlags& flags, const Scene& scene) {
  if (flags.scene_calibration.empty()) return {};
  const auto calibration = ReadSceneCalibration(flags.scene_calibration);
  Calibrated(scene, calibration);  // refuses that of another scene
  return ToKeep(calibration);
}

// Returns the kind of the features, as the map's header says it.
std::string KindOfFeatures(const MapFlags& flags) {
  if (const auto map = OpenPackedMap(flags.features)) return map->header().features;
  return flags.features.empty() ? kRootSift : flags.features.filename().string();
}

// Throws InputError where the images to add differ from the map in how their depth is sampled or in
// their features; keeps in `images` those that the map lacks.
void PrepareToAdd(const MapFlags& flags, const Scene& scene, std::vector<PosedImage>& images) {
  const PackedMap former(flags.file);
  const auto require_equal = [&](std::string_view what, const std::string& there,
                                 const std::string& added) {
    if (there == added) return;
    throw InputError(flags.file, fmt::format("{} \"{}\", those to add \"{}\"", what, there, added));
  };
  require_equal("its depth is sampled by", former.header().depth_keys,
                SamplingKeys(flags.geometry));
  require_equal("its features are of", former.header().features, KindOfFeatures(flags));
  if (flags.scene_calibration.empty() &&
      (scene.calibration != nullptr || !former.ReadCalibration().empty())) {
    PrintWarnings(
        {"what is known of one part of the map is not known of the other: --scene-calibration "
         "gives a calibration of all"});
  }
  std::set<std::string> known;
  for (const PosedImage& image : former.references()) known.insert(image.name);
  std::erase_if(images, [&](const PosedImage& image) { return known.contains(image.name); });
}

void Pack(MapFlags flags) {
  RequireWritable(flags.file);
  if (flags.images.empty() && flags.features.empty()) flags.features = flags.references.model;
  const Scene scene =
      OpenScene(flags.references.Scene(flags.images, {flags.geometry}, flags.run.threads));
  PrintWarnings(scene.warnings);
  const NamedGeometry& geometry = scene.sources.front().geometry;
  if (geometry.maps != nullptr && geometry.maps->HasConfidences()) {
    PrintWarnings({"confidences beside the depth are not kept"});
  }
  std::vector<PosedImage> images = scene.references.images;
  if (flags.action == MapAction::kAdd) PrepareToAdd(flags, scene, images);
  const FeatureGiver features(flags, images);
  const ReferencesToPack references{
      .images = images,
      .depth = [&geometry](const PosedImage& image) { return geometry.MapOf(image); },
      .features = [&features](const PosedImage& image) { return features.Of(image); }};
  Progress progress("references", images.size(), flags.run.Show());
  const PackingHooks hooks{flags.run.threads, [&progress] { progress.Advance(); }};
  const std::string calibration = NamedCalibration(flags, scene);
  if (flags.action == MapAction::kAdd) {
    AddToMap(flags.file, references, calibration, hooks);
  } else {
    MapOptions options = flags.options;
    options.features = KindOfFeatures(flags);
    options.depth_keys = SamplingKeys(flags.geometry);
    options.calibration = calibration.empty() ? ToKeep(scene.calibration) : calibration;
    PackMap(flags.file, references, options, hooks);
  }
  PrintWarnings(features.Warnings());
  if (flags.run.quiet) return;
  const auto bytes = static_cast<double>(std::filesystem::file_size(flags.file));
  const size_t total = PackedMap(flags.file).references().size();
  fmt::print("{} of {} references {}, {:.1f} MB, {:.0f} kB each: {}\n", images.size(), total,
             flags.action == MapAction::kPack ? "packed" : "added", bytes / 1e6,
             bytes / 1e3 / static_cast<double>(total), flags.file.string());
}

void Run(const MapFlags& flags) {
  if (flags.Packs()) return Pack(flags);
  if (flags.action == MapAction::kRemove) {
    return RemoveFromMap(flags.file, flags.names, {.threads = flags.run.threads});
  }
  const PackedMap map(flags.file);
  for (const PosedImage& image : map.references()) fmt::print("{}\n", image.name);
}

}  // namespace

Command AddMapCommand(CLI::App& program) {
  auto flags = std::make_shared<MapFlags>();
  CLI::App& command = AddCommand(program, "map", "A scene in one file, as --scene takes it");
  const OptionGroup map(command, "Map");
  map.Add("ACTION", flags->action, Descriptions<MapAction>()).Required().Default("");
  map.Add("FILE", flags->file, "The map").Required();
  map.Add("NAMES", flags->names, "References to remove");
  AddSceneOption(command);
  AddReferenceOptions(command, flags->references, /*model_is_required=*/false);
  const OptionGroup references(command, "References");
  references.Add("--images", flags->images,
                 "Folder of the reference photographs, whose RootSIFT features are kept");
  references.Add("--features", flags->features, "Instead, hloc's features.h5");
  references.Add("--max-features", flags->max_features,
                 "RootSIFT features per image, the strongest");
  references.Add("--cache", flags->cache, "Where RootSIFT features are, or are kept");
  references.Add("--descriptors", flags->options.descriptors,
                 "How descriptors are kept (by pack):\n" + Descriptions<DescriptorPrecision>());
  references.Add("--seed", flags->options.seed, "Of the vocabulary that references are found by");
  AddModelPosesOption(command, flags->references);
  const OptionGroup geometry(command, "Geometry");
  geometry.Add("--geometry", flags->geometry, GeometryHelp());
  geometry.Add("--scene-calibration", flags->scene_calibration,
               "The file that calibrate or localize wrote, which is kept in the map;\n"
               "without it each run against the map learns it anew");
  geometry.Add("--crs", flags->options.crs,
               "What the world's coordinates are, which is kept in the map (by pack)");
  AddRunOptions(command, flags->run);
  SetFooter(
      command,
      R"(A map holds what `localize` needs of a scene: poses, each reference's depth in 16 bits of its
logarithm (of a mesh, what the reference sees of it), features and what references are
found by. It stands wherever --scene does.
Example:
  raylift map pack town.raymap --model sfm --images photos --geometry depth:maps
  raylift localize --scene town.raymap --queries queries.txt --query-images new --out result)");
  return {&command, [flags] {
            Check(*flags);
            UntilSignal([&] { Run(*flags); }, &BeginsAnew);
          }};
}

}  // namespace raylift
