// What all queries of a run say together of their input, where no query by itself would notice: the
// geometry is not where the references are, the queries' focal length is wrong.

#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/localization/localizer.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// Looks at the focal length in some ten queries, the same ones whatever their order.
class FocalCheck {
 public:
  // In none if `options` refine it anyway.
  FocalCheck(std::span<const Query> queries, const EstimatorOptions& options);

  // The logarithm of how many times too long the query's focal length seems. None where it is not
  // looked at, or the query is not localized with confidence. Thread safe.
  std::optional<double> LogFactor(size_t query, const QueryResult& result) const;

 private:
  std::vector<bool> wanted_;  // of each query
  std::shared_ptr<const PoseEstimator> estimator_;
};

// Where the photographs agree on another focal length than the given one; LogFactor() of those that
// have one, in any order.
std::optional<std::string> WarnOfFocalLength(std::span<const double> log_factors);

// Of the queries that were localized with confidence: where no or few points come from the
// geometry, or few of them fit, although the 2D-2D matches do.
std::optional<std::string> WarnOfGeometry(std::span<const LocalizedQuery> queries);

// Both, the first where it is asked for.
std::vector<std::string> RunWarnings(std::span<const LocalizedQuery> queries,
                                     std::span<const double> log_factors, bool checks_geometry);

}  // namespace raylift
