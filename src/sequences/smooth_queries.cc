#include "raylift/sequences/smooth_queries.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <system_error>
#include <utility>

#include "base/json_members.h"
#include "base/json_text.h"
#include "estimation/confidence/confidence.h"
#include "estimation/methods/methods.h"
#include "geometry/pose_json.h"
#include "io/scene/trajectory_file.h"
#include "io/text/line_tokens.h"
#include "localization/results/query_job.h"
#include "localization/results/result_json.h"
#include "sequences/chain.h"
#include "sequences/judgment.h"
#include "sequences/odometry.h"
#include "sequences/rematching.h"
#include "sequences/walked_query.h"
#include <Eigen/Cholesky>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/file.h"
#include "raylift/base/text.h"
#include "raylift/sequences/tracker.h"

namespace raylift {
namespace {

std::vector<WalkEvidence> EvidenceOf(std::span<const LocalizedQuery> queries, const Walk& walk) {
  std::vector<WalkEvidence> evidence;
  for (const WalkFrame& frame : walk.frames) {
    evidence.push_back({frame.cam_from_odometry, SinglePosesOf(queries[frame.query])});
  }
  return evidence;
}

// The smoothed frames of a walk; nullopt for a frame that the walk tells nothing of.
struct ToldFrames {
  SmoothedWalk walk;  // the last one that tells something, with the frames that it tells of
  std::vector<std::optional<SmoothedFrame>> frames = {};
};

// Smooths each frame by all frames or, online, by those up to it.
ToldFrames SmoothAll(std::span<const WalkEvidence> frames, const SmoothingOptions& options) {
  if (!options.online) {
    ToldFrames told{SmoothWalk(frames, options.scale)};
    told.frames.assign(told.walk.frames.begin(), told.walk.frames.end());
    return told;
  }
  WalkFilter filter(options.scale);
  ToldFrames told;
  std::vector<SmoothedFrame> newest;
  for (const WalkEvidence& frame : frames) {
    SmoothedWalk walk = filter.Add(frame);
    told.frames.emplace_back();
    if (!walk.frames.empty()) newest.push_back(told.frames.back().emplace(walk.frames.back()));
    if (!walk.frames.empty() || newest.empty()) told.walk = std::move(walk);
  }
  told.walk.frames = std::move(newest);
  return told;
}

// Removes the inliers and the camera of a pose that the photograph no longer has: they say nothing
// of the walk's.
void ForgetInliers(PoseEstimate& estimate) {
  for (MatchSetScore* score : {&estimate.score_2d3d, &estimate.score_2d2d}) {
    *score = {score->num_matches, 0, static_cast<double>(score->num_matches)};
  }
  estimate.inliers_2d3d.assign(estimate.inliers_2d3d.size(), false);
  estimate.inliers_2d2d.assign(estimate.inliers_2d2d.size(), false);
  estimate.inlier_keypoints = 0;
  estimate.refined_camera.reset();
}

// Returns whether the walk agrees with the photograph's own pose, not with an alternative of it.
bool AgreesWithOwn(const SmoothedFrame& frame) { return Agrees(frame) && frame.single == 0; }

// Returns the probability that a position is right, and the direction as well: a turn moves the
// picture as a shift by that share of the distance does. The distance is 0 where it is not known.
double ProbabilityOfPlace(const Matrix6d& covariance, double distance) {
  const double position = std::sqrt(covariance.bottomRightCorner<3, 3>().trace());
  const double turn = std::sqrt(covariance.topLeftCorner<3, 3>().trace());
  return std::min(ProbabilityOfPosition(distance > 0 ? position : 0, distance),
                  ProbabilityOfPosition(turn, 1));
}

// Returns the probability that the walk, and not the photograph by itself, has the frame's pose.
double ConfidenceOf(const SmoothedFrame& frame) { return frame.confidence * frame.against_own; }

// Returns the estimate of the walk's pose of a photograph, with how sure it is.
PoseEstimate EstimateOf(const SmoothedFrame& frame, const Query& photograph,
                        const SceneDistances& distances, const LocalizedQuery& single) {
  PoseEstimate estimate = single.estimate;
  if (!estimate.cam_from_world) {  // files have no scores of it
    estimate.score_2d3d = estimate.score_2d2d = {};
    estimate.ransac_value = estimate.refined_value = 0;
  }
  estimate.failure = FailureReason::kNone;
  estimate.position_observable = true;
  estimate.cam_from_world = frame.cam_from_world;
  SetCovariance(frame.covariance, estimate);
  const double distance = distances.At(photograph.camera, frame.cam_from_world).value_or(0);
  double of_position = ProbabilityOfPlace(frame.covariance, distance);
  // What was found where it is predicted may be wrong, and then leaves the prediction; a pose of its
  // own that agrees tells as well that it is right.
  if (IsRematched(frame) && !Agrees(frame)) {
    const double without =
        frame.predicted ? ProbabilityOfPlace(frame.predicted->covariance, distance) : 0;
    of_position = std::min(of_position, std::max(frame.rematched_agrees, without));
  }
  // The walk does not make less sure what the photograph's own matches tell.
  if (AgreesWithOwn(frame)) of_position = std::max(of_position, single.confidence());
  Conclude(ConfidenceOf(frame), of_position, estimate);
  return estimate;
}

std::vector<std::string> WarningsOf(const SmoothedWalk& walk) {
  if (!walk.scale_is_observable) {
    return {
        "the odometry's unknown scale is not observable, as no three photographs of the walk have "
        "poses that lie apart and agree on one: the results are those of single photographs"};
  }
  if (walk.frames.empty()) {
    return {
        "the walk tells nothing, as no photograph of it has a pose with a covariance: the results "
        "are those of single photographs"};
  }
  if (!walk.contradicting_scale) return {};
  return {fmt::format(
      "the odometry's unit seems to be {:.4g} of the scene's by the photographs' poses, which "
      "contradict its scale: odometry_scale = unknown finds it",
      *walk.contradicting_scale)};
}

// Returns which of the camera's directions an axis of the odometry's body has.
std::string_view DirectionOf(const Eigen::Vector3d& axis_in_cam) {
  constexpr std::array<std::string_view, 6> kNames = {"left",  "up",   "backward",
                                                      "right", "down", "forward"};
  Eigen::Index axis = 0;
  axis_in_cam.cwiseAbs().maxCoeff(&axis);
  return kNames[static_cast<size_t>(axis + (axis_in_cam[axis] > 0 ? 3 : 0))];
}

// Says how the odometry's poses should be read.
std::string TextOf(const OdometryReading& reading, const Rigid3& cam_from_body) {
  const Eigen::Matrix3d& axes = reading.cam_from_body;
  std::string text =
      reading.inverted ? "inverted, world to camera in place of camera to world" : "";
  if (axes.isIdentity()) return text;
  text += fmt::format("{}of a camera with x {}, y {}, z {}", reading.inverted ? ", and " : "",
                      DirectionOf(axes.col(0)), DirectionOf(axes.col(1)), DirectionOf(axes.col(2)));
  const Rigid3 turned = Rigid3{Eigen::Quaterniond(axes), Eigen::Vector3d::Zero()} * cam_from_body;
  return reading.inverted ? text : fmt::format("{} (cam_from_body = {})", text, FormatPose(turned));
}

std::optional<std::string> WarningOfAxes(std::span<const WalkEvidence> frames, const Walk& walk) {
  const auto better = FindBetterReading(frames);
  if (!better) return std::nullopt;
  return fmt::format(
      "the odometry's poses seem to be {}: read so, the directions in which the camera moves and "
      "turns lie {:.2g} degrees from those of the photographs' poses (median), as they were read "
      "{:.0f}",
      better->reading ? TextOf(*better->reading, walk.cam_from_body)
                      : "of a camera with other axes than x right, y down, z forward, or inverted, "
                        "which so straight a way does not tell apart",
      better->median_deg, better->median_deg_as_read);
}

// Returns how many photographs of the folder have which role.
nlohmann::ordered_json RolesJson(const WalkedQueries& walked, const std::string& folder) {
  nlohmann::ordered_json json = nlohmann::ordered_json::object();
  for (const EnumName<WalkRole>& role : kEnumNames<WalkRole>) {
    json[std::string(role.name)] =
        std::count_if(walked.queries.begin(), walked.queries.end(), [&](const WalkedQuery& query) {
          return query.role == role.value && query.localized.name.starts_with(folder);
        });
  }
  return json;
}

// Adds what is known of the odometry where the walk told something.
void AddOdometry(const std::optional<SmoothedWalk>& walk, nlohmann::ordered_json& json) {
  if (!walk) return;
  const auto lost = std::count_if(walk->frames.begin(), walk->frames.end(),
                                  [](const SmoothedFrame& frame) { return frame.lost_before; });
  json["odometry"] = {{"scale", walk->scale},
                      {"scale_sigma", walk->scale_sigma},
                      {"step_sigma", walk->step_sigma},
                      {"step_rotation_sigma_deg", walk->step_rotation_sigma_deg},
                      {"lost", lost}};
  json["single_sigma_factor"] = walk->single_sigma_factor;
}

// Returns the files of a walk's trajectory: those of a list's walks are numbered from 1.
TrajectoryFiles FilesOf(const WalkedQueries& walked, size_t walk) {
  return TrajectoryFilesOf(walked.walks[walk].folder.empty() ? 0 : walk + 1);
}

void WriteTrajectory(const std::filesystem::path& folder, const WalkedQueries& walked,
                     size_t walk) {
  std::vector<TimedPose> poses;
  std::string covariances = "# timestamp, covariance of the step (w, v): upper triangle by rows\n";
  for (const size_t i : walked.walks[walk].queries) {
    const WalkedQuery& query = walked.queries[i];
    if (!query.localized.localized()) continue;
    const PoseEstimate& estimate = query.localized.estimate;
    poses.push_back({*query.time_s, *estimate.cam_from_world});
    if (!estimate.covariance) continue;
    covariances += FormatDouble(*query.time_s);
    for (Eigen::Index row = 0; row < 6; ++row) {
      for (Eigen::Index column = row; column < 6; ++column) {
        covariances += ' ' + FormatDouble((*estimate.covariance)(row, column));
      }
    }
    covariances += '\n';
  }
  const TrajectoryFiles files = FilesOf(walked, walk);
  WriteTumTrajectory(folder / files.poses, poses);
  WriteFile(folder / files.covariances, covariances);
}

// Returns the text of walk.json: what the walks told.
std::string FormatWalk(const WalkedQueries& walked) {
  nlohmann::ordered_json json = {{"photographs", RolesJson(walked, "")}};
  for (size_t i = 0; i < walked.walks.size(); ++i) {
    const ToldWalk& walk = walked.walks[i];
    if (walk.folder.empty()) {
      AddOdometry(walk.odometry, json);
      continue;
    }
    nlohmann::ordered_json& part = json["walks"].emplace_back();
    part = {{"folder", walk.folder},
            {"trajectory", FilesOf(walked, i).poses},
            {"photographs", RolesJson(walked, walk.folder)}};
    AddOdometry(walk.odometry, part);
  }
  return JsonText(json, 2) + '\n';
}

void RemoveFiles(const std::filesystem::path& folder, std::span<const std::string> names) {
  std::error_code ignored;
  for (const std::string& name : names) std::filesystem::remove(folder / name, ignored);
}

// Smooths the results of a walk's photographs.
void SmoothWalkOf(const Walk& walk, std::span<const LocalizedQuery> queries,
                  std::span<const Query> photographs, const SceneDistances& distances,
                  const SmoothingOptions& options, WalkedQueries& walked) {
  ToldWalk& told = walked.walks.emplace_back();
  told.folder = walk.folder;
  for (const WalkFrame& frame : walk.frames) {
    walked.queries[frame.query].time_s = frame.time_s;
    told.queries.push_back(frame.query);
  }
  // Warnings of a list's walks name their walk.
  const auto warn = [&](const std::string& warning) {
    walked.warnings.push_back((walk.folder.empty() ? "" : walk.folder + ": ") + warning);
  };
  walked.warnings.insert(walked.warnings.end(), walk.warnings.begin(), walk.warnings.end());
  std::vector<WalkEvidence> evidence = EvidenceOf(queries, walk);
  if (const auto warning = WarningOfAxes(evidence, walk)) warn(*warning);
  ToldFrames frames = SmoothAll(evidence, options);
  if (options.open_localizer && !options.online) {
    std::vector<std::string> warnings;
    RematchFrames({walk, queries, photographs, distances}, options, evidence, frames.walk,
                  warnings);
    frames.frames.assign(frames.walk.frames.begin(), frames.walk.frames.end());
    for (const std::string& warning : warnings) warn(warning);
  }
  for (const std::string& warning : WarningsOf(frames.walk)) warn(warning);
  for (size_t i = 0; i < frames.frames.size(); ++i) {
    if (!frames.frames[i]) continue;
    const size_t query = walk.frames[i].query;
    TakeFromWalk(*frames.frames[i], photographs[query], distances, options.min_confidence,
                 walked.queries[query]);
  }
  if (!frames.walk.frames.empty()) told.odometry = std::move(frames.walk);
}

}  // namespace

static void Members(JsonMembers& members, WalkedQuery& query) {
  members("role", query.role);
  members("time_s", query.time_s);
  members("lost_before", query.lost_before);
  members("rematched", query.rematched);
  members("single_confidence", query.single_confidence);
  members("single_cam_from_world", query.single_cam_from_world);
}

std::vector<SinglePose> SinglePosesOf(const LocalizedQuery& query) {
  const PoseEstimate& estimate = query.estimate;
  std::vector<SinglePose> singles;
  if (!query.localized()) return singles;
  const auto add = [&](const Rigid3& pose, const std::optional<Matrix6d>& covariance,
                       double probability) {
    if (!covariance) return;
    const Eigen::LLT<Matrix6d> factored(*covariance);
    constexpr double kSingular = 1e-15;
    if (factored.info() != Eigen::Success || !(factored.rcond() > kSingular)) return;
    singles.push_back({pose, *covariance, probability});
  };
  add(*estimate.cam_from_world, estimate.covariance, estimate.confidence);
  if (singles.empty()) return singles;
  for (const AlternativePose& other : estimate.alternatives) {
    if (singles.size() == kMostSinglePoses) break;
    add(other.cam_from_world, other.covariance, other.probability);
  }
  return singles;
}

void TakeFromWalk(const SmoothedFrame& frame, const Query& photograph,
                  const SceneDistances& distances, double min_confidence, WalkedQuery& query) {
  LocalizedQuery& localized = query.localized;
  const bool had_pose = localized.localized();
  const bool agrees = had_pose && AgreesWithOwn(frame);
  // A photograph that told the walk nothing takes its pose only where that is more likely right
  // than wrong.
  if (SinglePosesOf(localized).empty() && frame.confidence < 0.5) return;
  query.lost_before = frame.lost_before;
  if (had_pose) {
    query.single_cam_from_world = localized.estimate.cam_from_world;
    query.single_confidence = localized.confidence();
  }
  if (frame.confidence <= kLeastConfidence) {
    query.role = WalkRole::kDropped;
    localized.reason = "its pose contradicts those of its walk";
    return;
  }
  if (!agrees && had_pose && ConfidenceOf(frame) < 0.5) {
    // One of two poses at most is right. A pose without a covariance contradicts nothing.
    if (SinglePosesOf(localized).empty()) return;
    query.role = WalkRole::kDisputed;
    Conclude(std::min(localized.confidence(), 1 - ConfidenceOf(frame)), 1, localized.estimate);
    localized.reason = ReasonNotLocalized(localized.estimate, min_confidence);
    return;
  }
  PoseEstimate estimate = EstimateOf(frame, photograph, distances, localized);
  if (!agrees && estimate.confidence <= kLeastConfidence) return;
  query.role =
      !had_pose ? WalkRole::kRescued : (agrees ? WalkRole::kSmoothed : WalkRole::kReplaced);
  query.rematched = IsRematched(frame);
  if (!agrees) ForgetInliers(estimate);
  // A pose that the walk makes sure, or another pose, has no alternatives.
  if (!agrees || estimate.verdict == PoseVerdict::kLocalized) estimate.alternatives.clear();
  localized.TakeEstimate(std::move(estimate));
  localized.reason = ReasonNotLocalized(localized.estimate, min_confidence);
}

size_t WalkedQueries::Count(WalkRole role) const {
  return static_cast<size_t>(
      std::count_if(queries.begin(), queries.end(),
                    [&](const WalkedQuery& query) { return query.role == role; }));
}

WalkedQueries SmoothQueries(std::span<const LocalizedQuery> queries,
                            std::span<const Query> photographs, std::span<const Walk> walks,
                            const SceneDistances& distances, const SmoothingOptions& options) {
  RAYLIFT_CHECK_EQ(queries.size(), photographs.size());
  WalkedQueries walked;
  for (const LocalizedQuery& query : queries) walked.queries.push_back({query});
  for (const Walk& walk : walks) {
    SmoothWalkOf(walk, queries, photographs, distances, options, walked);
  }
  return walked;
}

std::string FormatQueryDiagnostics(const WalkedQuery& query) {
  auto json = ToJson(query.localized);
  SetMember(json, "walk", ToJson(query));
  return JsonText(std::move(json));
}

void WriteWalk(const std::filesystem::path& folder, const WalkedQueries& walked) {
  // All files that exist are named by walk.json at all times, lest a run that is killed leaves
  // others.
  std::vector<std::string> former = WalkFilesIn(folder);
  for (size_t i = 0; i < walked.walks.size(); ++i) {
    const TrajectoryFiles files = FilesOf(walked, i);
    std::erase_if(former, [&](const std::string& name) {
      return name == files.poses || name == files.covariances || name == kWalkFile;
    });
  }
  RemoveFiles(folder, former);
  WriteFile(folder / kWalkFile, FormatWalk(walked));
  for (size_t i = 0; i < walked.walks.size(); ++i) WriteTrajectory(folder, walked, i);
}

void RemoveWalk(const std::filesystem::path& folder) { RemoveFiles(folder, WalkFilesIn(folder)); }

}  // namespace raylift
