#include "raylift/localization/localizer.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/lap_clock.h"
#include "localization/retrieval/covisibility.h"
#include "localization/rig_problem.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/localization/scene_calibration.h"
#include "raylift/renderers/ray_caster.h"

namespace raylift {
namespace {

std::string ReasonOf(const LocalizedQuery& localized, double min_confidence) {
  std::string reason = ReasonNotLocalized(localized.estimate, min_confidence);
  if (reason.empty()) return reason;
  if (localized.counts.retrieved == 0) return "no retrieved references";
  if (localized.counts.matched == 0) return "no matches with the retrieved references";
  return reason;
}

std::vector<const GeometrySource*> PointersTo(
    const std::vector<std::shared_ptr<const GeometrySource>>& geometry) {
  std::vector<const GeometrySource*> pointers;
  pointers.reserve(geometry.size());
  for (const auto& source : geometry) pointers.push_back(source.get());
  return pointers;
}

// Returns the plane of the surface that a camera has in the middle of its view; nullopt where that
// is the sky. The plane is through the surface there. Its normal is the mean of some places about
// it that the axis may meet, as the position is uncertain: triangles of a surface model have the
// noise of its heights. How far these places lie from the plane is its uncertainty.
std::optional<RangePrior::Plane> PlaneAhead(const RayCaster& surface, const PoseEstimate& estimate,
                                            double range) {
  const double aside = std::min(std::max(0.005, estimate.position_sigma / range), 0.05);
  const Rigid3 world_from_cam = estimate.cam_from_world->Inverse();
  std::vector<Ray> rays;
  for (const double x : {0.0, -aside, aside}) {
    for (const double y : {0.0, -aside, aside}) {
      rays.push_back(
          {world_from_cam.translation, world_from_cam.rotation * Eigen::Vector3d(x, y, 1)});
    }
  }
  const auto hits = surface.Cast(rays);
  if (!hits.front()) return std::nullopt;
  const Eigen::Vector3d& axis = rays.front().direction_in_world;
  std::vector<Eigen::Vector3d> points;
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();
  for (size_t i = 0; i < hits.size(); ++i) {
    if (!hits[i]) continue;
    points.emplace_back(rays[i].origin_in_world + hits[i]->ray_t * rays[i].direction_in_world);
    const Eigen::Vector3d& of_hit = hits[i]->normal_in_world;
    normal += std::copysign(1, of_hit.dot(axis)) * of_hit.normalized();
  }
  double sum = 0;
  for (const Eigen::Vector3d& point : points) {
    sum += std::pow(normal.dot(point - points.front()) / normal.dot(axis), 2);
  }
  return RangePrior::Plane{points.front(), normal,
                           std::sqrt(sum / static_cast<double>(points.size()))};
}

// Returns the options, completed by the scene's calibration.
LocalizerOptions WithCalibration(const Scene& scene, LocalizerOptions options) {
  if (scene.calibration == nullptr) return options;
  const SceneCalibration& known = *scene.calibration;
  if (!options.filter.multi_view_noise && options.filter.mode == FilterMode::kAuto &&
      options.candidates.mode != CandidateMode::kTriangulate) {
    options.filter.multi_view_noise = known.geometry_noise;
  }
  if (!options.estimator.scene_noise && UsesSceneNoise(options.estimator)) {
    options.estimator.scene_noise = known.match_noise;
  }
  return options;
}

}  // namespace

void LocalizedQuery::TakeEstimate(PoseEstimate taken) {
  estimate = std::move(taken);
  counts.inliers_2d3d = static_cast<size_t>(estimate.score_2d3d.num_inliers);
  counts.inliers_2d2d = static_cast<size_t>(estimate.score_2d2d.num_inliers);
}

FewPoints FewPointsFor(Method method) {
  return Needs2D3D(method) ? FewPoints::kKeepBest : FewPoints::kDropAll;
}

std::string ReasonNotLocalized(const PoseEstimate& estimate, double min_confidence) {
  if (!estimate.cam_from_world) {
    return std::string(ToString(estimate.failure));
  }
  if (!estimate.position_observable) {
    return "only the orientation is known: all references with matches share one center";
  }
  if (estimate.confidence < min_confidence) {
    return fmt::format("its pose is right with probability {:.2g} only, {} was asked for",
                       estimate.confidence, min_confidence);
  }
  return {};
}

Localizer::Localizer(std::shared_ptr<const Scene> scene, std::shared_ptr<const MatchSource> matches,
                     const LocalizerOptions& options)
    : Localizer(scene, std::move(matches), options,
                MakePoseEstimator(WithCalibration(*scene, options).estimator)) {
  own_estimator_ = true;
}

Localizer::Localizer(std::shared_ptr<const Scene> scene, std::shared_ptr<const MatchSource> matches,
                     const LocalizerOptions& options,
                     std::shared_ptr<const PoseEstimator> estimator)
    : scene_(std::move(scene)),
      matches_(std::move(matches)),
      options_(WithCalibration(*scene_, options)),
      estimator_(std::move(estimator)),
      own_estimator_(false) {
  RAYLIFT_CHECK(scene_ != nullptr && estimator_ != nullptr);
  options_.filter.thresholds.Validate();
  options_.candidates.Validate();
  geometry_ = scene_->Geometry();
  options_.filter.few_points = FewPointsFor(options.estimator.method);
}

bool Localizer::UsesSceneNoise() const {
  return own_estimator_ && !options_.estimator.scene_noise &&
         raylift::UsesSceneNoise(options_.estimator);
}

Localizer Localizer::WithSceneNoise(const SceneNoise& noise) const {
  RAYLIFT_CHECK(UsesSceneNoise());
  Localizer knowing = *this;
  knowing.options_.estimator.scene_noise = noise;
  knowing.estimator_ = MakePoseEstimator(knowing.options_.estimator);
  return knowing;
}

QueryResult Localizer::Localize(const Query& query) const { return Finish(Match(query)); }

QueryResult Localizer::Localize(const Query& query, const Image& photograph) const {
  return Finish(Match(query, photograph));
}

QueryResult Localizer::Localize(const Query& query, const Features& features) const {
  return Finish(Match(query, features));
}

QueryResult Localizer::Localize(const Query& query, QueryMatches matches) const {
  return Finish(Match(query, std::move(matches)));
}

QueryResult Localizer::Finish(QueryResult matched) const {
  Lift(matched);
  Filter(matched);
  Estimate(matched);
  return matched;
}

const MatchSource& Localizer::Source() const {
  if (matches_ == nullptr) throw InputError("there is no source of matches: they must be given");
  return *matches_;
}

template <typename MakeMatches>
QueryResult Localizer::Begin(const Query& query, const MakeMatches& make_matches) const {
  QueryResult result;
  LocalizedQuery& localized = result.localized;
  PoseProblem& problem = result.problem;
  localized.name = problem.name = query.name;
  problem.query_camera = query.camera;
  problem.priors = query.priors;
  const LapClock clock;
  QueryMatches matches = make_matches();
  problem.references = std::move(matches.references);
  problem.matches_2d2d = std::move(matches.matches);
  problem.search_area_px2 = matches.search_area_px2;
  if (scene_->covisibility != nullptr) {
    problem.reference_clusters = scene_->covisibility->Clusters(problem.references);
  }
  localized.times.match_ms += 1e3 * clock.Seconds();
  localized.counts.retrieved = problem.references.size();
  localized.counts.matched = problem.matches_2d2d.size();
  return result;
}

QueryResult Localizer::Match(const Query& query) const {
  return Begin(query, [&] { return Source().Match(query); });
}

QueryResult Localizer::Match(const Query& query, const Image& photograph) const {
  return Begin(query, [&] { return Source().MatchPhotograph(query, photograph); });
}

QueryResult Localizer::Match(const Query& query, const Features& features) const {
  return Begin(query, [&] { return Source().MatchFeatures(query, features); });
}

QueryResult Localizer::Match(const Query& query, QueryMatches matches) const {
  for (const Match2D2D& match : matches.matches) {
    if (match.reference < 0 || static_cast<size_t>(match.reference) >= matches.references.size()) {
      throw InputError(fmt::format("{}: a match is with reference {} of {}", query.name,
                                   match.reference, matches.references.size()));
    }
  }
  return Begin(query, [&] { return std::move(matches); });
}

void Localizer::Lift(QueryResult& result) const {
  PoseProblem& problem = result.problem;
  StageCounts& counts = result.localized.counts;
  const LapClock clock;
  if (options_.candidates.mode == CandidateMode::kTriangulate) {
    problem.matches_2d3d =
        TriangulateMatches(problem.references, problem.matches_2d2d, options_.candidates);
  } else {
    const LiftResult lifted = LiftMatches(PointersTo(geometry_), options_.geometry_mode,
                                          problem.references, problem.matches_2d2d);
    problem.matches_2d3d = Matches2D3D(lifted);
    counts.hit = lifted.counts.hits;
    counts.points_of_source = lifted.counts.points_of_source;
  }
  counts.points = problem.matches_2d3d.size();
  result.localized.times.lift_ms += 1e3 * clock.Seconds();
}

// Filters each candidate by itself, so that bad ones do not come into the merged point.
void Localizer::Filter(QueryResult& result) const {
  PoseProblem& problem = result.problem;
  StageCounts& counts = result.localized.counts;
  const LapClock clock;
  const FilterResult filtered = FilterProblem(options_.filter, problem);
  counts.filter = filtered.counts;
  counts.noise = filtered.noise;
  if (options_.candidates.mode == CandidateMode::kMerge) {
    problem.matches_2d3d = MergeCandidates(problem.references, problem.matches_2d2d,
                                           problem.matches_2d3d, options_.candidates);
  }
  counts.points = problem.matches_2d3d.size();
  result.localized.times.filter_ms += 1e3 * clock.Seconds();
}

PoseEstimate Localizer::EstimateProblem(PoseProblem& problem) const {
  constexpr int kLooks = 2;  // the second is from where the range has put the camera
  PoseEstimate estimate = estimator_->Estimate(problem);
  auto& range = problem.priors.range;
  // A custom estimator may not use ranges.
  const auto surface = range && own_estimator_ ? scene_->Surface() : nullptr;
  for (int i = 0; i < kLooks && surface != nullptr && estimate.cam_from_world; ++i) {
    const auto plane = PlaneAhead(*surface, estimate, range->range);
    if (!plane) break;
    range->plane = plane;
    estimate = estimator_->Estimate(problem);
  }
  return estimate;
}

void Localizer::Estimate(QueryResult& result) const {
  LocalizedQuery& localized = result.localized;
  const LapClock clock;
  localized.TakeEstimate(EstimateProblem(result.problem));
  localized.reason = ReasonOf(localized, options_.min_confidence);
  localized.times.estimate_ms += 1e3 * clock.Seconds();
}

void Localizer::EstimateRig(std::span<QueryResult> photographs,
                            std::span<const Rigid3> cam_from_rig) const {
  QueryResult& first = photographs.front();
  const LapClock clock;
  std::vector<const PoseProblem*> problems;
  for (const QueryResult& photograph : photographs) problems.push_back(&photograph.problem);
  PoseProblem joined = JoinProblems(problems, cam_from_rig);
  if (scene_->covisibility != nullptr) {
    joined.reference_clusters = scene_->covisibility->Clusters(joined.references);
  }
  const PoseEstimate estimate = EstimateProblem(joined);
  for (size_t i = 0; i < photographs.size(); ++i) {
    LocalizedQuery& localized = photographs[i].localized;
    localized.rig = joined.name;
    localized.estimate = EstimateOfCamera(joined, estimate, static_cast<int>(i));
    const auto count = [](const std::vector<bool>& inliers) {
      return static_cast<size_t>(std::count(inliers.begin(), inliers.end(), true));
    };
    localized.counts.inliers_2d3d = count(localized.estimate.inliers_2d3d);
    localized.counts.inliers_2d2d = count(localized.estimate.inliers_2d2d);
    localized.reason = ReasonNotLocalized(localized.estimate, options_.min_confidence);
  }
  first.rig_problem = std::move(joined);
  first.localized.times.estimate_ms += 1e3 * clock.Seconds();
}

bool Localizer::LiftsAlike(const Localizer& other) const {
  return geometry_ == other.geometry_ && options_.geometry_mode == other.options_.geometry_mode &&
         options_.candidates == other.options_.candidates;
}

bool Localizer::FiltersAlike(const Localizer& other) const {
  return options_.filter == other.options_.filter &&
         options_.candidates == other.options_.candidates;
}

}  // namespace raylift
