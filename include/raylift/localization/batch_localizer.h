// All queries of a list against one scene: what is learned from the queries together (the depth's
// correction, the scene's noise, whether the input is read as it was meant) is learned first, then
// each is localized. The continuous mode does not learn what matches are worth (SceneNoise), as its
// queries must not know of those that come later.

#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/lifting/depth_alignment.h"
#include "raylift/localization/continuous_localizer.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/quick_doctor.h"
#include "raylift/localization/rerender.h"
#include "raylift/localization/run_check.h"
#include "raylift/localization/scene.h"

namespace raylift {

struct BatchOptions {
  LocalizerOptions localizer = {};
  AlignMode align = AlignMode::kOff;
  // Null: poses are not sharpened by rendering the mesh again.
  std::shared_ptr<const Rerenderer> rerenderer = nullptr;
  bool check_input = true;  // see QuickDoctor and RunCheck
  int threads = 0;
};

class BatchLocalizer {
 public:
  BatchLocalizer(const Scene& scene, std::vector<Query> queries,
                 std::shared_ptr<MatchSource> matches, const BatchOptions& options);

  // With the depth corrected as asked for.
  const Scene& scene() const { return *scene_; }
  const std::vector<Query>& queries() const { return queries_; }

  using OnResult = std::function<void(size_t query, const QueryResult& result)>;

  // In parallel; in the order of the list. `on_result` is called from any thread.
  std::vector<LocalizedQuery> LocalizeAll(const OnResult& on_result = {});

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

  // What the queries have in common, after LocalizeAll(), where the method uses it.
  const std::optional<SceneNoise>& scene_noise() const { return scene_noise_; }

  // Of the matches and of the check of the input, after localizing.
  std::vector<std::string> Warnings() const;

 private:
  // The matches and what comes after the pose.
  void Complete(size_t query, const Localizer& localizer, QueryResult& result);

  BatchOptions options_;
  std::vector<Query> queries_;
  std::shared_ptr<MatchSource> matches_;
  std::shared_ptr<const Scene> scene_;
  QuickDoctor doctor_;
  RunCheck run_check_;
  std::optional<SceneNoise> scene_noise_;
};

}  // namespace raylift
