#include "localization/batch_localizer.h"

#include <algorithm>
#include <map>
#include <numeric>
#include <optional>
#include <set>
#include <utility>

#include "localization/cached_matches.h"
#include "localization/grid_localizer.h"
#include "localization/scene_matches.h"

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

AlignMode AlignModeOf(const Scene& scene, const BatchOptions& options) {
  const LocalizerOptions& localizer = options.localizer;
  if (options.align != AlignMode::kAuto) return options.align;
  const bool is_of_use = Uses2D3D(localizer.estimator.method) &&
                         localizer.estimator.refinement == Refinement::kRobust &&
                         localizer.candidates.mode != CandidateMode::kTriangulate &&
                         !scene.rendered && !scene.sources.empty();
  return is_of_use ? AlignMode::kAuto : AlignMode::kOff;
}

}  // namespace

BatchLocalizer::BatchLocalizer(const Scene& scene, std::vector<Query> queries,
                               std::shared_ptr<MatchSource> matches, const BatchOptions& options)
    : options_(options),
      queries_(std::move(queries)),
      matches_(std::move(matches)),
      cached_(matches_),
      as_read_(scene.sources),
      doctor_(queries_),
      focal_check_(queries_, options.localizer.estimator),
      log_focal_factors_(queries_.size()),
      matched_(queries_.size()),
      knowledge_(options.knowledge) {
  const AlignMode align = AlignModeOf(scene, options);
  std::vector<ReferenceMatch> reference_matches;
  if (align != AlignMode::kOff) {
    constexpr size_t kQueriesOfAuto = 500;
    std::vector<Query> asked;
    const size_t most = align == AlignMode::kAuto ? kQueriesOfAuto : queries_.size();
    for (const size_t query : SampleByName(queries_, most)) asked.push_back(queries_[query]);
    cached_ = std::make_shared<CachedMatches>(matches_);
    reference_matches = CollectReferenceMatches(asked, *cached_, scene.references, options.threads);
  }
  scene_ = std::make_shared<const Scene>(Aligned(scene, align, reference_matches, options.threads));
  LocalizerOptions& localizer = options_.localizer;
  if (knowledge_) {
    localizer.filter.scene_noise = knowledge_->geometry_noise;
    localizer.estimator.scene_noise = knowledge_->scene_noise;
  } else if (!localizer.filter.scene_noise) {
    localizer.filter.scene_noise =
        EstimateSceneNoise(queries_, *scene_, *cached_, localizer, options.threads);
  }
}

const SceneKnowledge& BatchLocalizer::Learn() {
  if (knowledge_) return *knowledge_;
  const GridLocalizer grid = GridLocalizer({Localizer(scene_, cached_, options_.localizer)})
                                 .WithSceneNoise(queries_, matched_, options_.threads);
  const LocalizerOptions& learned = grid.way(0).options();
  SceneKnowledge knowledge{.geometry_noise = learned.filter.scene_noise,
                           .scene_noise = learned.estimator.scene_noise,
                           .warnings = {}};
  if (options_.check_input) {
    ParallelFor(queries_.size(), options_.threads, [&](size_t i) {
      if (!doctor_.Wants(i)) return;
      if (!matched_[i]) matched_[i] = grid.way(0).Match(queries_[i]);
      doctor_.Add(i, matched_[i]->problem.references, matched_[i]->problem.matches_2d2d);
    });
    knowledge.warnings = DoctorWarnings();
  }
  options_.localizer = learned;
  knowledge_ = std::move(knowledge);
  return *knowledge_;
}

std::vector<LocalizedQuery> BatchLocalizer::LocalizeAll(const OnResult& on_result) {
  std::vector<size_t> all(queries_.size());
  std::iota(all.begin(), all.end(), size_t{0});
  std::vector<LocalizedQuery> localized(queries_.size());
  Localize(all, [&](size_t i, const QueryResult& result) {
    if (on_result) on_result(i, result);
    localized[i] = result.localized;
  });
  return localized;
}

void BatchLocalizer::Localize(std::span<const size_t> queries, const OnResult& on_result,
                              const std::atomic<bool>* stop) {
  Learn();
  const Localizer localizer(scene_, cached_, options_.localizer);
  const std::set<size_t> asked(queries.begin(), queries.end());
  const std::vector<Frame> frames = FramesOf(queries);
  ParallelFor(frames.size(), options_.threads, [&](size_t i) {
    if (stop != nullptr && *stop) return;
    std::vector<QueryResult> results = LocalizeFrame(frames[i], localizer);
    for (size_t k = 0; k < results.size(); ++k) {
      const size_t query = frames[i][k];
      if (!asked.contains(query)) continue;
      Complete(query, localizer, results[k]);
      on_result(query, results[k]);
    }
  });
}

std::vector<BatchLocalizer::Frame> BatchLocalizer::FramesOf(std::span<const size_t> queries) const {
  std::map<std::string, Frame> rigs;
  for (size_t i = 0; i < queries_.size(); ++i) {
    if (queries_[i].rig) rigs[queries_[i].rig->frame].push_back(i);
  }
  for (auto& [name, frame] : rigs) {
    std::stable_sort(frame.begin(), frame.end(), [&](size_t a, size_t b) {
      return queries_[a].rig->sensor < queries_[b].rig->sensor;
    });
  }
  std::vector<Frame> frames;
  for (const size_t query : queries) {
    if (!queries_[query].rig) {
      frames.push_back({query});
    } else if (const auto rig = rigs.find(queries_[query].rig->frame); rig != rigs.end()) {
      frames.push_back(std::move(rig->second));
      rigs.erase(rig);
    }
  }
  return frames;
}

std::vector<QueryResult> BatchLocalizer::LocalizeFrame(const Frame& frame,
                                                       const Localizer& localizer) {
  std::vector<QueryResult> results;
  for (const size_t query : frame) {
    results.push_back(matched_[query] ? *std::exchange(matched_[query], std::nullopt)
                                      : localizer.Match(queries_[query]));
    localizer.Lift(results.back());
    localizer.Filter(results.back());
  }
  if (frame.size() == 1) {
    localizer.Estimate(results.front());
    return results;
  }
  std::vector<Rigid3> cam_from_rig;
  for (const size_t query : frame) cam_from_rig.push_back(queries_[query].rig->cam_from_rig);
  localizer.EstimateRig(results, cam_from_rig);
  return results;
}

ContinuousRecords BatchLocalizer::LocalizeContinuously(const Continuous& continuous) {
  GrowingScene growing(*scene_, matches_, options_.localizer, continuous.weigh);
  return raylift::LocalizeContinuously(
      queries_, continuous.order, growing, continuous.checkpoint,
      {.gate = continuous.gate, .threads = options_.threads, .stop = continuous.stop},
      {.on_localized =
           [&](size_t i, QueryResult& result) {
             if (options_.check_input && doctor_.Wants(i)) {
               doctor_.Add(i, result.problem.references, result.problem.matches_2d2d);
             }
             Complete(i, growing.localizer(), result);
           },
       .on_done = continuous.on_done});
}

void BatchLocalizer::Complete(size_t query, const Localizer& localizer, QueryResult& result) {
  if (options_.rerenderer != nullptr) {
    options_.rerenderer->Improve(queries_[query], localizer.estimator(), result,
                                 localizer.options().min_confidence);
  }
  if (options_.check_input) log_focal_factors_[query] = focal_check_.LogFactor(query, result);
}

std::vector<std::string> BatchLocalizer::MatchWarnings() const {
  std::vector<std::string> warnings = matches_->Warnings();
  std::sort(warnings.begin(), warnings.end());
  return warnings;
}

std::vector<std::string> BatchLocalizer::DoctorWarnings() const {
  std::vector<std::string> warnings;
  for (const SceneSource& source : as_read_) {
    if (auto warning = doctor_.Warn(source.geometry, scene_->references, scene_->model_poses,
                                    options_.threads)) {
      warnings.push_back(std::move(*warning));
    }
  }
  return warnings;
}

bool BatchLocalizer::ChecksGeometry() const {
  return options_.check_input && Uses2D3D(options_.localizer.estimator.method) &&
         !scene_->sources.empty();
}

std::vector<std::string> BatchLocalizer::ContinuousWarnings(
    std::span<const LocalizedQuery> localized) const {
  std::vector<std::string> warnings = MatchWarnings();
  if (!options_.check_input) return warnings;
  std::vector<double> log_focal_factors;
  for (const auto& factor : log_focal_factors_) {
    if (factor) log_focal_factors.push_back(*factor);
  }
  for (const auto& more :
       {DoctorWarnings(), RunWarnings(localized, log_focal_factors, ChecksGeometry())}) {
    warnings.insert(warnings.end(), more.begin(), more.end());
  }
  return warnings;
}

}  // namespace raylift
