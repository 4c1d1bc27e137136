#include "raylift/localization/run_check.h"

#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "raylift/base/median.h"
#include "raylift/base/parallel.h"
#include "raylift/localization/scene_matches.h"

namespace raylift {
namespace {

constexpr size_t kFocalQueries = 10;
constexpr size_t kLeastFocalQueries = 3;
// Refined focal lengths of a right camera differ from the given one by a few per cent at most.
constexpr double kFocalTolerance = 0.03;

// Points that so few of the matches have, or of which so few fit, compared with the pairs.
constexpr double kFewPoints = 0.1;
// Pairs of which so many fit are not to blame.
constexpr double kPairsFit = 0.2;

}  // namespace

RunCheck::RunCheck(std::span<const Query> queries)
    : wanted_(queries.size(), false), problems_(queries.size()), counts_(queries.size()) {
  for (const size_t query : SampleByName(queries, kFocalQueries)) wanted_[query] = true;
}

void RunCheck::Add(size_t query, const QueryResult& result) {
  const LocalizedQuery& localized = result.localized;
  if (localized.verdict() != PoseVerdict::kLocalized) return;
  const auto count = [](size_t n) { return static_cast<double>(n); };
  counts_[query] = {.matched = count(localized.counts.matched),
                    .inliers_2d2d = count(localized.counts.inliers_2d2d),
                    .points = count(localized.counts.points),
                    .inliers_2d3d = count(localized.counts.inliers_2d3d)};
  const bool focal_length_is_given = result.problem.priors.focal_range == 1;
  if (wanted_[query] && focal_length_is_given) problems_[query] = result.problem;
}

std::optional<std::string> RunCheck::WarnOfGeometry() const {
  Counts all;
  for (const Counts& counts : counts_) {
    all.matched += counts.matched;
    all.inliers_2d2d += counts.inliers_2d2d;
    all.points += counts.points;
    all.inliers_2d3d += counts.inliers_2d3d;
  }
  if (!(all.inliers_2d2d > kPairsFit * all.matched)) return std::nullopt;
  const double pairs_percent = 100 * all.inliers_2d2d / all.matched;
  if (all.points < kFewPoints * all.inliers_2d2d) {
    return fmt::format(
        "only {:.1f} % of the matches have a point in the geometry, although {:.0f} % of them fit "
        "together: is it where the references are, in their unit and axes?",
        100 * all.points / all.matched, pairs_percent);
  }
  if (all.inliers_2d3d / all.points < kFewPoints * all.inliers_2d2d / all.matched) {
    return fmt::format(
        "only {:.1f} % of the geometry's points fit the poses, but {:.0f} % of the matches do: is "
        "it where the references are, in their unit and axes?",
        100 * all.inliers_2d3d / all.points, pairs_percent);
  }
  return std::nullopt;
}

std::optional<std::string> RunCheck::WarnOfFocalLength(const EstimatorOptions& options,
                                                       int threads) const {
  if (options.refine_focal) return std::nullopt;
  std::vector<const PoseProblem*> problems;
  for (const PoseProblem& problem : problems_) {
    if (!problem.name.empty()) problems.push_back(&problem);
  }
  if (problems.size() < kLeastFocalQueries) return std::nullopt;
  EstimatorOptions refine = options;
  refine.refine_focal = true;
  const auto estimator = MakePoseEstimator(refine);
  std::vector<std::optional<double>> found(problems.size());
  ParallelFor(problems.size(), threads, [&](size_t i) {
    const PoseEstimate estimate = estimator->Estimate(*problems[i]);
    if (estimate.refined_camera && estimate.verdict == PoseVerdict::kLocalized) {
      found[i] = std::log(problems[i]->query_camera.MeanFocalPx() /
                          estimate.refined_camera->MeanFocalPx());
    }
  });
  std::vector<double> log_factors;
  for (const auto& factor : found) {
    if (factor) log_factors.push_back(*factor);
  }
  if (log_factors.size() < kLeastFocalQueries) return std::nullopt;
  const double median = UpperMedianOr(log_factors, 0);
  std::vector<double> deviations;
  deviations.reserve(log_factors.size());
  for (const double factor : log_factors) deviations.push_back(std::abs(factor - median));
  // Three standard errors of a median of normal errors.
  const double error = 3 * 1.4826 * UpperMedianOr(deviations, 0) *
                       std::sqrt(std::numbers::pi / 2 / static_cast<double>(log_factors.size()));
  if (std::abs(median) < std::max(kFocalTolerance, error)) return std::nullopt;
  return fmt::format(
      "the queries' focal length seems {:.2f} times too {} (median of {} queries): refine_focal "
      "estimates it with each pose",
      std::exp(std::abs(median)), median > 0 ? "long" : "short", log_factors.size());
}

}  // namespace raylift
