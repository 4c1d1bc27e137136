// Localizes continuously (the paper, Sec. 4.3): queries that have been localized become references
// for those that follow. One query comes after the other; work within a query may be parallel.

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

// Returns whether every localized query joins, and counts as any other reference, as with the
// paper's methods and nothing beyond.
constexpr bool JoinsAsInPaper(const EstimatorOptions& options) {
  return options.refinement == Refinement::kPaper;
}

// The decision on a query that was localized.
struct JoinDecision {
  std::string diagnostics;  // its line of queries.jsonl, without the line's end
  std::optional<JoinedReference> joined = std::nullopt;  // nullopt: it does not join the references
};

struct ContinuousRun {
  std::span<const size_t> order;  // of the queries
  // The queries that an earlier run has done, with the references that they have become.
  std::map<size_t, std::optional<JoinedReference>> done = {};
  JoinGateOptions gate = {};  // not as in the paper
  bool weigh = true;          // off, and as in the paper: joined poses count as if they were exact
  int threads = 0;
  const std::atomic<bool>* stop = nullptr;  // finish the query in hand
  // Is called when a query was localized with the present scene; the result may be changed before
  // it is judged.
  std::function<void(size_t query, QueryResult& result)> on_localized = {};
  // Is called when a query is done; it joins the references when this returns.
  std::function<void(size_t query, const QueryResult& result, const JoinDecision& decision)>
      on_done = {};
};

// `matches` must have been opened for queries that join. The covisibility of the references is not
// used, as it does not include queries: clusters follow from the matches.
void LocalizeContinuously(std::span<const Query> queries, const Scene& scene,
                          std::shared_ptr<MatchSource> matches, const LocalizerOptions& options,
                          const ContinuousRun& run);

// Orders the queries for continuous localization (the paper's supplement): those that are most like
// the references come first, where a scene changes slowly.

// Times at which photographs were taken, in seconds since any moment.
using CaptureTimes = std::map<std::string, double>;

// Returns the indices of the queries in order. Those that are older than the oldest reference go
// first, backwards in time; then the others, from the oldest on. Queries of one time go by name.
// References whose times are not known do not count; where none is known, all queries go from the
// oldest on. Throws InputError naming the query whose time is missing (`path_for_messages`).
std::vector<size_t> OrderByTime(std::span<const Query> queries,
                                std::span<const PosedImage> references, const CaptureTimes& times,
                                const std::filesystem::path& path_for_messages);

}  // namespace raylift
