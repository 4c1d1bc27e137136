// Matches that stand in COLMAP's database.

#pragma once

#include <filesystem>
#include <memory>

#include "raylift/localization/hloc_matches.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/references.h"

namespace raylift {

// Queries and references are images of the database by the names that they have elsewhere. Without
// a list of pairs, a query's references are those that it is matched with, most inliers first.
// InputError where the database holds none of the references.
std::unique_ptr<MatchSource> OpenDatabaseMatches(const std::filesystem::path& database,
                                                 const std::filesystem::path& pairs,
                                                 const ReferenceSet& references, int top_k,
                                                 const JoiningQueries& joining = {});

}  // namespace raylift
