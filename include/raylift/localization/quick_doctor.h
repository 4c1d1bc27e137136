// The quick form of the doctor during localization: it takes the matches of a few queries
// that were made anyway, and says in one line what is suspicious.

#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/geometry/rigid3.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/lifting/reference_matches.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/references.h"
#include "raylift/scene/photographs.h"

namespace raylift {

class QuickDoctor {
 public:
  // Looks at some 30 queries, the same ones whatever their order.
  explicit QuickDoctor(std::span<const Query> queries);

  bool Wants(size_t query) const { return wanted_[query]; }
  // The matches of a query that is wanted. Thread safe for different queries.
  void Add(size_t query, std::span<const PosedImage> references,
           std::span<const Match2D2D> matches);

  // A warning where another reading of the source explains the matches far better; none for SfM
  // points, which are the references' own.
  std::optional<std::string> Warn(const NamedGeometry& geometry, const ReferenceSet& references,
                                  PoseConvention poses, int threads) const;

 private:
  struct MatchesOfQuery {
    std::vector<std::string> references;
    std::vector<ReferenceMatch> matches;
  };

  std::vector<bool> wanted_;             // of each query
  std::vector<size_t> by_name_;          // the queries that are wanted
  std::vector<MatchesOfQuery> matches_;  // of each query
};

}  // namespace raylift
