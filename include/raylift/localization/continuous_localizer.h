// Continuous localization (the paper, Sec. 4.3): queries that have been localized become references
// for those that follow. One query after the other; work within a query may be parallel.

#pragma once

#include <atomic>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "raylift/estimation/pose_estimator.h"
#include "raylift/io/query_list.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/localization/continuous_checkpoint.h"
#include "raylift/localization/continuous_gate.h"
#include "raylift/localization/continuous_references.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/match_source.h"

namespace raylift {

// A scene whose references grow: what LocalizeQuery() sees of it. Matches and geometry must outlive
// it.
class GrowingScene {
 public:
  // With `weigh` off joined references count as if their poses were exact.
  GrowingScene(MatchSource& matches, std::span<const GeometrySource* const> geometry, bool weigh);
  GrowingScene(const GrowingScene&) = delete;
  GrowingScene& operator=(const GrowingScene&) = delete;

  const MatchSource& matches() const { return weighed_; }
  std::span<const GeometrySource* const> geometry() const { return geometry_; }
  const JoinedReferences& joined() const { return joined_; }

  void Join(const JoinedReference& reference);

 private:
  MatchSource& source_;
  JoinedReferences joined_;
  WeighedMatches weighed_;
  std::vector<std::unique_ptr<JoinedGeometry>> owned_geometry_;
  std::vector<const GeometrySource*> geometry_;
};

struct ContinuousOptions {
  JoinGateOptions gate;
  EstimatorOptions estimator;  // of the solvers that have to agree
  int threads = 0;
  const std::atomic<bool>* stop = nullptr;  // finish the query in hand
};

struct ContinuousHooks {
  std::function<QueryResult(size_t query)> localize;  // with what the scene holds now
  // A query is done; `result` is null where it was done by an earlier run.
  std::function<void(size_t query, const QueryResult* result)> on_done;
};

// The records of the queries, one for each, in the order of the list; with `stop`, those that were
// not reached are missing.
using ContinuousRecords = std::vector<std::optional<ContinuousRecord>>;

size_t CountMissing(const ContinuousRecords& records);

// `queries.jsonl`, as WriteQueryDiagnostics() writes it, with what was decided on each query. All
// records must be there.
void WriteQueryDiagnostics(const std::filesystem::path& path, const ContinuousRecords& records);

// Takes the queries in `order`. What `checkpoint` holds is not done again.
ContinuousRecords LocalizeContinuously(std::span<const Query> queries,
                                       std::span<const size_t> order, GrowingScene& scene,
                                       const ContinuousCheckpoint& checkpoint,
                                       const ContinuousOptions& options,
                                       const ContinuousHooks& hooks);

}  // namespace raylift
