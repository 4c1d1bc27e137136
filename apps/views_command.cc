// raylift views: makes camera poses on a mesh, for scenes without photographs.

#include <cmath>
#include <memory>
#include <numbers>
#include <optional>

#include "apps/command_line.h"
#include "apps/commands.h"
#include "apps/interrupt.h"
#include "apps/job_options.h"
#include "apps/options.h"
#include "lifting/mesh_spec.h"
#include "views/job_files.h"
#include "views/mesh_scene.h"
#include "views/task_list.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/io/colmap_model.h"
#include "raylift/io/image_file.h"
#include "raylift/io/query_list.h"
#include "raylift/views/rendered_references.h"
#include "raylift/views/view_sampler.h"

namespace raylift {
namespace {

using std::filesystem::path;

enum class SamplingMode { kAuto, kInside, kAround, kCover, kAlong, kWalk };

}  // namespace

template <>
inline constexpr auto kEnumNames<SamplingMode> = std::to_array<EnumName<SamplingMode>>({
    {SamplingMode::kAuto, "auto", "", "inside where that shows the mesh well, else cover"},
    {SamplingMode::kInside, "inside", "",
     "at eye height over the ground, clear of walls, looking along free space"},
    {SamplingMode::kAround, "around", "",
     "on a sphere or ring around the mesh, looking at its middle"},
    {SamplingMode::kCover, "cover", "", "wherever there is room in front of surfaces"},
    {SamplingMode::kAlong, "along", "", "on a line"},
    {SamplingMode::kWalk, "walk", "",
     "on foot over the ground, as one carries a phone: frames in order"},
});

namespace {

struct ViewsFlags {
  std::vector<std::string> geometry;
  SamplingMode mode = SamplingMode::kAuto;
  path line;
  int count = 48;
  std::optional<Camera> camera;
  PlaneSize size = {640, 480};
  double fov_deg = 75;
  std::optional<Eigen::Vector3d> up_in_world = std::nullopt;  // nullopt: estimated
  bool level = false;
  double clearance = 0.3;
  uint64_t seed = 0;
  bool any_side = false;
  InsideOptions inside;
  AroundOptions around;
  WalkOptions walk;
  int rig_cameras = 1;
  bool text = false;
  path out;
  bool preview = false;
  bool overwrite = false;
  RunFlags run;
};

Camera ParseCameraOption(std::string_view option, const std::string& text) {
  try {
    return ParseCamera(std::string(option), text);
  } catch (const InputError&) {
    throw OptionError(option, text,
                      "expected \"MODEL width height params...\" of one of COLMAP's models");
  }
}

Camera ResolveCamera(const ViewsFlags& flags) {
  if (flags.camera) return *flags.camera;
  if (!(flags.fov_deg > 0 && flags.fov_deg < 180)) {
    throw OptionError("--fov-deg", FormatDouble(flags.fov_deg), "must be above 0 and below 180");
  }
  const PlaneSize size = flags.size;
  const double focal_px =
      0.5 * size.width_px / std::tan(0.5 * flags.fov_deg * std::numbers::pi / 180);
  const double params[] = {focal_px, focal_px, 0.5 * size.width_px, 0.5 * size.height_px};
  return {CameraModel::kPinhole, size.width_px, size.height_px, params};
}

void Check(const ViewsFlags& flags) {
  flags.run.Check();
  if (flags.line.empty() != (flags.mode != SamplingMode::kAlong)) {
    throw OptionError("--line and --mode along go together");
  }
  RequirePositive("--count", flags.count);
  RequirePositive("--rig-cameras", flags.rig_cameras);
  RequirePositive("--eye-height", flags.inside.eye_height);
  RequirePositive("--max-step", flags.inside.max_step);
  if (!(flags.clearance >= 0)) {
    throw OptionError("--clearance", FormatDouble(flags.clearance), "must not be negative");
  }
  if (!(std::abs(flags.inside.look_down_deg) < 90)) {
    throw OptionError("--look-down-deg", FormatDouble(flags.inside.look_down_deg),
                      "must be above -90 and below 90");
  }
  if (!(flags.inside.min_coverage >= 0 && flags.inside.min_coverage <= 1)) {
    throw OptionError("--min-coverage", FormatDouble(flags.inside.min_coverage), "must be 0 to 1");
  }
  const double low = flags.around.min_elevation_deg;
  const double high = flags.around.max_elevation_deg;
  if (!(low >= -90 && low <= high && high <= 90)) {
    throw OptionError("--min-elevation-deg", FormatDouble(low),
                      "expected -90 <= --min-elevation-deg <= --max-elevation-deg <= 90");
  }
}

SampledViews Sample(const ViewsFlags& flags, const RayCaster& mesh,
                    const ViewSamplerOptions& options) {
  if (flags.mode == SamplingMode::kAlong) {
    return SampleAlong(mesh, options, ReadPointList(flags.line));
  }
  if (flags.mode == SamplingMode::kWalk) {
    return SampleWalk(mesh, options, flags.inside, flags.walk);
  }
  const ViewKind kind = FromName<ViewKind>(ToString(flags.mode)).value();
  ViewsOfKind views = SampleViews(mesh, kind, options, flags.inside, flags.around);
  if (views.kind == ViewKind::kCover && kind == ViewKind::kAuto) {
    views.views.warnings.push_back(
        "there is no ground that shows the mesh well: places are those of --mode cover");
  }
  return std::move(views.views);
}

Eigen::Vector3d ResolveUp(const ViewsFlags& flags, const TriangleMesh& mesh) {
  if (flags.up_in_world) {
    return flags.level ? LevelUp(mesh, *flags.up_in_world) : *flags.up_in_world;
  }
  const UpDirection up = EstimateUp(mesh);
  if (!up.is_clear) PrintWarning("the mesh does not tell which way is up: z is taken for it");
  return flags.level ? LevelUp(mesh, up.up_in_world) : up.up_in_world;
}

void Run(const ViewsFlags& flags) {
  Check(flags);
  ViewSamplerOptions options{.camera = ResolveCamera(flags),
                             .count = flags.count,
                             .clearance = flags.clearance,
                             .seed = flags.seed,
                             .any_side = flags.any_side,
                             .threads = flags.run.threads};
  for (const std::string& spec : flags.geometry) {
    const SurfaceKind kind = SurfaceKindOf(spec);
    if (kind == SurfaceKind::kMesh) continue;
    throw OptionError("--geometry", spec,
                      fmt::format("views are chosen on a mesh; for a {}, mesh it or give render a "
                                  "--model or --cameras",
                                  ToString(kind)));
  }
  RefuseFinished(flags.out / (flags.text ? "images.txt" : "images.bin"), flags.overwrite);
  RequireWritable(flags.out / "images.bin");
  MeshScene scene;
  SampledViews views;
  UntilSignal([&] {
    scene = LoadMeshScene(flags.geometry, {.threads = flags.run.threads});
    PrintWarnings(scene.warnings);
    options.up_in_world = ResolveUp(flags, scene.caster->mesh());
    views = Sample(flags, *scene.caster, options);
  });
  PrintWarnings(views.warnings);
  const ColmapModel model =
      MakeSampledModel(options.camera, views.cam_from_world, flags.rig_cameras);
  WriteColmapModel(flags.out, model, flags.text ? ColmapForm::kText : ColmapForm::kBinary);
  if (flags.preview) {
    WriteImage(flags.out / "preview.png",
               MakeContactSheet(scene.caster, model.PosedImages(), flags.run.threads));
  }
  if (!flags.run.quiet) {
    const Eigen::Vector3d& up = options.up_in_world;
    fmt::print("up is ({:.3f}, {:.3f}, {:.3f})\n", up.x(), up.y(), up.z());
    fmt::print("wrote {} poses, {} images: {}\n", views.cam_from_world.size(), model.images.size(),
               flags.out.string());
  }
}

void AddPlaceOptions(CLI::App& command, ViewsFlags& flags) {
  const OptionGroup group(command, "Places");
  group.Add("--mode", flags.mode, Descriptions<SamplingMode>());
  group.Add("--count", flags.count, "Poses");
  AddUpOption(group, "--up", flags.up_in_world, kUpOfMeshHelp);
  group.Flag("--level", flags.level,
             "Turn --up to what the mesh's floors and tables face (within 30 degrees)");
  group.Add("--clearance", flags.clearance, "Distance to the nearest surface, in all directions");
  group.Add("--eye-height", flags.inside.eye_height, "inside, walk: above the ground");
  group.Add("--max-step", flags.inside.max_step, "inside, walk: what one can walk over");
  group.Add("--look-down-deg", flags.inside.look_down_deg, "inside, walk: below the horizon");
  group.Add("--min-coverage", flags.inside.min_coverage,
            "inside: share of each picture that must see a surface");
  group.Flag("--any-side", flags.any_side,
             "The mesh's triangles are not wound consistently: do not ask which side is seen");
  group.AddParsed("--distance", flags.around.distance, &ParsePositive,
                  "around: from the middle (default: the whole mesh is in the picture)");
  group.Add("--min-elevation-deg", flags.around.min_elevation_deg, "around");
  group.Add("--max-elevation-deg", flags.around.max_elevation_deg,
            "around; equal elevations make a ring");
  group.AddParsed("--spacing", flags.walk.spacing, &ParsePositive,
                  "walk: way from pose to pose (default: a quarter of the eye height)");
  group.Add("--line", flags.line, "along: file of camera centers, x y z per line");
  group.Add("--seed", flags.seed, "Seed of all random choices");
}

void AddCameraOptions(CLI::App& command, ViewsFlags& flags) {
  const OptionGroup group(command, "Camera");
  group.AddParsed("--camera", flags.camera, &ParseCameraOption,
                  "\"MODEL width height params...\" (default: a pinhole camera)");
  group.AddParsed("--size", flags.size, &ParseSize, "WIDTHxHEIGHT of the pinhole camera",
                  "640x480");
  group.Add("--fov-deg", flags.fov_deg, "Horizontal angle of the pinhole camera");
  group.Add("--rig-cameras", flags.rig_cameras,
            "N: each pose is a rig of N cameras that look all around; writes rigs and\n"
            "frames, too");
}

}  // namespace

Command AddViewsCommand(CLI::App& program) {
  auto flags = std::make_shared<ViewsFlags>();
  CLI::App& command =
      AddCommand(program, "views", "Camera poses on a mesh, for scenes without photographs");
  const OptionGroup places(command, "Places");
  places.Add("--geometry", flags->geometry, "mesh:PATH, as of render").Required().OnePerUse();
  AddPlaceOptions(command, *flags);
  AddCameraOptions(command, *flags);
  const OptionGroup output(command, "Output");
  output.Add("--out", flags->out, "Folder for the COLMAP model, ready for render --model")
      .Required();
  output.Flag("--text", flags->text, "Write the model as text");
  output.Flag("--preview", flags->preview, "Also write preview.png, a sheet of small depths");
  AddOverwriteOption(command, flags->overwrite);
  AddRunOptions(command, flags->run);
  SetFooter(
      command,
      R"(Each place depends on those before it: the work cannot be shared, and a run that a signal has
ended (exit code 4) begins anew, with the same bytes.
Example:
  raylift views --geometry mesh:scene.ply --count 100 --out views --preview
  raylift render --geometry mesh:scene.ply --model views --out rendered
A walk, its photographs, and its odometry with drift:
  raylift views --geometry mesh:scene.ply --mode walk --count 200 --out walk
  raylift render --geometry mesh:scene.ply --model walk --products color --out frames
  raylift perturb --model walk --walk --out odometry --drift 0.01)");
  return {&command, [flags] { Run(*flags); }};
}

}  // namespace raylift
