// The walk of `raylift localize --odometry`: read before the work, smoothed after it.

#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <vector>

#include "apps/localize_flags.h"
#include "localization/results/query_job.h"

#include "raylift/localization/scene.h"
#include "raylift/scene/photographs.h"
#include "raylift/sequences/smooth_queries.h"
#include "raylift/sequences/walk.h"

namespace raylift {

// Returns the walk of the queries.
Walk OpenWalk(const LocalizeFlags& flags, std::span<const Query> queries);

// Smooths the records of all queries, which then tell their poses in the walk.
WalkedQueries SmoothRecords(const LocalizeFlags& flags, const Walk& walk, const Scene& scene,
                            std::span<const Query> queries, std::vector<QueryRecord>& records);

// walk.json, trajectory.txt and trajectory_covariance.txt; without a walk, those of a run before
// this one are removed.
void WriteWalk(const std::filesystem::path& folder, const std::optional<WalkedQueries>& walked);

// What it says on stdout.
void PrintWalk(const WalkedQueries& walked);

}  // namespace raylift
