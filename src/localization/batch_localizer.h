// All queries of a list against one scene: what is learned from the queries together (the depth's
// correction, the scene's noise, whether the input is read as it was meant) is learned first, then
// each is localized, and its result depends on no other query's. The continuous mode does not learn
// what matches are worth (SceneNoise), as its queries must not know of those that come later.

#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "localization/checks/run_checks.h"
#include "localization/continuous/continuous_localizer.h"
#include "localization/rerender.h"

#include "raylift/lifting/depth_alignment.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/scene.h"

namespace raylift {

// What some 30 queries tell of the others, the same ones whatever their order.
struct SceneKnowledge {
  std::optional<MultiViewNoise> geometry_noise;  // where the filter is automatic
  std::optional<SceneNoise> scene_noise;         // where the method uses it
  std::vector<std::string> warnings;             // of how the input is read (QuickDoctor)
};

struct BatchOptions {
  LocalizerOptions localizer = {};
  // As a run of the same queries and options has learned it. None: it is learned.
  std::optional<SceneKnowledge> knowledge = std::nullopt;
  // kAuto by some 500 queries, and off where it would change nothing that is known better: rendered
  // references, methods and candidates that use no depth, the paper's refinement.
  AlignMode align = AlignMode::kAuto;
  // Null: poses are not sharpened by rendering the mesh again.
  std::shared_ptr<const Rerenderer> rerenderer = nullptr;
  bool check_input = true;  // see QuickDoctor and run_check.h
  int threads = 0;
};

class BatchLocalizer {
 public:
  BatchLocalizer(const Scene& scene, std::vector<Query> queries,
                 std::shared_ptr<MatchSource> matches, const BatchOptions& options);

  // With the depth corrected as asked for; `alignment` of its sources says how.
  const Scene& scene() const { return *scene_; }
  const std::vector<Query>& queries() const { return queries_; }

  using OnResult = std::function<void(size_t query, const QueryResult& result)>;

  // Unless it is known. The others do it first, too.
  const SceneKnowledge& Learn();

  // In parallel; in the order of the list. `on_result` is called from any thread. Queries of one
  // frame of a rig (Query::rig) are localized together.
  std::vector<LocalizedQuery> LocalizeAll(const OnResult& on_result = {});
  // Some of them; a frame's photographs help each other even where some of them are not asked for.
  // With `stop`, those in hand are finished and no other is begun.
  void Localize(std::span<const size_t> queries, const OnResult& on_result,
                const std::atomic<bool>* stop = nullptr);

  // One after the other; localized queries join the references (continuous_localizer.h).
  struct Continuous {
    std::span<const size_t> order;
    const ContinuousCheckpoint& checkpoint;
    JoinGateOptions gate = {};
    bool weigh = true;
    const std::atomic<bool>* stop = nullptr;
    // `result` is null where an earlier run did the query.
    std::function<void(size_t query, const QueryResult* result)> on_done = {};
  };
  ContinuousRecords LocalizeContinuously(const Continuous& continuous);

  // What its photograph says of the query's focal length (FocalCheck), once it is localized.
  std::optional<double> LogFocalFactor(size_t query) const { return log_focal_factors_[query]; }

  // Of the matches that were made so far, sorted.
  std::vector<std::string> MatchWarnings() const;
  // Whether RunWarnings() is to judge the geometry.
  bool ChecksGeometry() const;
  // All of them, after LocalizeContinuously().
  std::vector<std::string> ContinuousWarnings(std::span<const LocalizedQuery> localized) const;

 private:
  // Queries that are localized together: the photographs of a frame, by their sensors, or one.
  using Frame = std::vector<size_t>;
  std::vector<Frame> FramesOf(std::span<const size_t> queries) const;
  std::vector<QueryResult> LocalizeFrame(const Frame& frame, const Localizer& localizer);

  // What comes after the pose.
  void Complete(size_t query, const Localizer& localizer, QueryResult& result);
  std::vector<std::string> DoctorWarnings() const;

  BatchOptions options_;
  std::vector<Query> queries_;
  std::shared_ptr<MatchSource> matches_;
  std::shared_ptr<MatchSource> cached_;  // the same, while no query joins the references
  std::shared_ptr<const Scene> scene_;
  std::vector<SceneSource> as_read_;  // before alignment, which hides how the input is read
  QuickDoctor doctor_;
  FocalCheck focal_check_;
  std::vector<std::optional<double>> log_focal_factors_;
  // Made while learning; taken by the query's own turn.
  std::vector<std::optional<QueryResult>> matched_;
  std::optional<SceneKnowledge> knowledge_;
};

}  // namespace raylift
