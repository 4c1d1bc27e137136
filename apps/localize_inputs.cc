#include "apps/localize_inputs.h"

#include <algorithm>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "raylift/io/query_list.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/result_files.h"

namespace raylift {
namespace {

MatchingOptions MatchingOf(const LocalizeFlags& flags, const ReferenceSet& references,
                           uint64_t seed) {
  MatchingOptions matching =
      flags.matching.Resolve(flags.geometry.specs, flags.QueryImages(), flags.out / "cache", seed,
                             flags.run, flags.QueriesAre());
  if (flags.continuous.enabled) matching.max_joined = flags.continuous.MaxJoined(matching.top_k);
  if (flags.leave_one_out && matching.retrieval) {
    matching.retrieval->prior_poses = PosesOf(references);
  }
  return matching;
}

// The first one that may look like the photographs.
std::shared_ptr<const RayCaster> PicturedSurface(const Scene& scene) {
  for (const SceneSource& source : scene.sources) {
    const GeometryKind kind = source.geometry.kind;
    const bool is_pictured = kind == GeometryKind::kMesh || kind == GeometryKind::kSplats;
    if (const auto surface = source.geometry.Surface(); is_pictured && surface) return surface;
  }
  return nullptr;
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

Scene OpenSceneOf(const LocalizeFlags& flags, std::span<const Query> queries) {
  if (!flags.RendersReferences()) {
    return OpenScene({.model = flags.references.model,
                      .model_poses = flags.model_poses,
                      .thinning = flags.references.thinning,
                      .images = flags.images,
                      .geometry = flags.geometry.specs,
                      .threads = flags.run.threads});
  }
  std::vector<Camera> cameras;
  for (const Query& query : queries) cameras.push_back(query.camera);
  RenderedReferenceOptions rendering = flags.mesh_only.Resolve(cameras, flags.out / "references");
  rendering.threads = flags.run.threads;
  Scene scene = RenderSceneWithProgress(flags.geometry.specs.front(), flags.references.thinning,
                                        rendering, flags.run.Show());
  if (!flags.run.quiet) {
    const RenderedReferences& rendered = *scene.rendered;
    fmt::print("references: {} views of the mesh ({}), {} rendered now: {}\n", rendered.count,
               ToString(rendered.kind), rendered.rendered, rendered.images.string());
  }
  return scene;
}

}  // namespace

LocalizeInputs OpenLocalizeInputs(const LocalizeFlags& flags) {
  LocalizeInputs inputs;
  if (!flags.leave_one_out) inputs.queries = ReadQueryList(flags.queries, flags.QueryImages());
  inputs.scene = OpenSceneOf(flags, inputs.queries);
  if (flags.leave_one_out) inputs.queries = QueriesOf(inputs.scene.references);
  if (!flags.priors.empty()) TakePosePriors(flags.priors, inputs.queries);
  if (!flags.rigs.empty()) TakeRigs(flags.rigs, inputs.queries);
  return inputs;
}

FeatureCount PrepareFeatures(const LocalizeFlags& flags, const LocalizeInputs& inputs,
                             uint64_t seed) {
  return PrepareMatches(inputs.scene, inputs.queries,
                        MatchingOf(flags, inputs.scene.references, seed), flags.running.Resolve());
}

std::unique_ptr<BatchLocalizer> OpenLocalizer(const LocalizeFlags& flags, const Scene& scene,
                                              std::span<const Query> queries,
                                              BatchOptions options) {
  auto matches = OpenMatches(scene, queries,
                             MatchingOf(flags, scene.references, options.localizer.estimator.seed));
  options.rerenderer = RerendererOf(flags, scene, options.localizer.estimator);
  auto localizer = std::make_unique<BatchLocalizer>(
      scene, std::vector<Query>(queries.begin(), queries.end()), std::move(matches), options);
  const auto& sources = localizer->scene().sources;
  if (std::any_of(sources.begin(), sources.end(), [](const SceneSource& source) {
        return source.alignment && source.alignment->mode != AlignMode::kOff;
      })) {
    WriteAlignment(flags.out / "depth_alignment.jsonl", sources);
  }
  return localizer;
}

}  // namespace raylift
