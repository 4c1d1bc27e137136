#include "apps/localize_inputs.h"

#include <algorithm>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "base/progress.h"
#include "lifting/alignment_text.h"
#include "lifting/mesh_spec.h"
#include "localization/alignment/edge_aligner.h"
#include "localization/checks/run_checks.h"
#include "localization/rerender.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/geometry/geodesy.h"
#include "raylift/io/pose_priors.h"
#include "raylift/io/query_list.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/result_files.h"
#include "raylift/localization/scene_calibration.h"

namespace raylift {
namespace {

// Returns the folder of the cache; empty where nothing is written.
std::filesystem::path CacheBeside(const std::filesystem::path& out) {
  return out.empty() ? std::filesystem::path() : out / "cache";
}

MatchingOptions MatchingOf(const LocalizeFlags& flags, const ReferenceSet& references,
                           uint64_t seed) {
  MatchingOptions matching =
      flags.matching.Resolve(flags.geometry.specs, flags.QueryImages(), CacheBeside(flags.out),
                             seed, flags.run, flags.QueriesAre());
  if (flags.continuous.enabled) matching.max_joined = flags.continuous.MaxJoined(matching.top_k);
  if (flags.leave_one_out && matching.retrieval) {
    matching.retrieval->prior_poses = PosesOf(references);
  }
  return matching;
}

std::shared_ptr<const Rerenderer> RerendererOf(const LocalizeFlags& flags, const Scene& scene,
                                               const EstimatorOptions& estimator) {
  if (flags.mesh_only.rerender == 0) return nullptr;
  const auto surface = PicturedSurface(scene);
  return std::make_shared<const Rerenderer>(
      surface, ColorsLikePhotographs(*surface), flags.QueryImages(),
      RerenderOptions{.rounds = flags.mesh_only.rerender,
                      .use_pairs = Scores2D2DAlone(estimator.method),
                      .max_features = flags.matching.front_end.max_features,
                      .reprojection_threshold_px = estimator.reprojection_threshold_px});
}

// Renders the references of a scene, and says on stderr how far it is.
Scene RenderSceneWithProgress(const std::string& mesh_spec, const Subsampling& subsampling,
                              const RenderedReferenceOptions& options, Progress::Show show) {
  std::optional<Progress> progress;
  const RenderHooks hooks{
      .on_start = [&](size_t images, size_t) { progress.emplace("views", images, show); },
      .on_image = [&](const RenderedImage&) { progress->Advance(); }};
  return OpenMeshScene(mesh_spec, subsampling, options, hooks);
}

// Warns how far apart a point of the world is in both systems, where that is more than they may
// differ by for one place; where one of them knows no heights, heights are not compared.
std::optional<std::string> WarnOfPlace(const WorldFrame& world, const WorldFrame& of_file,
                                       const std::string& spec, const Eigen::Vector3d& point) {
  constexpr double kSamePlace = 1;
  const std::string what = fmt::format("the world's coordinates are {}, but those of {} are {}",
                                       world.text, spec, of_file.text);
  try {
    const CrsTransform transform(of_file.crs, world.crs);
    Eigen::Vector3d between = transform(of_file.origin + point) - (world.origin + point);
    if (of_file.crs.has_heights() != world.crs.has_heights()) between.z() = 0;
    if (between.norm() <= kSamePlace) return std::nullopt;
    return fmt::format("{}: a place there is {:.0f} units away", what, between.norm());
  } catch (const InputError& error) {
    return fmt::format("{}: {}", what, error.what());
  }
}

// Says why the references cannot be in the system of a mesh's file.
std::optional<std::string> WarnOfReferences(const WorldFrame& of_file, const Scene& scene) {
  if (scene.references.images.empty()) return std::nullopt;
  const PosedImage& image = scene.references.images.front();
  try {
    of_file.crs.Check(of_file.origin + image.cam_from_world.OriginInSource());
    return std::nullopt;
  } catch (const InputError& error) {
    return fmt::format("a mesh's file names {}, where reference {} is not: {}", of_file.text,
                       image.name, error.what());
  }
}

// Returns the specifications of tilesets that could be converted to the system, but stay around a
// center of their own.
std::vector<std::string> LeftAlone(const Scene& scene, const WorldFrame& world) {
  std::vector<std::string> left;
  for (const SceneSource& source : scene.sources) {
    if (InWorld({source.spec}, world).front() != source.spec) left.push_back(source.spec);
  }
  return left;
}

// Opens a mesh that needs no references.
Scene OpenMeshAlone(const LocalizeFlags& flags) {
  Scene scene;
  OpenGeometry(scene, flags.geometry.specs.front(), {.threads = flags.run.threads});
  return Calibrated(scene, std::make_shared<const SceneCalibration>());
}

// Throws InputError where nothing is known of a query's pose.
void RequirePosePriors(const LocalizeFlags& flags, std::span<const Query> queries) {
  for (const Query& query : queries) {
    if (query.priors.position && query.priors.orientation) continue;
    throw InputError(flags.priors,
                     fmt::format("expected a pose, or a position and an orientation, of each query "
                                 "for alignment by edges, found none of \"{}\"",
                                 query.name));
  }
}

class NoMatches final : public MatchSource {
 public:
  QueryMatches Match(const Query&) const override { return {}; }
  std::vector<std::string> Warnings() const override { return {}; }
};

std::unique_ptr<LocalizeAll> OpenEdgeLocalizer(const LocalizeFlags& flags, const Scene& scene,
                                               std::span<const Query> queries,
                                               const LocalizerOptions& options) {
  RequirePosePriors(flags, queries);
  const auto aligner = std::make_shared<const EdgeAligner>(
      PicturedSurface(scene), flags.QueryImages(), options.estimator.seed);
  const auto matches = std::make_shared<const NoMatches>();
  std::vector<Localizer> localizers;
  localizers.emplace_back(std::make_shared<const Scene>(scene), matches, options, aligner);
  return std::make_unique<LocalizeAll>(std::move(localizers),
                                       std::vector<Query>(queries.begin(), queries.end()), matches,
                                       flags.run.threads);
}

}  // namespace

Scene OpenSceneOf(const LocalizeFlags& flags, std::span<const Query> queries) {
  if (flags.AlignsEdges()) return OpenMeshAlone(flags);
  if (!flags.RendersReferences()) {
    return OpenScene(flags.references.Scene(flags.images, flags.geometry.specs, flags.run.threads));
  }
  std::vector<Camera> cameras;
  for (const Query& query : queries) cameras.push_back(query.camera);
  RenderedReferenceOptions rendering = flags.mesh_only.Resolve(cameras, flags.out / "references");
  rendering.threads = flags.run.threads;
  Scene scene = RenderSceneWithProgress(flags.geometry.specs.front(), flags.references.subsampling,
                                        rendering, flags.run.Show());
  if (!flags.run.quiet) {
    const RenderedReferences& rendered = *scene.rendered;
    fmt::print("references: {} views of the mesh ({}), {} rendered now: {}\n", rendered.count,
               ToString(rendered.kind), rendered.rendered, rendered.images.string());
  }
  return scene;
}

std::optional<WorldFrame> WorldOf(const std::optional<WorldFrame>& given, Scene& scene) {
  std::optional<WorldFrame> world = given;
  for (const SceneSource& source : scene.sources) {
    const auto& caster = source.geometry.mesh;
    if (caster == nullptr || caster->mesh().crs.empty()) continue;
    WorldFrame of_file = WorldFrame::Parse(caster->mesh().crs);
    of_file.is_of_file = true;
    std::optional<std::string> warning;
    if (world) {
      warning = WarnOfPlace(*world, of_file, source.spec, caster->mesh().origin_in_world);
    } else if (const auto left = LeftAlone(scene, of_file); !left.empty()) {
      warning =
          fmt::format("{} is around a center of its own, {} in {}: crs= or --crs leads it there",
                      left.front(), source.spec, of_file.text);
    } else {
      warning = WarnOfReferences(of_file, scene);
      if (!warning) world = std::move(of_file);
    }
    if (warning) scene.warnings.push_back(std::move(*warning));
  }
  return world;
}

Scene WithKnownCalibration(const LocalizeFlags& flags, Scene scene) {
  if (flags.references.HaveFeatures() && scene.calibration != nullptr &&
      flags.geometry.align != AlignMode::kAuto) {
    throw OptionError("--align-depth does not go with a packed map whose calibration says it");
  }
  if (flags.scene_calibration.empty()) return scene;
  const auto calibration = ReadSceneCalibration(flags.scene_calibration);
  try {
    return Calibrated(scene, calibration);
  } catch (const InputError& error) {
    throw InputError(flags.scene_calibration, error.what());
  }
}

std::shared_ptr<const RayCaster> PicturedSurface(const Scene& scene) {
  for (const SceneSource& source : scene.sources) {
    const GeometryKind kind = source.geometry.kind;
    const bool is_pictured = kind == GeometryKind::kMesh || kind == GeometryKind::kSplats;
    if (const auto surface = source.geometry.Surface(); is_pictured && surface) return surface;
  }
  return nullptr;
}

LocalizeInputs OpenLocalizeInputs(const LocalizeFlags& flags) {
  LocalizeInputs inputs;
  if (!flags.leave_one_out) inputs.queries = ReadQueryList(flags.queries, flags.QueryImages());
  inputs.scene = OpenSceneOf(flags, inputs.queries);
  if (flags.leave_one_out) inputs.queries = QueriesOf(inputs.scene.references);
  inputs.scene = WithKnownCalibration(flags, std::move(inputs.scene));
  inputs.world = WorldOf(flags.world, inputs.scene);
  if (flags.PriorsOfPhotographs() && !inputs.world) {
    throw OptionError(
        "--priors", "exif",
        "needs --crs, what the world's coordinates are: the geometry does not say it");
  }
  if (!flags.priors.empty()) {
    const std::vector<std::string> warnings =
        flags.PriorsOfPhotographs()
            ? TakePhotographPriors(flags.QueryImages(), *inputs.world, inputs.queries)
            : TakePosePriors(flags.priors, inputs.queries, inputs.world);
    inputs.scene.warnings.insert(inputs.scene.warnings.end(), warnings.begin(), warnings.end());
  }
  const auto has_range = [](const Query& query) { return query.priors.range.has_value(); };
  const bool uses_ranges = inputs.scene.Surface() != nullptr && !flags.AlignsEdges();
  if (std::ranges::any_of(inputs.queries, has_range) && !uses_ranges) {
    inputs.scene.warnings.emplace_back(
        "--priors: ranges say nothing to --align edges, nor where no --geometry is a mesh, surface "
        "model, cloud or splats");
  }
  if (!flags.rigs.empty()) TakeRigs(flags.rigs, inputs.queries);
  if (auto warning = WarnOfAssumedLenses(inputs.queries)) {
    inputs.scene.warnings.push_back(std::move(*warning));
  }
  return inputs;
}

FeatureCount PrepareFeatures(const LocalizeFlags& flags, const LocalizeInputs& inputs,
                             uint64_t seed) {
  return PrepareMatches(inputs.scene, inputs.queries,
                        MatchingOf(flags, inputs.scene.references, seed), flags.running.Resolve());
}

std::unique_ptr<MatchSource> OpenMatchesOf(const LocalizeFlags& flags, const Scene& scene,
                                           std::span<const Query> queries, uint64_t seed) {
  return OpenMatches(scene, queries, MatchingOf(flags, scene.references, seed));
}

std::unique_ptr<LocalizeAll> OpenLocalizer(const LocalizeFlags& flags, const Scene& scene,
                                           std::span<const Query> queries,
                                           LocalizeAllOptions options) {
  if (flags.AlignsEdges()) return OpenEdgeLocalizer(flags, scene, queries, options.localizer);
  options.rerenderer = RerendererOf(flags, scene, options.localizer.estimator);
  return std::make_unique<LocalizeAll>(
      scene, std::vector<Query>(queries.begin(), queries.end()),
      OpenMatchesOf(flags, scene, queries, options.localizer.estimator.seed), options);
}

std::vector<std::string> WriteCalibration(const LocalizeFlags& flags, const Scene& scene,
                                          const EstimatorOptions& estimator) {
  WriteSceneCalibration(flags.out / "scene_calibration.json", *scene.calibration);
  if (std::any_of(scene.sources.begin(), scene.sources.end(), [](const SceneSource& source) {
        return source.alignment && source.alignment->mode != AlignMode::kOff;
      })) {
    WriteAlignment(flags.out / "depth_alignment.jsonl", scene.sources);
  }
  if (scene.rendered == nullptr || scene.calibration->match_noise || !UsesSceneNoise(estimator)) {
    return {};
  }
  return {
      "rendered references do not tell how noisy matches with photographs are: `raylift calibrate` "
      "learns it from some queries, for --scene-calibration"};
}

std::vector<std::string> InputOrDepthWarnings(const LocalizeFlags& flags,
                                              std::vector<std::string> of_input,
                                              const Scene& scene) {
  if (flags.no_doctor || !of_input.empty()) return of_input;
  std::vector<std::string> warnings;
  for (const SceneSource& source : scene.sources) {
    const auto warning = source.alignment ? WarnOfFactors(*source.alignment) : std::nullopt;
    if (warning) warnings.push_back(fmt::format("{}: {}", source.spec, *warning));
  }
  return warnings;
}

}  // namespace raylift
