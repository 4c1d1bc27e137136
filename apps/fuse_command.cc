// raylift fuse: fuses the depth of all references into one mesh.

#include <cstddef>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "apps/argument_files.h"
#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/matching_options.h"
#include "apps/options.h"
#include "base/progress.h"
#include "lifting/alignment_text.h"
#include "localization/calibration_images.h"
#include "mapping/fields.h"
#include "views/vertex_coloring.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/scene.h"
#include "raylift/localization/scene_calibration.h"
#include "raylift/mapping/fusion.h"
#include "raylift/renderers/ray_caster.h"
#include "raylift/surfaces/mesh_files.h"

namespace raylift {
namespace {

using std::filesystem::path;

struct FuseFlags {
  ReferenceFlags references;
  path images, scene_calibration, out;
  std::string geometry;
  AlignMode align = AlignMode::kAuto;
  MatchingFlags matching;
  FusionOptions fusion;
  double memory_gb = 4;
  int max_side_px = 640;
  bool no_colors = false;
  RunFlags run;

  // Returns whether references can be matched with each other, by which depth is corrected.
  bool HaveMatches() const {
    return !images.empty() || matching.hloc.Any() || references.HaveFeatures();
  }
};

void Check(const FuseFlags& flags) {
  RequireFusion();
  flags.references.Check();
  flags.run.Check();
  flags.matching.Check({flags.geometry}, RetrievalFlags::Queries::kReferences);
  if (flags.geometry.starts_with("sfm")) {
    throw OptionError("--geometry", flags.geometry,
                      "expected depth maps, a mesh, a point cloud or splats: the points of a model "
                      "are no surface");
  }
  CheckRanges(ConstFieldsOf(flags.fusion));
  RequireAtLeast("--max-side", flags.max_side_px, 1);
  if (!(flags.memory_gb > 0)) {
    throw OptionError("--memory", fmt::format("{}", flags.memory_gb), "must be positive");
  }
  if (flags.out.extension() != ".ply") {
    throw OptionError("--out", flags.out.string(), "expected a name that ends in .ply");
  }
  if (flags.align == AlignMode::kAuto) return;
  if (!flags.scene_calibration.empty()) {
    throw OptionError("--align-depth does not go with --scene-calibration, which says it");
  }
  if (flags.align != AlignMode::kOff) {
    RequireWithoutHloc(flags.matching.hloc, "--images is", flags.HaveMatches());
  }
}

// Returns the scene with its depth corrected as localize would.
Scene WithCorrectedDepth(const FuseFlags& flags, const Scene& scene) {
  if (!flags.scene_calibration.empty()) {
    return Calibrated(scene, ReadSceneCalibration(flags.scene_calibration));
  }
  if (scene.calibration != nullptr) {
    if (flags.align == AlignMode::kAuto) return scene;
    throw OptionError("--align-depth does not go with a packed map whose calibration says it");
  }
  if (flags.align == AlignMode::kOff || !flags.HaveMatches()) return scene;
  const std::vector<Query> queries = QueriesOf(scene.references);
  const auto matches = OpenMatchesBetween(flags.matching, {flags.geometry}, flags.images, flags.run,
                                          scene, queries, RetrievalFlags::Queries::kReferences);
  const auto among =
      CollectReferenceMatches(queries, *matches, scene.references, flags.run.threads);
  PrintWarnings(matches->Warnings());
  return Aligned(scene, flags.align, among, flags.run.threads);
}

FusedMesh Fuse(const FuseFlags& flags, const Scene& scene) {
  const NamedGeometry& geometry = scene.sources.front().geometry;
  const std::vector<PosedImage> views =
      ViewsToFuse(geometry, scene.references.images, flags.max_side_px);
  Progress progress("views, twice", 2 * views.size(), flags.run.Show());
  FusionOptions options = flags.fusion;
  options.max_bytes = static_cast<size_t>(flags.memory_gb * 1e9);
  options.threads = flags.run.threads;
  options.on_view = [&progress] { progress.Advance(); };
  return FuseViews(*geometry.source, views, options);
}

void Color(const FuseFlags& flags, const Scene& scene, TriangleMesh& mesh) {
  const std::vector<PosedImage>& photographs = scene.references.images;
  Progress progress("photographs", photographs.size(), flags.run.Show());
  const RayCaster surface(std::make_shared<const TriangleMesh>(mesh));
  mesh.vertex_colors_rgb = ColorVertices(mesh, surface, photographs, flags.images,
                                         {.threads = flags.run.threads,
                                          .on_photograph = [&progress] { progress.Advance(); }})
                               .colors_rgb;
}

void Print(const FuseFlags& flags, const SceneSource& source, const FusedMesh& fused) {
  if (source.alignment && source.alignment->mode != AlignMode::kOff) {
    fmt::print("the depth is corrected {}\n", Describe(*source.alignment));
  }
  const ViewScale& scale = fused.scale;
  fmt::print("a pixel is {:.2g} wide on the surface; {}\n", scale.pixel_width,
             scale.num_comparisons == 0
                 ? "no two views see the same, which would tell the noise"
                 : fmt::format("views disagree by {:.2g}, {:.2g} % of the depth", scale.noise,
                               100 * scale.relative_noise));
  fmt::print("voxel {:.3g}, distances up to {:.3g}, grid of {:.0f} MB; {} triangles: {}\n",
             fused.voxel, fused.truncation, static_cast<double>(fused.grid_bytes) / 1e6,
             fused.mesh.triangles.size(), flags.out.string());
}

void Run(const FuseFlags& flags) {
  RequireWritable(flags.out);
  Scene scene =
      OpenScene(flags.references.Scene(flags.images, {flags.geometry}, flags.run.threads));
  PrintWarnings(scene.warnings);
  scene = WithCorrectedDepth(flags, scene);
  FusedMesh fused = Fuse(flags, scene);
  if (!flags.images.empty() && !flags.no_colors) Color(flags, scene, fused.mesh);
  WritePly(flags.out, fused.mesh);
  if (!flags.run.quiet) Print(flags, scene.sources.front(), fused);
}

void AddFusionOptions(CLI::App& command, FuseFlags& flags) {
  const OptionGroup group(command, "Fusion");
  group.Add(FieldsOf(flags.fusion));
  group.Add("--max-side", flags.max_side_px,
            "Look at surfaces through references of at most this many pixels' side;\n"
            "depth maps are taken at their own size");
  group.Add("--memory", flags.memory_gb, "Most memory of the grid, in GB");
}

}  // namespace

Command AddFuseCommand(CLI::App& program) {
  auto flags = std::make_shared<FuseFlags>();
  CLI::App& command =
      AddCommand(program, "fuse", "One mesh of the depth of all references, for all commands");
  AddSceneOption(command);
  AddReferenceOptions(command, flags->references);
  const OptionGroup references(command, "References");
  references.Add("--images", flags->images,
                 "Folder of the reference photographs, which correct the depth and color\n"
                 "the mesh");
  AddModelPosesOption(command, flags->references);
  const OptionGroup geometry(command, "Geometry");
  geometry.Add("--geometry", flags->geometry, GeometryHelp()).Required();
  geometry.Add("--align-depth", flags->align,
               "Correct each reference's depth by the matches between references, as\n"
               "localize does: {}. auto: off without\n"
               "--images and --matches");
  geometry.Add("--scene-calibration", flags->scene_calibration,
               "The file that calibrate or localize wrote, which says how depth is\n"
               "corrected");
  AddFusionOptions(command, *flags);
  AddMatchingOptions(command, flags->matching, "; without it, RootSIFT of --images", "none");
  const OptionGroup output(command, "Output");
  output.Add("--out", flags->out, "The mesh (PLY)").Required();
  output.Flag("--no-colors", flags->no_colors, "Leave the mesh without colors");
  AddRunOptions(command, flags->run);
  SetFooter(
      command,
      R"(Each reference tells how far the points of a grid are before what it sees or behind it;
the mesh is where the mean is zero. What references look through is free, so that a wrong
surface goes where enough of them see past it. References that see the same more surely
(nearer, straighter, or with a known deviation) weigh more.
Example:
  raylift fuse --model sfm --images photos --geometry depth:maps,preset=da3 --out fused.ply
  raylift localize --model sfm --images photos --geometry mesh:fused.ply \
      --queries queries.txt --query-images new --out result)");
  return {&command, [flags] {
            Check(*flags);
            UntilSignal([&] { Run(*flags); }, &BeginsAnew);
          }};
}

}  // namespace raylift
