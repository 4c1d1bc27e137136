// Localizes one query in four stages, each of which can be called by itself:
//
//   Match     the query's 2D-2D matches with retrieved references
//   Lift      each matched reference keypoint to the 3D point that it shows (or triangulates)
//   Filter    drops points that the references disagree on; merges those of one keypoint
//   Estimate  the pose, from both match sets
//
// Each stage adds to the QueryResult of those before it, with its counts and its time, so that a
// failure explains itself.

#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/lifting/consistency_filter.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/lifting/lifter.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/scene.h"
#include "raylift/scene/photographs.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

struct StageCounts {
  size_t retrieved = 0;  // references
  size_t matched = 0;    // 2D-2D matches
  size_t hit = 0;        // of those, lifted to the scene
  // The 3D points that each source of geometry gave; their sum is `hit` unless all are asked.
  std::vector<size_t> points_of_source;
  FilterCounts filter;                  // of the points, kept and dropped by the filter
  std::optional<MultiViewNoise> noise;  // as the automatic filter found it
  size_t points = 0;                    // 2D-3D matches that were estimated from
  size_t inliers_2d3d = 0;
  size_t inliers_2d2d = 0;
};

// The time that each stage of a query took.
struct StageTimes {
  double match_ms = 0;
  double lift_ms = 0;
  double filter_ms = 0;
  double estimate_ms = 0;
  double rerender_ms = 0;
};

struct LocalizedQuery {
  std::string name;
  std::string rig;     // where it is one of a rig's photographs: the name of the one whose camera's
                       // pose was estimated
  std::string reason;  // why there is no pose; empty where there is one
  StageCounts counts;
  PoseEstimate estimate;
  StageTimes times;
  std::optional<int> rerender_rounds;  // that were kept; none where it was not asked for

  // Returns whether the query is localized: its whole pose is known.
  bool localized() const { return reason.empty(); }
  PoseVerdict verdict() const { return localized() ? estimate.verdict : PoseVerdict::kFailed; }
  double confidence() const { return localized() ? estimate.confidence : 0; }
  // Takes an estimate and counts its inliers.
  void TakeEstimate(PoseEstimate taken);
};

// Returns why an estimate is no localization; empty where it is one.
std::string ReasonNotLocalized(const PoseEstimate& estimate, double min_confidence = 0);

struct QueryResult {
  LocalizedQuery localized;
  PoseProblem problem;  // what is estimated; of a rig's photograph its own part of it
  // The whole problem of a rig, with the photograph whose camera's pose was estimated.
  std::optional<PoseProblem> rig_problem = std::nullopt;
};

// Returns what the automatic filter does with few points for a method: methods that use points
// alone keep the best, while others drop all, as a handful of noisy points only disturbs them.
FewPoints FewPointsFor(Method method);

// Where options leave noise open, that of the scene's calibration is used.
struct LocalizerOptions {
  EstimatorOptions estimator = {};
  // `filter.few_points` is set by the method.
  FilterOptions filter = {};
  GeometryMode geometry_mode = GeometryMode::kFirst;
  // Queries whose PoseEstimate::confidence is lower are not localized.
  double min_confidence = 0;
  CandidateOptions candidates = {};  // merged are those that the filter keeps
};

// A localizer is cheap to copy and thread safe: no call changes it.
class Localizer {
 public:
  // The scene is taken as it is now: it must not change afterwards. `matches` may be null where
  // matches are always given. Throws OptionError where options are out of range.
  Localizer(std::shared_ptr<const Scene> scene, std::shared_ptr<const MatchSource> matches,
            const LocalizerOptions& options);
  // Takes an estimator of the caller's; options.estimator then only tells which matches it can do
  // without.
  Localizer(std::shared_ptr<const Scene> scene, std::shared_ptr<const MatchSource> matches,
            const LocalizerOptions& options, std::shared_ptr<const PoseEstimator> estimator);

  // Run all stages.
  QueryResult Localize(const Query& query) const;                           // known by its name
  QueryResult Localize(const Query& query, const Image& photograph) const;  // gray or RGB
  QueryResult Localize(const Query& query, const Features& features) const;
  QueryResult Localize(const Query& query, QueryMatches matches) const;

  // Runs the stages after Match().
  QueryResult Finish(QueryResult matched) const;

  // Run the stages, in this order. Match() begins a result, the others go on with it. Throw
  // InputError where given matches name a reference that is not among theirs.
  QueryResult Match(const Query& query) const;
  QueryResult Match(const Query& query, const Image& photograph) const;
  QueryResult Match(const Query& query, const Features& features) const;
  QueryResult Match(const Query& query, QueryMatches matches) const;
  void Lift(QueryResult& result) const;
  void Filter(QueryResult& result) const;
  void Estimate(QueryResult& result) const;
  // Runs the last stage for the photographs of a rig, as one problem: each gets its own camera's
  // pose. The first photograph's pose is estimated, and the priors are those of that pose.
  void EstimateRig(std::span<QueryResult> photographs, std::span<const Rigid3> cam_from_rig) const;

  const Scene& scene() const { return *scene_; }
  const std::shared_ptr<const MatchSource>& matches() const { return matches_; }
  const LocalizerOptions& options() const { return options_; }
  const PoseEstimator& estimator() const { return *estimator_; }

  // Return whether the estimates use noise that the scene's queries have in common and that is not
  // known yet; and the same localizer with that noise.
  bool UsesSceneNoise() const;
  Localizer WithSceneNoise(const SceneNoise& noise) const;

  // Return whether the other localizer's stage gives the same from the same.
  bool LiftsAlike(const Localizer& other) const;
  bool FiltersAlike(const Localizer& other) const;

 private:
  const MatchSource& Source() const;
  // Adds to the problem, where a range is known, the surface that it is of, and estimates the pose.
  PoseEstimate EstimateProblem(PoseProblem& problem) const;
  template <typename MakeMatches>
  QueryResult Begin(const Query& query, const MakeMatches& make_matches) const;

  std::shared_ptr<const Scene> scene_;
  std::shared_ptr<const MatchSource> matches_;
  LocalizerOptions options_;
  std::shared_ptr<const PoseEstimator> estimator_;
  bool own_estimator_;                                           // made from the options
  std::vector<std::shared_ptr<const GeometrySource>> geometry_;  // the scene's
};

}  // namespace raylift
