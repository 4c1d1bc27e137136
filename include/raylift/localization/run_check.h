// What all queries of a run say together of their input, where no query by itself would notice: the
// geometry is not where the references are, the queries' focal length is wrong.

#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/estimation/pose_estimator.h"
#include "raylift/localization/localizer.h"
#include "raylift/scene/pose_problem.h"
#include "raylift/scene/query.h"

namespace raylift {

class RunCheck {
 public:
  // The focal length is looked at in some ten queries, the same ones whatever their order.
  explicit RunCheck(std::span<const Query> queries);

  // Thread safe for different queries.
  void Add(size_t query, const QueryResult& result);

  // Of the queries that were localized with confidence: where no or few points come from the
  // geometry, or few of them fit, although the 2D-2D matches do.
  std::optional<std::string> WarnOfGeometry() const;

  // Where the photographs agree on another focal length than the given one. None if `options`
  // refine it anyway.
  std::optional<std::string> WarnOfFocalLength(const EstimatorOptions& options, int threads) const;

 private:
  struct Counts {
    double matched = 0, inliers_2d2d = 0, points = 0, inliers_2d3d = 0;
  };

  std::vector<bool> wanted_;           // of each query
  std::vector<PoseProblem> problems_;  // of the wanted ones that are localized
  std::vector<Counts> counts_;         // of each query; zeros where it is not localized
};

}  // namespace raylift
