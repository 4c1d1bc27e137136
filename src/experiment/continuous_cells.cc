#include "continuous_cells.h"

#include "raylift/base/error.h"
#include "raylift/io/scene_file.h"
#include "raylift/localization/continuous_localizer.h"
#include "raylift/localization/continuous_order.h"
#include "raylift/localization/localizer.h"

namespace raylift {
namespace {

std::vector<size_t> Order(const ContinuousCell& cell) {
  if (cell.scene.times.empty()) return OrderByName(cell.queries);
  return OrderByTime(cell.queries, cell.references.images, ReadTimes(cell.scene.times),
                     cell.scene.times);
}

QueryOutcome OutcomeOf(const LocalizedQuery& localized) {
  const PoseEstimate& estimate = localized.estimate;
  QueryOutcome outcome;
  outcome.name = localized.name;
  outcome.cam_from_world = estimate.cam_from_world;
  outcome.position_observable = estimate.position_observable;
  outcome.reason = localized.reason;
  outcome.inliers_2d3d = static_cast<int>(localized.counts.inliers_2d3d);
  outcome.inliers_2d2d = static_cast<int>(localized.counts.inliers_2d2d);
  outcome.matches_2d3d = static_cast<int>(localized.counts.points);
  outcome.matches_2d2d = static_cast<int>(localized.counts.matched);
  outcome.solver = estimate.solver;
  return outcome;
}

}  // namespace

std::vector<QueryOutcome> RunContinuousCell(const ContinuousCell& cell) {
  const ContinuousCheckpoint checkpoint(cell.checkpoint, cell.key, /*resume=*/true);
  GrowingScene scene(cell.matches, cell.geometry, /*weigh=*/true);
  const auto estimator = MakePoseEstimator(cell.estimator);
  // Covisibility in the model knows nothing of queries: clusters follow from the matches.
  const Covisibility covisibility;
  const ContinuousRecords records = LocalizeContinuously(
      cell.queries, Order(cell), scene, checkpoint,
      {.gate = {}, .estimator = cell.estimator, .threads = cell.threads},
      {.localize =
           [&](size_t query) {
             return LocalizeQuery(cell.queries[query], {.match_source = scene.matches(),
                                                        .covisibility = covisibility,
                                                        .geometry = scene.geometry(),
                                                        .filter = cell.filter,
                                                        .estimator = *estimator});
           },
       .on_done =
           [&](size_t, const QueryResult*) {
             if (cell.on_estimate) cell.on_estimate();
           }});
  RAYLIFT_CHECK_EQ(CountMissing(records), size_t{0});
  std::vector<QueryOutcome> outcomes;
  for (const auto& record : records) outcomes.push_back(OutcomeOf(record->localized));
  std::error_code ignored;
  std::filesystem::remove_all(cell.checkpoint, ignored);
  return outcomes;
}

}  // namespace raylift
