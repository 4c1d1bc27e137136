#include "localization/continuous/continuous_localizer.h"

#include <algorithm>
#include <numeric>
#include <optional>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/error.h"
#include "raylift/localization/result_files.h"

namespace raylift {

namespace {

using Json = nlohmann::ordered_json;

// Returns the scene in which joined queries are references, too.
std::shared_ptr<const Scene> WithJoined(const Scene& scene,
                                        const std::shared_ptr<const JoinedReferences>& joined) {
  auto growing = std::make_shared<Scene>(scene);
  growing->covisibility = nullptr;
  auto links = JoinedGeometry::Links::kGive;
  for (SceneSource& source : growing->sources) {
    source.geometry.source =
        std::make_shared<JoinedGeometry>(std::move(source.geometry.source), joined, links);
    links = JoinedGeometry::Links::kLeaveOut;
  }
  return growing;
}

// A scene whose references grow, and a localizer for its present state.
class GrowingScene {
 public:
  GrowingScene(const Scene& scene, std::shared_ptr<MatchSource> matches,
               const LocalizerOptions& options, bool weigh)
      : source_(std::move(matches)),
        joined_(std::make_shared<JoinedReferences>(weigh)),
        localizer_(WithJoined(scene, joined_), std::make_shared<WeighedMatches>(source_, joined_),
                   options) {}

  const Localizer& localizer() const { return localizer_; }
  const JoinedReferences& joined() const { return *joined_; }

  void Join(const JoinedReference& reference) {
    joined_->Add(reference);
    source_->Join(reference.image);
  }

 private:
  std::shared_ptr<MatchSource> source_;
  std::shared_ptr<JoinedReferences> joined_;
  Localizer localizer_;
};

// Estimates by both solvers where both have the matches that they need.
std::optional<SolverPoses> AskSolvers(const QueryResult& result, const EstimatorOptions& estimator,
                                      const ContinuousRun& run) {
  if (JoinsAsInPaper(estimator) || !run.gate.needs_agreement ||
      result.problem.matches_2d3d.empty()) {
    return std::nullopt;
  }
  const PoseEstimate& estimate = result.localized.estimate;
  if (estimate.p3p_cam_from_world && estimate.e5p1_cam_from_world) {
    return SolverPoses{estimate.p3p_cam_from_world, estimate.e5p1_cam_from_world};
  }
  return EstimateBySolvers(result.problem, estimator, run.threads);
}

size_t CountJoined(const PoseProblem& problem, const JoinedReferences& joined) {
  size_t count = 0;
  for (const PosedImage& reference : problem.references) {
    count += joined.Contains(reference.name) ? 1 : 0;
  }
  return count;
}

// Decides on a query that was just localized.
JoinDecision Decide(const QueryResult& result, size_t place, const GrowingScene& scene,
                    const ContinuousRun& run) {
  const PoseEstimate& estimate = result.localized.estimate;
  JoinDecision decision;
  Json json = Json::parse(FormatQueryDiagnostics(result.localized));
  json["place_in_order"] = place;
  json["retrieved_joined"] = CountJoined(result.problem, scene.joined());
  std::string reason = "not localized";
  if (result.localized.localized()) {
    const EstimatorOptions& estimator = scene.localizer().options().estimator;
    const JoinEvidence evidence =
        CollectEvidence(result, scene.joined(), AskSolvers(result, estimator, run));
    reason = JoinsAsInPaper(estimator) ? "" : ReasonNotToJoin(evidence, run.gate);
    if (evidence.difference_deg) {
      json["solvers_differ_deg"] = *evidence.difference_deg;
      json["solvers_differ_position"] = *evidence.difference_position;
    }
    if (evidence.covariance) {
      json["joint_rotation_sigma_deg"] = evidence.rotation_sigma_deg;
      json["joint_position_sigma"] = evidence.position_sigma;
    }
    if (reason.empty()) {
      decision.joined = {.image = {result.localized.name,
                                   estimate.refined_camera.value_or(result.problem.query_camera),
                                   *estimate.cam_from_world},
                         .covariance = evidence.covariance,
                         .distance = evidence.distance,
                         .links = LinksOfInliers(result)};
    }
  }
  json["joined"] = reason.empty();
  json["not_joined_because"] = reason;
  decision.diagnostics = json.dump();
  return decision;
}

}  // namespace

void LocalizeContinuously(std::span<const Query> queries, const Scene& scene,
                          std::shared_ptr<MatchSource> matches, const LocalizerOptions& options,
                          const ContinuousRun& run) {
  RAYLIFT_CHECK_EQ(run.order.size(), queries.size());
  GrowingScene growing(scene, std::move(matches), options,
                       run.weigh && !JoinsAsInPaper(options.estimator));
  for (size_t place = 0; place < run.order.size(); ++place) {
    const size_t query = run.order[place];
    if (const auto done = run.done.find(query); done != run.done.end()) {
      if (done->second) growing.Join(*done->second);
      continue;
    }
    if (run.stop != nullptr && *run.stop) return;
    QueryResult result = growing.localizer().Localize(queries[query]);
    if (run.on_localized) run.on_localized(query, result);
    const JoinDecision decision = Decide(result, place, growing, run);
    if (run.on_done) run.on_done(query, result, decision);
    if (decision.joined) growing.Join(*decision.joined);
  }
}

namespace {

std::optional<double> OldestOf(std::span<const PosedImage> images, const CaptureTimes& times) {
  std::optional<double> oldest;
  for (const PosedImage& image : images) {
    const auto time = times.find(image.name);
    if (time == times.end()) continue;
    oldest = std::min(oldest.value_or(time->second), time->second);
  }
  return oldest;
}

}  // namespace

std::vector<size_t> OrderByTime(std::span<const Query> queries,
                                std::span<const PosedImage> references, const CaptureTimes& times,
                                const std::filesystem::path& path_for_messages) {
  std::vector<double> time_of_query;
  for (const Query& query : queries) {
    const auto time = times.find(query.name);
    if (time == times.end()) {
      throw InputError(path_for_messages,
                       fmt::format("there is no time of the query \"{}\"", query.name));
    }
    time_of_query.push_back(time->second);
  }
  const auto oldest_reference = OldestOf(references, times);
  const auto is_older = [&](size_t i) {
    return oldest_reference && time_of_query[i] < *oldest_reference;
  };
  std::vector<size_t> order = OrderByName(queries);
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
    if (is_older(a) != is_older(b)) return is_older(a);
    return is_older(a) ? time_of_query[a] > time_of_query[b] : time_of_query[a] < time_of_query[b];
  });
  return order;
}

}  // namespace raylift
