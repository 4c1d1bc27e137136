// The matches between a scene's references that the queries' matches imply: what depth alignment
// and the check of the input rest on.

#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "raylift/lifting/depth_alignment.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/scene.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// Evenly spaced queries in the order of their names: the same ones whatever order they stand in.
std::vector<size_t> SampleByName(std::span<const Query> queries, size_t count);

// A query that is itself a reference brings its own matches. Indices count in references.images;
// sorted, each match once, whatever the number of threads. References that have `enough` matches
// already take no more from later queries, so that memory stays bounded.
std::vector<ReferenceMatch> CollectReferenceMatches(std::span<const Query> queries,
                                                    const MatchSource& match_source,
                                                    const ReferenceSet& references, int threads,
                                                    size_t enough = 5000);

}  // namespace raylift
