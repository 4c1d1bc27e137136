#include "localize_run.h"

#include <algorithm>
#include <chrono>
#include <memory>
#include <optional>

#include "interrupt.h"
#include "localize_output.h"
#include <fmt/format.h>

#include "raylift/base/progress.h"
#include "raylift/io/pose_prior_list.h"
#include "raylift/io/query_list.h"
#include "raylift/localization/batch_localizer.h"
#include "raylift/localization/localized_model.h"
#include "raylift/localization/matching.h"
#include "raylift/localization/result_files.h"

namespace raylift {
namespace {

// The references, from a model or from the mesh alone.
Scene OpenSceneOf(const LocalizeFlags& flags, std::span<const Query> queries) {
  if (!flags.RendersReferences()) {
    return OpenScene({.model = flags.references.model,
                      .model_poses = flags.model_poses.Resolve(),
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

MatchingOptions MatchingOf(const LocalizeFlags& flags, uint64_t seed) {
  MatchingOptions matching = flags.matching.Resolve(flags.geometry.specs, flags.QueryImages(),
                                                    flags.out / "cache", seed, flags.run);
  if (flags.continuous.enabled) matching.max_joined = flags.continuous.MaxJoined(matching.top_k);
  return matching;
}

std::shared_ptr<const Rerenderer> RerendererOf(const LocalizeFlags& flags, const Scene& scene,
                                               const EstimatorOptions& estimator) {
  if (flags.mesh_only.rerender == 0) return nullptr;
  const auto mesh = scene.Mesh();
  return std::make_shared<const Rerenderer>(
      mesh, ColorsLikePhotographs(mesh->mesh()), flags.QueryImages(),
      RerenderOptions{.rounds = flags.mesh_only.rerender,
                      .use_pairs = ScoresPairsAlone(estimator.method),
                      .max_features = flags.matching.front_end.max_features,
                      .reprojection_threshold_px = estimator.reprojection_threshold_px});
}

// Also writes queries.jsonl, whose lines say which queries joined the references.
ContinuousRecords LocalizeInOrder(const LocalizeFlags& flags, BatchLocalizer& localizer,
                                  LocalizeOutput& output, const std::string& options_json) {
  const ReferenceSet& references = localizer.scene().references;
  const std::vector<size_t> order = flags.continuous.Order(localizer.queries(), references);
  const ContinuousCheckpoint checkpoint(
      flags.out / "continuous",
      ContinuousRunKey(options_json, references, localizer.queries(), order),
      flags.continuous.resume);
  const SignalGuard signals;
  Progress progress("queries", order.size(), flags.run.Show());
  ContinuousRecords records =
      localizer.LocalizeContinuously({.order = order,
                                      .checkpoint = checkpoint,
                                      .gate = flags.continuous.Gate(),
                                      .weigh = !flags.continuous.trust_joined,
                                      .stop = &SignalGuard::stop(),
                                      .on_done = [&](size_t i, const QueryResult* result) {
                                        if (result != nullptr) output.Show(i, *result);
                                        progress.Advance();
                                      }});
  if (const size_t left = CountMissing(records); left > 0) {
    throw Interrupted(
        fmt::format("stopped by a signal with {} queries left; --resume goes on", left));
  }
  WriteQueryDiagnostics(flags.out / "queries.jsonl", records);
  return records;
}

}  // namespace

void RunLocalize(const LocalizeFlags& flags, const LocalizerOptions& options, AlignMode align,
                 const std::string& options_json) {
  std::vector<Query> queries = ReadQueryList(flags.queries);
  if (!flags.priors.empty()) TakePosePriors(flags.priors, queries);
  const Scene scene = OpenSceneOf(flags, queries);
  std::vector<std::string> warnings = scene.warnings;
  if (options.candidates.mode == CandidateMode::kTriangulate && !scene.sources.empty()) {
    warnings.emplace_back(
        "--candidates triangulate lifts nothing: --geometry is not used for points");
  }
  LocalizeOutput output(flags, queries.size(), scene.Surface());
  BatchLocalizer localizer(scene, queries,
                           OpenMatches(scene, queries, MatchingOf(flags, options.estimator.seed)),
                           {.localizer = options,
                            .align = align,
                            .rerenderer = RerendererOf(flags, scene, options.estimator),
                            .check_input = !flags.no_doctor,
                            .threads = flags.run.threads});
  if (align != AlignMode::kOff) {
    WriteAlignment(flags.out / "depth_alignment.jsonl", localizer.scene().sources);
  }
  const auto start = std::chrono::steady_clock::now();
  std::vector<LocalizedQuery> localized;
  size_t joined = 0;
  if (flags.continuous.enabled) {
    for (auto& record : LocalizeInOrder(flags, localizer, output, options_json)) {
      joined += record->joined ? 1 : 0;
      localized.push_back(std::move(record->localized));
    }
  } else {
    Progress progress("queries", queries.size(), flags.run.Show());
    localized = localizer.LocalizeAll([&](size_t i, const QueryResult& result) {
      output.Show(i, result);
      progress.Advance();
    });
    WriteQueryDiagnostics(flags.out / "queries.jsonl", localized);
  }
  for (std::string& warning : localizer.Warnings()) warnings.push_back(std::move(warning));
  PrintWarnings(warnings);
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
  output.Finish(localized,
                {localizer.scene(), warnings, localizer.scene_noise(), elapsed.count(), joined},
                options_json);
  if (!flags.write_model.empty()) {
    WriteColmapModel(flags.write_model,
                     LocalizedModel(localizer.scene().references, queries, localized),
                     ColmapForm::kBinary);
  }
}

}  // namespace raylift
