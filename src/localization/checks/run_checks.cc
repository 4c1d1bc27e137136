#include "localization/checks/run_checks.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>
#include <span>
#include <unordered_map>

#include "base/statistics.h"
#include "estimation/methods/assumed_lens.h"
#include "localization/calibration_images.h"
#include <fmt/format.h>

#include "raylift/diagnosis/doctor.h"

namespace raylift {

namespace {

constexpr size_t kFocalQueries = 10;
constexpr size_t kLeastFocalQueries = 3;
// Refined focal lengths of a right camera differ from the given one by a few per cent at most.
constexpr double kFocalTolerance = 0.03;

// The least share of the matches with points, and of the points that fit, relative to the pairs.
constexpr double kFewPoints = 0.1;
// Pairs are not to blame where this share of them fits.
constexpr double kPairsFit = 0.2;

struct Counts {
  double matched = 0, inliers_2d2d = 0, points = 0, inliers_2d3d = 0;
};

}  // namespace

FocalCheck::FocalCheck(std::span<const Query> queries, const EstimatorOptions& options)
    : wanted_(queries.size(), false) {
  if (options.refine_focal) return;
  for (const size_t query : SampleByName(queries, kFocalQueries)) wanted_[query] = true;
  EstimatorOptions refine = options;
  refine.refine_focal = true;
  estimator_ = MakePoseEstimator(refine);
}

std::optional<double> FocalCheck::LogFactor(size_t query, const QueryResult& result) const {
  const bool is_given = result.problem.priors.focal_range == 1;
  if (!wanted_[query] || !is_given || result.localized.verdict() != PoseVerdict::kLocalized) {
    return std::nullopt;
  }
  const PoseEstimate estimate = estimator_->Estimate(result.problem);
  if (!estimate.refined_camera || estimate.verdict != PoseVerdict::kLocalized) return std::nullopt;
  return std::log(result.problem.query_camera.MeanFocalPx() /
                  estimate.refined_camera->MeanFocalPx());
}

std::optional<std::string> WarnOfGeometry(std::span<const LocalizedQuery> queries) {
  Counts all;
  for (const LocalizedQuery& query : queries) {
    if (query.verdict() == PoseVerdict::kFailed) continue;
    all.matched += static_cast<double>(query.counts.matched);
    all.inliers_2d2d += static_cast<double>(query.counts.inliers_2d2d);
    all.points += static_cast<double>(query.counts.points);
    all.inliers_2d3d += static_cast<double>(query.counts.inliers_2d3d);
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

std::vector<std::string> RunWarnings(std::span<const LocalizedQuery> queries,
                                     std::span<const double> log_factors, bool checks_geometry) {
  std::vector<std::string> warnings;
  if (checks_geometry) {
    if (auto warning = WarnOfGeometry(queries)) warnings.push_back(std::move(*warning));
  }
  if (auto warning = WarnOfFocalLength(log_factors)) warnings.push_back(std::move(*warning));
  return warnings;
}

std::optional<std::string> WarnOfAssumedLenses(std::span<const Query> queries) {
  std::set<double> factors;
  size_t assumed = 0;
  for (const Query& query : queries) {
    if (!LensIsAssumed(query.camera, query.priors)) continue;
    factors.insert(query.priors.focal_range);
    ++assumed;
  }
  if (assumed == 0) return std::nullopt;
  const std::string up_to = factors.size() > 1 ? fmt::format(" to {}", *factors.rbegin()) : "";
  return fmt::format(
      "the cameras of {} of {} photographs are not known: a principal point near the middle, "
      "little distortion and a focal length that is right to a factor of {}{} are assumed; the "
      "rest is estimated with each pose",
      assumed, queries.size(), *factors.begin(), up_to);
}

std::optional<std::string> WarnOfFocalLength(std::span<const double> log_factors) {
  if (log_factors.size() < kLeastFocalQueries) return std::nullopt;
  const std::vector<double> factors(log_factors.begin(), log_factors.end());
  const double median = UpperMedianOr(factors, 0);
  // Three standard errors of a median of normal errors.
  const double error = 3 * kSigmaPerMad * UpperDeviation(factors, median) *
                       std::sqrt(std::numbers::pi / 2 / static_cast<double>(log_factors.size()));
  if (std::abs(median) < std::max(kFocalTolerance, error)) return std::nullopt;
  return fmt::format(
      "the queries' focal length seems {:.2f} times too {} (median of {} queries): refine_focal "
      "estimates it with each pose, from farther away with focal_range",
      std::exp(std::abs(median)), median > 0 ? "long" : "short", log_factors.size());
}

namespace {

constexpr size_t kQueries = 30;
constexpr size_t kMatches = 1500;

}  // namespace

QuickDoctor::QuickDoctor(std::span<const Query> queries)
    : wanted_(queries.size(), false),
      by_name_(SampleByName(queries, kQueries)),
      matches_(queries.size()) {
  for (const size_t query : by_name_) wanted_[query] = true;
}

size_t QuickDoctor::NumMissing() const { return kQueries - by_name_.size(); }

void QuickDoctor::Add(size_t query, std::span<const PosedImage> references,
                      std::span<const Match2D2D> matches) {
  MatchesOfQuery& kept = matches_[query];
  for (const PosedImage& reference : references) kept.references.push_back(reference.name);
  kept.matches = TransitiveMatches(matches);
}

std::optional<std::string> QuickDoctor::Warn(const NamedGeometry& geometry,
                                             const ReferenceSet& references,
                                             std::span<const ReferenceMatch> more,
                                             PoseConvention poses, int threads) const {
  if (geometry.kind == GeometryKind::kSfm) return std::nullopt;
  std::unordered_map<std::string, int> index_of_name;
  for (size_t i = 0; i < references.images.size(); ++i) {
    index_of_name.emplace(references.images[i].name, static_cast<int>(i));
  }
  std::vector<ReferenceMatch> all(more.begin(), more.end());
  for (const size_t query : by_name_) {
    const MatchesOfQuery& kept = matches_[query];
    for (ReferenceMatch match : kept.matches) {
      const auto a = index_of_name.find(kept.references[static_cast<size_t>(match.reference_a)]);
      const auto b = index_of_name.find(kept.references[static_cast<size_t>(match.reference_b)]);
      // Localized queries that have become references tell nothing of the input.
      if (a == index_of_name.end() || b == index_of_name.end()) continue;
      match.reference_a = a->second;
      match.reference_b = b->second;
      all.push_back(match);
    }
  }
  const Diagnosis diagnosis =
      Diagnose(MakeDoctorInput(geometry, references.images, all, poses),
               {.max_matches = kMatches, .half_pixels = false, .threads = threads});
  // It is for WarnOfGeometry() to say that few points come from the geometry, or that few matches
  // fit.
  const bool named = diagnosis.fault != InputFault::kNone && diagnosis.fault != InputFault::kPoses;
  if (diagnosis.verdict != InputVerdict::kRepair && !named) return std::nullopt;
  return fmt::format("{}: {}", geometry.source->Description(), Summary(diagnosis));
}

}  // namespace raylift
