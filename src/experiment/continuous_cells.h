// A cell whose queries, once localized, join the references of those that follow.

#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "raylift/estimation/pose_estimator.h"
#include "raylift/experiment/cells.h"
#include "raylift/experiment/experiment.h"
#include "raylift/lifting/consistency_filter.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/localization/match_source.h"

namespace raylift {

struct ContinuousCell {
  const ExperimentScene& scene;
  std::span<const Query> queries;
  const ReferenceSet& references;
  MatchSource& matches;  // of its own, as it grows
  std::span<const GeometrySource* const> geometry;
  FilterOptions filter;
  EstimatorOptions estimator;
  std::filesystem::path checkpoint;  // folder of what is done; gone in the end
  std::string key;                   // of the cell
  int threads = 0;
  std::function<void()> on_estimate = {};
};

// One outcome per query, in their order. A run that was killed goes on at the query it was at.
std::vector<QueryOutcome> RunContinuousCell(const ContinuousCell& cell);

}  // namespace raylift
