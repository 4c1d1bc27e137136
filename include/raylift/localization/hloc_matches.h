// Matches that hloc's tools, or others that write its files, have made.

#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <span>

#include "raylift/localization/match_source.h"
#include "raylift/localization/references.h"
#include "raylift/scene/photographs.h"

namespace raylift {

struct HlocFiles {
  std::filesystem::path features;
  std::filesystem::path matches;
  std::filesystem::path pairs;
};

// Queries that may become references by Join(), and how many of them a query may have among its
// references; none may by default.
struct JoiningQueries {
  std::span<const Query> queries = {};
  int max_joined = 0;
};

// How matches that stand in files are taken.
struct MatchReading {
  // Those of a lower score are left out; matches without scores count as 1, as in hloc.
  std::optional<double> min_score = std::nullopt;
  // Of pixels without features (pair_matches.h): where the matcher puts the center of the first
  // pixel, between 0 and 1, and the side of the cells in which query pixels are one keypoint;
  // 0: equal pixels alone are.
  double first_pixel = 0;
  double cell_px = 0;
};
// Throws OptionError.
void Check(const MatchReading& reading);

// Reads hloc's files. The pairs file ranks the references of each query; `top_k` of those in use
// are taken. InputError where it names a reference that the model does not hold. References that
// are joining queries stand in the files like others, and are passed over until they join.
std::unique_ptr<MatchSource> OpenHlocMatches(const HlocFiles& files, const ReferenceSet& references,
                                             int top_k, const JoiningQueries& joining = {},
                                             const MatchReading& reading = {});

}  // namespace raylift
