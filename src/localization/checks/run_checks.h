// Checks of what all queries of a run say together of their input, where no query by itself would
// notice: how depth and poses are read, whether the geometry is not where the references are, the
// queries' focal length is wrong.

#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/lifting/depth_alignment.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/scene.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// Looks at the focal length in some ten queries, the same ones whatever their order.
class FocalCheck {
 public:
  // Looks at none if `options` refine it anyway.
  FocalCheck(std::span<const Query> queries, const EstimatorOptions& options);

  // Returns ln(given / estimated focal length) of the query. nullopt where it is not checked, or
  // the query is not localized with confidence. Thread safe.
  std::optional<double> LogFactor(size_t query, const QueryResult& result) const;

 private:
  std::vector<bool> wanted_;  // of each query
  std::shared_ptr<const PoseEstimator> estimator_;
};

// Returns a warning where the photographs agree on another focal length than the given one.
// `log_factors` are FocalCheck::LogFactor() of those that have one, in any order.
std::optional<std::string> WarnOfFocalLength(std::span<const double> log_factors);

// Returns what is assumed of photographs whose camera is not known.
std::optional<std::string> WarnOfAssumedLenses(std::span<const Query> queries);

// Warns where the geometry does not fit, by the queries that have a pose, which is doubtful then:
// where no or few points come from the geometry, or few of them fit, although the 2D-2D matches do.
std::optional<std::string> WarnOfGeometry(std::span<const LocalizedQuery> queries);

// Returns both warnings, that of the geometry where it is asked for.
std::vector<std::string> RunWarnings(std::span<const LocalizedQuery> queries,
                                     std::span<const double> log_factors, bool checks_geometry);

// The fast form of the doctor during localization: it takes the matches of a few queries that were
// made anyway, and says in one line what is suspicious.

class QuickDoctor {
 public:
  // Looks at some 30 queries, the same ones whatever their order.
  explicit QuickDoctor(std::span<const Query> queries);

  bool Wants(size_t query) const { return wanted_[query]; }
  // Returns how many more images could be used.
  size_t NumMissing() const;
  // Takes the matches of a query that is wanted. Thread safe for different queries.
  void Add(size_t query, std::span<const PosedImage> references,
           std::span<const Match2D2D> matches);

  // Returns a warning where another reading of the source explains the matches far better; nullopt
  // for SfM points, which are the references' own. `more` are matches between references that no
  // query of these brought.
  std::optional<std::string> Warn(const NamedGeometry& geometry, const ReferenceSet& references,
                                  std::span<const ReferenceMatch> more, PoseConvention poses,
                                  int threads) const;

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
