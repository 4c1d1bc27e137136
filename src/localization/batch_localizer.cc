#include "raylift/localization/batch_localizer.h"

#include <optional>
#include <utility>

#include "raylift/base/parallel.h"
#include "raylift/localization/grid_localizer.h"
#include "raylift/localization/scene_matches.h"

namespace raylift {

BatchLocalizer::BatchLocalizer(const Scene& scene, std::vector<Query> queries,
                               std::shared_ptr<MatchSource> matches, const BatchOptions& options)
    : options_(options),
      queries_(std::move(queries)),
      matches_(std::move(matches)),
      doctor_(queries_),
      run_check_(queries_) {
  std::vector<ReferenceMatch> reference_matches;
  if (options.align != AlignMode::kOff) {
    reference_matches =
        CollectReferenceMatches(queries_, *matches_, scene.references, options.threads);
  }
  scene_ = std::make_shared<const Scene>(
      Aligned(scene, options.align, reference_matches, options.threads));
  LocalizerOptions& localizer = options_.localizer;
  if (!localizer.filter.scene_noise) {
    localizer.filter.scene_noise =
        EstimateSceneNoise(queries_, *scene_, *matches_, localizer, options.threads);
  }
}

std::vector<LocalizedQuery> BatchLocalizer::LocalizeAll(const OnResult& on_result) {
  GridLocalizer::Matched matched(queries_.size());
  const GridLocalizer grid = GridLocalizer({Localizer(scene_, matches_, options_.localizer)})
                                 .WithSceneNoise(queries_, matched, options_.threads);
  const Localizer& localizer = grid.way(0);
  scene_noise_ = localizer.options().estimator.scene_noise;
  std::vector<LocalizedQuery> localized(queries_.size());
  ParallelFor(queries_.size(), options_.threads, [&](size_t i) {
    QueryResult result = localizer.Finish(matched[i] ? *std::exchange(matched[i], std::nullopt)
                                                     : localizer.Match(queries_[i]));
    Complete(i, localizer, result);
    if (on_result) on_result(i, result);
    localized[i] = std::move(result.localized);
  });
  return localized;
}

ContinuousRecords BatchLocalizer::LocalizeContinuously(const Continuous& continuous) {
  GrowingScene growing(*scene_, matches_, options_.localizer, continuous.weigh);
  return raylift::LocalizeContinuously(
      queries_, continuous.order, growing, continuous.checkpoint,
      {.gate = continuous.gate, .threads = options_.threads, .stop = continuous.stop},
      {.on_localized = [&](size_t i,
                           QueryResult& result) { Complete(i, growing.localizer(), result); },
       .on_done = continuous.on_done});
}

void BatchLocalizer::Complete(size_t query, const Localizer& localizer, QueryResult& result) {
  if (options_.check_input && doctor_.Wants(query)) {
    doctor_.Add(query, result.problem.references, result.problem.matches_2d2d);
  }
  if (options_.rerenderer != nullptr) {
    options_.rerenderer->Improve(queries_[query], localizer.estimator(), result,
                                 localizer.options().min_confidence);
  }
  if (options_.check_input) run_check_.Add(query, result);
}

std::vector<std::string> BatchLocalizer::Warnings() const {
  std::vector<std::string> warnings = matches_->Warnings();
  if (!options_.check_input) return warnings;
  for (const SceneSource& source : scene_->sources) {
    if (auto warning = doctor_.Warn(source.geometry, scene_->references, scene_->model_poses,
                                    options_.threads)) {
      warnings.push_back(std::move(*warning));
    }
  }
  const EstimatorOptions& estimator = options_.localizer.estimator;
  if (UsesPoints(estimator.method) && !scene_->sources.empty()) {
    if (auto warning = run_check_.WarnOfGeometry()) warnings.push_back(std::move(*warning));
  }
  if (auto warning = run_check_.WarnOfFocalLength(estimator, options_.threads)) {
    warnings.push_back(std::move(*warning));
  }
  return warnings;
}

}  // namespace raylift
