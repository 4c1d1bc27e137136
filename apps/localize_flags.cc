#include "apps/localize_flags.h"

#include <algorithm>
#include <utility>

#include "apps/argument_files.h"
#include "apps/job_options.h"
#include "apps/options.h"
#include "io/text/line_tokens.h"
#include "lifting/mesh_spec.h"
#include "localization/continuous/continuous_localizer.h"
#include "localization/fields.h"
#include "views/task_list.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/io/scene_file.h"

namespace raylift {

namespace {

// Throws OptionError unless, without --model, there is one mesh to render the references from, and
// no option that only a model allows: `needless` is the name of such an option, where `is_given`.
void RequireMeshOnly(std::span<const std::string> geometry, std::string_view needless,
                     bool is_given) {
  if (geometry.empty()) {
    throw OptionError(
        "--model is required (or --geometry mesh:PATH or dsm:FILE, to render the references from "
        "it); COLMAP "
        "makes one of photographs: `colmap automatic_reconstructor --workspace_path sfm "
        "--image_path PHOTOS "
        "--dense 0`, then --model sfm/sparse/0");
  }
  if (geometry.size() != 1 || !IsMeshSpec(geometry.front())) {
    throw OptionError("--geometry", fmt::format("{}", fmt::join(geometry, " ")),
                      "without --model the references are rendered from a mesh: expected one "
                      "mesh:PATH or dsm:FILE");
  }
  if (is_given) throw OptionError(fmt::format("{} needs --model", needless));
}

// Refuses --rerender unless there is what it needs: a mesh, and the queries' photographs.
void CheckRerender(int rounds, std::span<const std::string> geometry, bool has_photographs) {
  const std::string value = std::to_string(rounds);
  if (rounds < 0) throw OptionError("--rerender", value, "must not be negative");
  if (rounds == 0) return;
  if (std::none_of(geometry.begin(), geometry.end(), [](const std::string& spec) {
        return IsMeshSpec(spec) || spec.starts_with("splat:");
      })) {
    throw OptionError("--rerender", value, "needs --geometry mesh:PATH, dsm:FILE or splat:FILE");
  }
  if (!has_photographs) throw OptionError("--rerender", value, "needs --query-images");
}

// Checks the options that need --model, or are needed without it.
void CheckReferences(const LocalizeFlags& flags) {
  flags.references.Check();
  flags.matching.hloc.Check();
  flags.mesh_only.Check();
  CheckRerender(flags.mesh_only.rerender, flags.geometry.specs, !flags.QueryImages().empty());
  if (!flags.RendersReferences()) {
    RequireWithoutHloc(flags.matching.hloc, "--images is",
                       !flags.images.empty() || flags.references.HaveFeatures());
    return;
  }
  RequireMeshOnly(flags.geometry.specs, flags.matching.hloc.Any() ? "--features" : "--images",
                  flags.matching.hloc.Any() || !flags.images.empty());
  if (flags.QueryImages().empty()) throw OptionError("--query-images is required without --model");
}

// Checks --align edges, which needs no matches: refuses options of these.
void CheckEdges(const LocalizeFlags& flags) {
  if (!flags.AlignsEdges()) return;
  RefuseWith("--align edges", {{"--model", !flags.references.model.empty()},
                               {"--features", flags.matching.hloc.Any()},
                               {"--leave-one-out", flags.leave_one_out},
                               {"--continuous", flags.continuous.enabled},
                               {"--rigs", !flags.rigs.empty()},
                               {"--rerender", flags.mesh_only.rerender > 0},
                               {"--scene-calibration", !flags.scene_calibration.empty()},
                               {"--write-model", !flags.write_model.empty()},
                               {"--write-problems", !flags.write_problems.empty()}});
  if (flags.geometry.specs.size() != 1 || !IsMeshSpec(flags.geometry.specs.front())) {
    throw OptionError("--align edges needs one --geometry mesh:PATH or dsm:FILE");
  }
  if (flags.QueryImages().empty()) throw OptionError("--align edges needs --query-images");
  if (flags.priors.empty()) {
    throw OptionError("--align edges needs --priors with a pose of each query");
  }
}

// Refuses options that go with neither --resume nor shards.
void CheckRunning(const LocalizeFlags& flags) {
  flags.running.Check();
  const Shard shard = flags.running.Resolve();
  if (!shard.IsAll() && flags.continuous.enabled) {
    throw OptionError("--shard", flags.running.shard,
                      "--continuous cannot be shared: each query may be a reference of the next");
  }
  if (!flags.ground_truth.empty() && flags.report.empty()) {
    throw OptionError("--ground-truth", flags.ground_truth.string(), "is for --report");
  }
}

// Checks --rigs: a rig is localized as one, once.
void CheckRigs(const LocalizeFlags& flags) {
  if (flags.rigs.empty()) return;
  RefuseWith("--rigs", {{"--leave-one-out", flags.leave_one_out},
                        {"--continuous", flags.continuous.enabled},
                        {"--rerender", flags.mesh_only.rerender > 0},
                        {"--refine-focal", flags.estimator.refine_focal}});
}

Rigid3 ParsePose(std::string_view option, const std::string& text) {
  LineReader line(std::filesystem::path(option), text);
  return LineTokens(line, line.Next().value_or("")).Pose();
}

// Checks --odometry: a walk is smoothed when all of its photographs are localized.
void CheckWalk(const LocalizeFlags& flags) {
  const auto needs = [](const char* option, const char* others, bool given, bool fits) {
    if (given && !fits) throw OptionError(fmt::format("{} needs {}", option, others));
  };
  const bool walks = flags.walk.enabled();
  needs("--times", "--continuous or --odometry", !flags.times.empty(),
        walks || flags.continuous.enabled);
  needs("--online", "--odometry", flags.walk.online, walks);
  needs("--no-rematch", "--odometry", flags.walk.no_rematch, walks);
  needs("--cam-from-body", "--odometry",
        FormatPose(flags.walk.cam_from_body) != FormatPose(Rigid3()), walks);
  needs("--odometry-scale", "--odometry", flags.walk.scale != OdometryScale::kKnown, walks);
  if (!walks) return;
  RefuseWith("--odometry",
             {{"--continuous", flags.continuous.enabled}, {"--rigs", !flags.rigs.empty()}});
}

void CheckQueries(const LocalizeFlags& flags) {
  if (!flags.leave_one_out) {
    if (flags.queries.empty()) {
      throw OptionError("--queries is required (or --leave-one-out)");
    }
    if (flags.PriorsOfPhotographs() && !flags.world &&
        std::ranges::none_of(flags.geometry.specs, &MayNameSystem)) {
      throw OptionError("--priors", "exif", "needs --crs, what the world's coordinates are");
    }
    if (flags.PriorsOfPhotographs() && flags.QueryImages().empty()) {
      throw OptionError("--priors", "exif", "needs --query-images or --images");
    }
    return;
  }
  RefuseWith("--leave-one-out", {{"--queries", !flags.queries.empty()},
                                 {"--query-images", !flags.query_images.empty()},
                                 {"--continuous", flags.continuous.enabled},
                                 {"--write-model", !flags.write_model.empty()}});
  if (flags.RendersReferences()) throw OptionError("--leave-one-out needs --model");
}

double ParseFov(std::string_view option, const std::string& text) {
  const double fov_deg = ParsePositive(option, text);
  if (!(fov_deg < 180)) throw OptionError(option, text, "must be below 180");
  return fov_deg;
}

void AddMeshOnlyOptions(CLI::App& command, MeshOnlyFlags& flags) {
  const OptionGroup group(command, "Without --model: references rendered from the mesh");
  group.Add("--views", flags.views, "How many; they are kept in OUT/references");
  group.Add("--view-kind", flags.kind,
            "Where from: {}. inside: at eye height above\n"
            "the ground; around: from outside, looking at the middle; cover: from\n"
            "wherever there is room in front of surfaces; auto: inside where there\n"
            "is a ground, else cover");
  group.AddParsed("--view-size", flags.size, &ParseSize,
                  "WIDTHxHEIGHT (default: as sharp as the queries)");
  group.AddParsed("--view-fov-deg", flags.fov_deg, &ParseFov,
                  "Horizontal angle of view (default: the queries', 60 to 100)");
  AddUpOption(group, "--view-up", flags.up_in_world, kUpOfMeshHelp);
  group.Add("--view-eye-height", flags.eye_height, "inside: above the ground");
  group.Add("--view-clearance", flags.clearance,
            "Distance to the nearest surface (but for inside, at most 5 % of the\n"
            "mesh's size)");
  const OptionGroup estimator(command, "Estimator");
  estimator.Add("--rerender", flags.rerender,
                "Rounds of rendering the mesh (or splats) from the estimated pose, matching\n"
                "the query with that by features and by patches and estimating again; a pose is\n"
                "kept where the 2D-3D matches support it better. For what looks like the\n"
                "photographs");
}

void AddContinuousOptions(CLI::App& command, ContinuousFlags& flags) {
  const OptionGroup group(command, "Continuous localization");
  group.Flag("--continuous", flags.enabled,
             "Localize one query after the other; each that is localized well\n"
             "becomes a reference for those that follow");
  group.Add("--max-joined", flags.max_joined,
            "Joined queries among a query's references (default: half of --top-k)");
  group.Flag("--trust-joined", flags.trust_joined, "Take the poses of joined queries for exact");
  group.Add(FieldsOf(flags.gate));
  group.Flag("--join-any-difference", flags.join_any_difference,
             "Do not ask for poses by P3P and E5+1 alone");
}

}  // namespace

void LocalizeFlags::Check() const {
  estimator.Validate();
  filter.thresholds.Validate();
  geometry.Check();
  CheckQueries(*this);
  CheckRigs(*this);
  CheckWalk(*this);
  CheckEdges(*this);
  if (!AlignsEdges()) CheckReferences(*this);
  if (pictures < 0) {
    throw OptionError("--pictures", std::to_string(pictures), "must not be negative");
  }
  if (!(min_confidence >= 0 && min_confidence <= 1)) {
    throw OptionError("--min-confidence", fmt::format("{}", min_confidence),
                      "must lie between 0 and 1");
  }
  std::error_code none;
  if (!write_model.empty() && std::filesystem::equivalent(write_model, references.model, none)) {
    throw OptionError("--write-model", write_model.string(), "is the folder of --model");
  }
  if (!scene_calibration.empty() && geometry.align != AlignMode::kAuto) {
    throw OptionError("--align-depth does not go with --scene-calibration, which says it");
  }
  run.Check();
  CheckRunning(*this);
  continuous.Check();
  if (!AlignsEdges()) matching.Check(geometry.specs, QueriesAre());
  if (geometry.specs.empty() && Uses2D3D(estimator.method) &&
      geometry.candidates.mode != CandidateMode::kTriangulate) {
    throw OptionError(fmt::format(
        "--geometry is required by --method {} (e5p1 and --candidates triangulate need none)",
        ToString(estimator.method)));
  }
  if (pictures > 0 && QueryImages().empty()) {
    throw OptionError("--pictures", std::to_string(pictures), "needs --images or --query-images");
  }
}

void AddLocalizeOptions(CLI::App& command, LocalizeFlags& flags, const char* out_help) {
  AddSceneOption(command);
  AddReferenceOptions(command, flags.references, /*model_is_required=*/false);
  const OptionGroup references(command, "References");
  references.Add("--images", flags.images, "Folder of the reference photographs");
  AddModelPosesOption(command, flags.references);
  AddGeometryOptions(command, flags.geometry);
  const OptionGroup geometry(command, "Geometry");
  geometry.Flag("--no-doctor", flags.no_doctor,
                "Do not check whether geometry and poses are read as they were meant");
  geometry.Add("--scene-calibration", flags.scene_calibration,
               "What is known of the scene, depth corrections and noise: the file that\n"
               "calibrate or a run wrote (default: learned from the references, or from the\n"
               "queries where --matches hold none between references)");
  const OptionGroup queries(command, "Queries");
  queries.Add("--queries", flags.queries,
              "List of queries: name MODEL width height params... [focal_sigma S], S the focal\n"
              "length's standard deviation as a share of it; where a name stands\n"
              "alone, the focal length is found with the pose, unless a drone wrote its lens's\n"
              "calibration. Or the photographs' folder");
  queries.Flag("--leave-one-out", flags.leave_one_out,
               "The queries are the references: each is localized by the others");
  queries.Add("--query-images", flags.query_images,
              "Folder of the query photographs (default: --images)");
  queries.Add("--priors", flags.priors,
              "What is known of the queries' poses: lines `name position x y z sigma`\n"
              "(world; or of another system, with crs=EPSG:4326: longitude first),\n"
              "`name pose qw qx qy qz tx ty tz sigma sigma_deg` (world to camera; a position\n"
              "and an orientation), `name gravity x y z sigma_deg` (down in the camera's frame),\n"
              "`name heading deg sigma_deg` (clockwise from north),\n"
              "`name orientation qw qx qy qz sigma_deg` (world to camera),\n"
              "`name range r sigma [m]` (along the optical axis to the surface, by a laser;\n"
              "in scene units or m),\n"
              "`name focal_range F` (the focal length, up to a factor),\n"
              "`name focal_sigma S` (its standard deviation as a share of it),\n"
              "`* world_down x y z` (default: 0 0 -1), `* world_north x y z` (0 1 0);\n"
              "or exif: what the photographs say themselves, as `queries` shows it");
  AddCrsOption(queries, flags.world);
  queries.Add("--align", flags.align,
              "What poses come from: {}. edges: those of the mesh, which may have no\n"
              "colors, in the photographs, around the poses of --priors");
  queries.Add("--rigs", flags.rigs,
              "Queries that are photographs of one rig have one pose together:\n"
              "rig_config.json of COLMAP's rig_configurator with cam_from_rig_* (names alike\n"
              "after the prefix are of one moment), or a COLMAP model with rigs and frames.\n"
              "Priors are those of the rig's first camera");
  AddMatchingOptions(command, flags.matching, "; without it, RootSIFT", "OUT/cache");
  const OptionGroup walk(command, "Walks");
  walk.Add("--odometry", flags.walk.odometry,
           "How the camera moved between the queries, in any frame: TUM's trajectory\n"
           "(time tx ty tz qx qy qz qw, camera to world), EuRoC's CSV, KITTI's poses, a\n"
           "COLMAP model, a pose file, kapture, transforms.json, or lines of JSON as of\n"
           "ARKit. Poses are smoothed by it, and queries without one get the walk's.\n"
           "Of several walks: lines `walk FOLDER ODOMETRY [TIMES]`, each of the queries\n"
           "whose names start with FOLDER/; the other options of walks hold for all");
  walk.AddParsed("--cam-from-body", flags.walk.cam_from_body, &ParsePose,
                 "QW QX QY QZ TX TY TZ of what the odometry moves (an IMU, a robot's base) in\n"
                 "the camera: points of the body to those of the camera, in its unit",
                 "1 0 0 0 0 0 0");
  walk.Add("--odometry-scale", flags.walk.scale, "{}: whether its unit is the scene's");
  walk.Flag("--online", flags.walk.online,
            "Each query's pose by those before it alone, as while the walk is taken");
  walk.Flag("--no-rematch", flags.walk.no_rematch,
            "Queries that are not sure by themselves are not localized again where the\n"
            "rest of the walk predicts them");
  walk.Add("--times", flags.times,
           "When photographs were taken: lines `name seconds`. With --odometry of the\n"
           "queries (default: the odometry's, or their names, if these are times; in a list,\n"
           "it is for walks of which nothing else tells), with --continuous also of\n"
           "references; those older than these first, backwards (default: by name)");
  const OptionGroup output(command, "Output");
  output.Add("--out", flags.out, out_help).Required();
  output.Add("--write-problems", flags.write_problems,
             "Also write each query's pose problem (JSON) here");
  output.Add("--write-model", flags.write_model,
             "Also write the references and the localized queries here as one COLMAP model");
  output.Add("--report", flags.report, "Folder for one HTML page to look at (index.html)");
  output.Add("--ground-truth", flags.ground_truth,
             "COLMAP model folder, or a pose file: the page shows errors beside what is\n"
             "expected; nothing else knows it");
  output.Add("--pictures", flags.pictures,
             "Draw the first N queries beside the mesh seen from their poses");
  output.Add("--min-confidence", flags.min_confidence,
             "Queries whose pose is right with less than this\n"
             "probability count as not localized");
  AddMeshOnlyOptions(command, flags.mesh_only);
  AddFilterOptions(command, flags.filter);
  AddEstimatorOptions(command, flags.estimator);
  AddContinuousOptions(command, flags.continuous);
  AddJobOptions(command, flags.running,
                "Go on where a run of the same options and inputs was stopped or killed;\n"
                "it ends with the same bytes",
                "Begin anew in a folder where a former run was; else it is refused");
  AddRunOptions(command, flags.run);
  SetFooter(
      command,
      R"(Each query that is done is kept once its files are synced. SIGINT and SIGTERM finish the
queries in hand; the exit code then is 4, and 5 where a file cannot be written, as on a full
disk: --resume goes on. Shards may write to one folder, where the last one to end writes the
results, or to folders of their own for `raylift merge`. All shards learn the same of the
scene, which OUT/scene_calibration.json says: poses do not depend on how they are shared.
Examples:
  From photographs alone:
    raylift localize --model sfm --images photos --geometry mesh:scene.ply \
        --queries queries.txt --query-images photos --out result
  From a mesh and the queries alone:
    raylift localize --geometry mesh:scene.ply --queries queries.txt \
        --query-images photos --out result
  With features and matches made by hloc:
    raylift localize --model sfm --geometry mesh:scene.ply --queries queries.txt \
        --features features.h5 --matches matches.h5 --pairs pairs.txt --out result
  From a mesh without colors, and what is known of the queries' poses:
    raylift localize --geometry mesh:scene.ply --queries queries.txt \
        --query-images photos --priors priors.txt --align edges --out result
  How well do references, whose poses are known, localize each other?
    raylift localize --model sfm --images photos --geometry mesh:scene.ply \
        --leave-one-out --out result
    raylift evaluate --ground-truth sfm --poses result/poses.txt)");
}

void MeshOnlyFlags::Check() const {
  RequireAtLeast("--views", views, 1);
  RequirePositive("--view-eye-height", eye_height);
  if (!(clearance >= 0)) {
    throw OptionError("--view-clearance", FormatDouble(clearance), "must not be negative");
  }
}

RenderedReferenceOptions MeshOnlyFlags::Resolve(std::span<const Camera> queries,
                                                const std::filesystem::path& out) const {
  RenderedReferenceOptions options;
  options.out = out;
  options.kind = kind;
  options.views.camera = CameraLikeQueries(queries, size, fov_deg);
  options.views.count = views;
  options.estimate_up = !up_in_world;
  if (up_in_world) options.views.up_in_world = *up_in_world;
  options.views.clearance = clearance;
  options.inside.eye_height = eye_height;
  return options;
}

void ContinuousFlags::Check() const {
  const auto needs_continuous = [this](std::string_view option, bool given) {
    if (given && !enabled) throw OptionError(fmt::format("{} needs --continuous", option));
  };
  needs_continuous("--max-joined", max_joined.has_value());
  needs_continuous("--trust-joined", trust_joined);
  if (max_joined) RequireAtLeast("--max-joined", *max_joined, 0);
  gate.Validate();
}

JoinGateOptions ContinuousFlags::Gate() const {
  JoinGateOptions options = gate;
  options.needs_agreement = !join_any_difference;
  return options;
}

int ContinuousFlags::MaxJoined(int top_k) const {
  return std::min(max_joined.value_or(std::max(1, top_k / 2)), top_k);
}

std::vector<size_t> LocalizeFlags::Order(std::span<const Query> list,
                                         const ReferenceSet& set) const {
  if (times.empty()) return OrderByName(list);
  return OrderByTime(list, set.images, ReadTimes(times), times);
}

}  // namespace raylift
