// Finds which features of a query and of a reference show the same place: those that are each
// other's nearest neighbors by descriptor, where the nearest is clearly nearer than the runner-up.

#pragma once

#include <vector>

#include "raylift/scene/features.h"

namespace raylift {

struct MatchOptions {
  // Lowe's ratio test: the distance from the query's descriptor to its nearest neighbor is below
  // this share of the distance to the second nearest. 1: no such test.
  double max_ratio = 0.8;
  // The second nearest must lie farther from the nearest than this: the same place found again, at
  // another scale or orientation, does not make a match ambiguous (1 to 2 % more correct matches at
  // the same share of wrong ones).
  double same_place_px = 2.0;
};

// Matches in the order of the query's features; features at equal pixels (one place with several
// orientations) give at most one match between the same two pixels. Descriptors are compared by
// their directions (their lengths do not matter); the score is (1 + cosine) / 2, as hloc's. None
// where either has no descriptors. Throws InputError if the two have descriptors of different
// sizes.
//
// The result is the same on every machine: distances come from exact integer products of
// descriptors rounded to 16 bits. Runs on the calling thread alone; run pairs in parallel.
std::vector<FeatureMatch> MatchMutualNearest(const Features& query, const Features& reference,
                                             const MatchOptions& options = {});

}  // namespace raylift
