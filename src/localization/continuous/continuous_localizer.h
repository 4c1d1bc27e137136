// Continuous localization (the paper, Sec. 4.3): queries that have been localized become references
// for those that follow. One query after the other; work within a query may be parallel.

#pragma once

#include <atomic>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "localization/calibration_images.h"
#include "localization/continuous/join_gate.h"
#include "localization/continuous/joined_references.h"

#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/match_source.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// With the paper's methods and nothing beyond every localized query joins, and counts as any other
// reference.
constexpr bool JoinsAsInPaper(const EstimatorOptions& options) {
  return options.refinement == Refinement::kPaper;
}

// A scene whose references grow, and a localizer that sees what it holds now. The covisibility of
// the references is not used, as it knows nothing of queries: clusters follow from the matches.
class GrowingScene {
 public:
  // `matches` must have been opened for queries that join. With `weigh` off, and as in the paper,
  // joined references count as if their poses were exact.
  GrowingScene(const Scene& scene, std::shared_ptr<MatchSource> matches,
               const LocalizerOptions& options, bool weigh);
  GrowingScene(const GrowingScene&) = delete;
  GrowingScene& operator=(const GrowingScene&) = delete;

  const Localizer& localizer() const { return localizer_; }
  const JoinedReferences& joined() const { return *joined_; }

  void Join(const JoinedReference& reference);

 private:
  std::shared_ptr<MatchSource> source_;
  std::shared_ptr<JoinedReferences> joined_;
  Localizer localizer_;
};

// What is decided on a query that was localized.
struct JoinDecision {
  std::string diagnostics;  // its line of queries.jsonl, without the line's end
  std::optional<JoinedReference> joined = std::nullopt;  // nullopt: it does not join the references
};

struct ContinuousRun {
  std::span<const size_t> order;  // of the queries
  // The queries that an earlier run has done, with what they have become.
  std::map<size_t, std::optional<JoinedReference>> done = {};
  JoinGateOptions gate = {};  // not as in the paper
  bool weigh = true;          // as GrowingScene's
  int threads = 0;
  const std::atomic<bool>* stop = nullptr;  // finish the query in hand
  // A query was localized with what the scene holds now, and may be changed before it is judged.
  std::function<void(size_t query, QueryResult& result)> on_localized = {};
  // A query is done, and joins the references when this returns.
  std::function<void(size_t query, const QueryResult& result, const JoinDecision& decision)>
      on_done = {};
};

void LocalizeContinuously(std::span<const Query> queries, GrowingScene& scene,
                          const ContinuousRun& run);

// The order in which continuous localization takes the queries (the paper's supplement): those that
// are most like the references come first, where a scene changes slowly.

// When photographs were taken, in seconds since any moment.
using CaptureTimes = std::map<std::string, double>;

// Indices of the queries. Those that are older than the oldest reference go first, backwards in
// time; then the others, from the oldest on. Of one time, by name. References whose times are not
// known do not count; where none is known, all queries go from the oldest on. InputError naming the
// query whose time is missing (`path_for_messages`).
std::vector<size_t> OrderByTime(std::span<const Query> queries,
                                std::span<const PosedImage> references, const CaptureTimes& times,
                                const std::filesystem::path& path_for_messages);

}  // namespace raylift
