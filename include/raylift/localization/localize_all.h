// Localizes all queries of a list in one scene, by one configuration (options of the localizer) or
// by several at once, for comparisons. A scene without a calibration is calibrated first; then the
// result of a query depends on no other query's. The stages:
//
//   calibrate   depth and noise, by matches that are kept for their query's own turn
//   localize    match, lift, filter, estimate (localizer.h); what configurations have in common is
//               made once, so that what differs in the results is what differs in them. Photographs
//               of one frame of a rig (Query::rig) are localized together
//   rerender    sharpens the pose against the rendered mesh, where asked for
//   check       asks what the photographs say of their focal length, and how the input is read
//
// LocalizeContinuously() takes the queries one after the other, and adds the stage
//
//   join        a query that is localized well becomes a reference of those that follow

#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/lifting/depth_alignment.h"
#include "raylift/localization/localizer.h"
#include "raylift/localization/scene.h"

namespace raylift {

class FocalCheck;
class QuickDoctor;
class Rerenderer;
struct ContinuousRun;

struct LocalizeAllOptions {
  LocalizerOptions localizer = {};
  // The correction of depth in a scene without a calibration (CalibrationOptions::align).
  AlignMode align = AlignMode::kAuto;
  // This is null where poses are not refined by rendering the mesh again.
  std::shared_ptr<const Rerenderer> rerenderer = nullptr;
  bool check_input = true;
  // For RunContinuously(): the match noise is not learned from queries, as the first ones must not
  // depend on later ones.
  bool one_by_one = false;
  int threads = 0;
};

class LocalizeAll {
 public:
  LocalizeAll(const Scene& scene, std::vector<Query> queries, std::shared_ptr<MatchSource> matches,
              const LocalizeAllOptions& options);
  // Takes several configurations of scenes with the same references, at least one; runs them
  // without the stages after the pose. The localizers' own sources of matches are not used.
  LocalizeAll(std::vector<Localizer> configurations, std::vector<Query> queries,
              std::shared_ptr<const MatchSource> matches, int threads);
  ~LocalizeAll();

  // Learns the scene's calibration where it has none, or the match noise for each of several
  // configurations. The functions below begin with it.
  void Calibrate();

  // Returns the scene, calibrated once Calibrate() is done.
  const Scene& scene() const { return configurations_.front().scene(); }
  const std::vector<Query>& queries() const { return queries_; }
  const Localizer& configuration(size_t index) const { return configurations_[index]; }

  // Localizes in parallel; returns the results in the order of the list. `on_result` is called from
  // any thread.
  using OnResult = std::function<void(size_t query, const QueryResult& result)>;
  std::vector<LocalizedQuery> Run(const OnResult& on_result = {});
  // Localizes some of the queries; a frame's photographs help each other even where some of them
  // are not asked for. With `stop`, queries that have begun are finished and no other is begun.
  void Run(std::span<const size_t> queries, const OnResult& on_result,
           const std::atomic<bool>* stop = nullptr);

  // Localizes a query again by its matches with these references of the scene, best first, near
  // where they are seen from `cam_from_world`, which is about its pose and has this covariance. The
  // estimate is what the matches say without that. Thread safe after Calibrate().
  LocalizedQuery LocalizeAgain(const Query& query, std::span<const size_t> references,
                               const Rigid3& cam_from_world,
                               const Eigen::Matrix<double, 6, 6>& covariance) const;

  // Localizes the queries one after the other (continuous/continuous_localizer.h).
  void RunContinuously(ContinuousRun run);

  // Localizes one query by each of the configurations and hands over each result; the calls may
  // come in any order and, for different configurations, from several threads. Thread safe after
  // Calibrate().
  using Take = std::function<void(size_t configuration, QueryResult& result)>;
  void LocalizeQuery(size_t query, int threads, const Take& take) const;

  // Returns ln(assumed / true focal length) of a localized query, as estimated; nullopt where it
  // was not.
  std::optional<double> LogFocalFactor(size_t query) const { return log_focal_factors_[query]; }

  // Returns the warnings of the matches that were made so far, sorted.
  std::vector<std::string> MatchWarnings() const;
  // Returns warnings on the reading of geometry and poses, from some 30 queries; empty where it is not
  // checked.
  std::vector<std::string> InputWarnings();
  // Returns whether the geometry is to be judged by all results (RunWarnings()).
  bool ChecksGeometry() const;

 private:
  // Configurations that filter alike, among those that lift alike.
  using Filtered = std::vector<size_t>;
  using Lifted = std::vector<Filtered>;
  // Queries that are localized together: the photographs of a frame, by their sensors, or one.
  using Frame = std::vector<size_t>;

  void MakeTree();
  void LearnMatchNoise();
  void LocalizeMatched(const QueryResult& matched, std::span<const size_t> configurations,
                       int threads, const Take& take) const;
  std::vector<Frame> FramesOf(std::span<const size_t> queries) const;
  std::vector<QueryResult> LocalizeFrame(const Frame& frame) const;
  void Complete(size_t query, QueryResult& result);
  void Rerender(const Query& query, QueryResult& result) const;
  std::vector<ReferenceMatch> MatchesAmongReferences() const;
  std::vector<std::string> DoctorWarnings() const;

  LocalizeAllOptions options_;
  std::vector<Query> queries_;
  std::shared_ptr<MatchSource> matches_;       // for queries that join; null: none can
  std::shared_ptr<const MatchSource> cached_;  // the same, while no query joins
  std::vector<Localizer> configurations_;
  std::vector<Lifted> tree_;
  bool is_calibrated_ = false;
  std::unique_ptr<QuickDoctor> doctor_;
  std::unique_ptr<FocalCheck> focal_check_;
  std::vector<std::optional<double>> log_focal_factors_;
};

}  // namespace raylift
