#include "raylift/localization/localize_all.h"

#include <algorithm>
#include <map>
#include <numeric>
#include <set>
#include <utility>

#include "localization/calibration_images.h"
#include "localization/checks/run_checks.h"
#include "localization/continuous/continuous_localizer.h"
#include "localization/localize_near.h"
#include "localization/rerender.h"

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/localization/scene_calibration.h"

namespace raylift {
namespace {

std::vector<size_t> FirstIndices(size_t count) {
  std::vector<size_t> all(count);
  std::iota(all.begin(), all.end(), size_t{0});
  return all;
}

}  // namespace

LocalizeAll::LocalizeAll(const Scene& scene, std::vector<Query> queries,
                         std::shared_ptr<MatchSource> matches, const LocalizeAllOptions& options)
    : options_(options),
      queries_(std::move(queries)),
      matches_(std::move(matches)),
      cached_(std::make_shared<CachedMatches>(matches_)),
      doctor_(std::make_unique<QuickDoctor>(queries_)),
      focal_check_(std::make_unique<FocalCheck>(queries_, options.localizer.estimator)),
      log_focal_factors_(queries_.size()) {
  configurations_.emplace_back(std::make_shared<const Scene>(scene), cached_, options_.localizer);
  MakeTree();
}

LocalizeAll::LocalizeAll(std::vector<Localizer> configurations, std::vector<Query> queries,
                         std::shared_ptr<const MatchSource> matches, int threads)
    : options_{.check_input = false, .threads = threads},
      queries_(std::move(queries)),
      cached_(std::move(matches)),
      configurations_(std::move(configurations)),
      log_focal_factors_(queries_.size()) {
  RAYLIFT_CHECK(!configurations_.empty());
  MakeTree();
}

LocalizeAll::~LocalizeAll() = default;

void LocalizeAll::MakeTree() {
  for (size_t i = 0; i < configurations_.size(); ++i) {
    const Localizer& localizer = configurations_[i];
    auto lifted = std::find_if(tree_.begin(), tree_.end(), [&](const Lifted& alike) {
      return localizer.LiftsAlike(configurations_[alike.front().front()]);
    });
    if (lifted == tree_.end()) lifted = tree_.insert(tree_.end(), Lifted{});
    auto filtered = std::find_if(lifted->begin(), lifted->end(), [&](const Filtered& alike) {
      return localizer.FiltersAlike(configurations_[alike.front()]);
    });
    if (filtered == lifted->end()) filtered = lifted->insert(lifted->end(), Filtered{});
    filtered->push_back(i);
  }
}

void LocalizeAll::Calibrate() {
  if (std::exchange(is_calibrated_, true)) return;
  if (focal_check_ == nullptr) return LearnMatchNoise();
  const CalibrationOptions learning{.localizer = options_.localizer,
                                    .align = options_.align,
                                    .queries_tell_match_noise = !options_.one_by_one,
                                    .threads = options_.threads};
  configurations_.front() = Localizer(
      std::make_shared<const Scene>(raylift::Calibrate(scene(), cached_, queries_, learning)),
      cached_, options_.localizer);
}

// Learns the match noise, unless fewer than three images tell it, or a configuration knows it or
// does not use it.
void LocalizeAll::LearnMatchNoise() {
  std::vector<size_t> learning;
  for (size_t i = 0; i < configurations_.size(); ++i) {
    if (configurations_[i].UsesSceneNoise()) learning.push_back(i);
  }
  const CalibrationImages images = ImagesToCalibrateBy(scene().references, cached_, queries_);
  const std::vector<size_t> sample = NoiseSample(images.images);
  if (learning.empty() || sample.size() < kLeastForCommonNoise) return;
  std::vector<std::vector<PoseEstimate>> found(configurations_.size(),
                                               std::vector<PoseEstimate>(sample.size()));
  ParallelFor(sample.size(), options_.threads, [&](size_t i) {
    const Query& image = images.images[sample[i]];
    LocalizeMatched(configurations_.front().Match(image, images.matches->Match(image)), learning, 1,
                    [&](size_t configuration, const QueryResult& result) {
                      found[configuration][i] = result.localized.estimate;
                    });
  });
  for (const size_t i : learning) {
    if (const auto noise = CommonNoise(found[i])) {
      configurations_[i] = configurations_[i].WithSceneNoise(*noise);
    }
  }
}

void LocalizeAll::LocalizeMatched(const QueryResult& matched,
                                  std::span<const size_t> configurations, int threads,
                                  const Take& take) const {
  const auto asked = [&](const Filtered& alike) {
    Filtered among;
    for (const size_t i : alike) {
      if (std::find(configurations.begin(), configurations.end(), i) != configurations.end()) {
        among.push_back(i);
      }
    }
    return among;
  };
  for (const Lifted& lift : tree_) {
    std::optional<QueryResult> lifted;
    for (const Filtered& filter : lift) {
      const Filtered among = asked(filter);
      if (among.empty()) continue;
      if (!lifted) {
        lifted = matched;
        configurations_[among.front()].Lift(*lifted);
      }
      QueryResult filtered = *lifted;
      configurations_[among.front()].Filter(filtered);
      ParallelFor(among.size(), threads, [&](size_t i) {
        QueryResult result = filtered;
        configurations_[among[i]].Estimate(result);
        take(among[i], result);
      });
    }
  }
}

void LocalizeAll::LocalizeQuery(size_t query, int threads, const Take& take) const {
  const Query& asked = queries_[query];
  LocalizeMatched(configurations_.front().Match(asked, cached_->Match(asked)),
                  FirstIndices(configurations_.size()), threads, take);
}

std::vector<LocalizedQuery> LocalizeAll::Run(const OnResult& on_result) {
  std::vector<LocalizedQuery> localized(queries_.size());
  Run(FirstIndices(queries_.size()), [&](size_t i, const QueryResult& result) {
    if (on_result) on_result(i, result);
    localized[i] = result.localized;
  });
  return localized;
}

void LocalizeAll::Run(std::span<const size_t> queries, const OnResult& on_result,
                      const std::atomic<bool>* stop) {
  Calibrate();
  const std::set<size_t> asked(queries.begin(), queries.end());
  const std::vector<Frame> frames = FramesOf(queries);
  ParallelFor(frames.size(), options_.threads, [&](size_t i) {
    if (stop != nullptr && *stop) return;
    std::vector<QueryResult> results = LocalizeFrame(frames[i]);
    for (size_t k = 0; k < results.size(); ++k) {
      const size_t query = frames[i][k];
      if (!asked.contains(query)) continue;
      Complete(query, results[k]);
      on_result(query, results[k]);
    }
  });
}

std::vector<LocalizeAll::Frame> LocalizeAll::FramesOf(std::span<const size_t> queries) const {
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

std::vector<QueryResult> LocalizeAll::LocalizeFrame(const Frame& frame) const {
  const Localizer& localizer = configurations_.front();
  std::vector<QueryResult> results;
  for (const size_t query : frame) {
    results.push_back(localizer.Match(queries_[query]));
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

void LocalizeAll::RunContinuously(ContinuousRun run) {
  RAYLIFT_CHECK(options_.one_by_one && matches_ != nullptr);
  Calibrate();
  run.threads = options_.threads;
  run.on_localized = [&](size_t i, QueryResult& result) { Complete(i, result); };
  LocalizeContinuously(queries_, scene(), matches_, options_.localizer, run);
}

LocalizedQuery LocalizeAll::LocalizeAgain(const Query& query, std::span<const size_t> references,
                                          const Rigid3& cam_from_world,
                                          const Eigen::Matrix<double, 6, 6>& covariance) const {
  std::vector<PosedImage> images;
  for (const size_t i : references) {
    // With --leave-one-out a query is a reference, too.
    if (scene().references.images[i].name != query.name) {
      images.push_back(scene().references.images[i]);
    }
  }
  QueryResult result =
      LocalizeNear({cam_from_world, covariance}, configurations_.front(), *cached_, query, images);
  Rerender(query, result);
  return std::move(result.localized);
}

void LocalizeAll::Rerender(const Query& query, QueryResult& result) const {
  if (options_.rerenderer == nullptr) return;
  const Localizer& localizer = configurations_.front();
  options_.rerenderer->Improve(query, localizer.estimator(), result,
                               localizer.options().min_confidence);
}

// Runs the stages after the pose.
void LocalizeAll::Complete(size_t query, QueryResult& result) {
  Rerender(queries_[query], result);
  if (options_.check_input) log_focal_factors_[query] = focal_check_->LogFactor(query, result);
}

std::vector<std::string> LocalizeAll::MatchWarnings() const {
  std::vector<std::string> warnings = cached_->Warnings();
  std::sort(warnings.begin(), warnings.end());
  return warnings;
}

std::vector<std::string> LocalizeAll::InputWarnings() {
  if (!options_.check_input) return {};
  ParallelFor(queries_.size(), options_.threads, [&](size_t i) {
    if (!doctor_->Wants(i)) return;
    const QueryMatches matches = cached_->Match(queries_[i]);
    doctor_->Add(i, matches.references, matches.matches);
  });
  return DoctorWarnings();
}

// Returns matches among the references. A few queries tell little of the references; the references
// themselves tell the rest.
std::vector<ReferenceMatch> LocalizeAll::MatchesAmongReferences() const {
  if (options_.one_by_one || scene().rendered != nullptr || !cached_->MatchesReferences())
    return {};
  const CalibrationImages images = ImagesToCalibrateBy(scene().references, cached_, {});
  std::vector<Query> asked;
  for (const size_t i : SampleByName(images.images, doctor_->NumMissing())) {
    asked.push_back(images.images[i]);
  }
  return CollectReferenceMatches(asked, *images.matches, scene().references, options_.threads);
}

// Runs the doctor on sources as they were read: their correction would hide a wrong reading.
std::vector<std::string> LocalizeAll::DoctorWarnings() const {
  std::vector<std::string> warnings;
  const std::vector<ReferenceMatch> more = MatchesAmongReferences();
  for (const SceneSource& source : scene().sources) {
    NamedGeometry geometry = source.geometry;
    if (source.as_read != nullptr) geometry.source = source.as_read;
    if (auto warning = doctor_->Warn(geometry, scene().references, more, scene().model_poses,
                                     options_.threads)) {
      warnings.push_back(std::move(*warning));
    }
  }
  return warnings;
}

bool LocalizeAll::ChecksGeometry() const {
  return options_.check_input && Uses2D3D(options_.localizer.estimator.method) &&
         !scene().sources.empty();
}

}  // namespace raylift
