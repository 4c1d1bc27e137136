#include "localization/results/result_json.h"

#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "estimation/fields.h"
#include "geometry/pose_json.h"
#include "localization/fields.h"
#include <fmt/format.h>

#include "raylift/io/query_list.h"

namespace raylift {
namespace {

// Writes a median or null: that of no values is not a number.
void MemberOrNull(JsonMembers& members, const char* name, double& median) {
  std::optional<double> known;
  if (!std::isnan(median)) known = median;
  members(name, known);
  median = known.value_or(std::numeric_limits<double>::quiet_NaN());
}

template <typename Record>
void Medians(JsonMembers& members, Record& record) {
  MemberOrNull(members, "median_before_px", record.median_before_px);
  MemberOrNull(members, "median_after_px", record.median_after_px);
}

}  // namespace

void Members(JsonMembers& members, KnownNoise& noise) {
  members("sigma", noise.sigma);
  members("errors", noise.errors);
}

void Members(JsonMembers& members, SceneNoise& noise) {
  members("keypoint_px", noise.keypoint_px);
  members("depth", noise.depth);
  members("common_depth", noise.common_depth);
  members("keypoint_tail", noise.keypoint_tail);
  members("keypoint_tail_variance", noise.keypoint_tail_variance);
  const auto if_known = [&](const char* name, KnownNoise& known) {
    members.If(known.errors > 0, name, known);
  };
  if_known("reference_factor", noise.reference_factor);
  if_known("reference_rotation_deg", noise.reference_rotation_deg);
  if_known("reference_position", noise.reference_position);
}

void Members(JsonMembers& members, MultiViewNoise& noise) {
  members("keypoints_px", noise.keypoints_px);
  members("geometry_px", noise.geometry_px);
  members("num_views", noise.num_views);
}

void Members(JsonMembers& members, MapAlignment& map) {
  auto& [columns, rows, log_factors, shift] = map.correction;
  members("reference", map.reference);
  members("columns", columns);
  members("rows", rows);
  members("log_factors", log_factors);
  members("shift", shift);
  members("matches", map.num_matches);
  members("own_correction", map.own_correction);
  Medians(members, map);
  if (columns < 1 || rows < 1 ||
      log_factors.size() != static_cast<size_t>(columns) * static_cast<size_t>(rows)) {
    members.Fail("log_factors", fmt::format("of {}: expected {} x {} numbers, found {}",
                                            map.reference, columns, rows, log_factors.size()));
  }
}

void Members(JsonMembers& members, DepthAlignment& alignment) {
  members("mode", alignment.mode);
  members("median_factor", alignment.median_factor);
  Medians(members, alignment);
  members("maps", alignment.maps);
}

void Members(JsonMembers& members, ConfidenceWorth::Knot& knot) {
  members("confidence", knot.confidence);
  members("sigma", knot.sigma);
}

void ExpectRising(JsonMembers& members, const std::vector<ConfidenceWorth::Knot>& knots) {
  for (size_t i = 0; i < knots.size(); ++i) {
    if (i > 0 && !(knots[i - 1].confidence < knots[i].confidence)) {
      members.Fail("knots", fmt::format("expected rising confidences, found {} after {}",
                                        knots[i].confidence, knots[i - 1].confidence));
    }
    if (!(knots[i].sigma > 0) || !std::isfinite(knots[i].sigma)) {
      members.Fail("knots", fmt::format("expected positive sigmas, found {}", knots[i].sigma));
    }
  }
}

void Members(JsonMembers& members, ConfidenceWorth& worth) {
  members("knots", worth.knots);
  members("common_sigma", worth.common_sigma);
  members("matches", worth.num_matches);
  members("gain", worth.gain);
  members("gain_sigma", worth.gain_sigma);
  ExpectRising(members, worth.knots);
}

void Members(JsonMembers& members, SceneCalibration& calibration) {
  members.Format("raylift-scene-calibration/1");
  members("by", calibration.by);
  members("depth", calibration.depth);
  members.If(!calibration.confidences.empty(), "confidences", calibration.confidences);
  members("geometry_noise", calibration.geometry_noise);
  members("match_noise", calibration.match_noise);
}

void Members(JsonMembers& members, MatchSetScore& score) {
  members("matches", score.num_matches);
  members("inliers", score.num_inliers);
  members("msac_cost", score.msac_cost);
}

void Members(JsonMembers& members, MatchNoise& noise) { members.Fields(FieldsOf(noise)); }

static void Members(JsonMembers& members, AlternativePose& alternative) {
  members("cam_from_world", alternative.cam_from_world);
  members("probability", alternative.probability);
  members.If(alternative.covariance.has_value(), "covariance", alternative.covariance);
}

void Members(JsonMembers& members, PoseEstimate& estimate) {
  members("keypoints", estimate.num_keypoints);
  members("inlier_keypoints", estimate.inlier_keypoints);
  members("iterations", estimate.iterations);
  const bool has_pose = estimate.cam_from_world.has_value();
  // Where no keypoint has a match, no solver made the pose.
  members.If(has_pose && estimate.num_keypoints > 0, "solver", estimate.solver);
  members.If(has_pose && !estimate.position_observable, "position_observable",
             estimate.position_observable);
  members.If(has_pose, "score_2d3d", estimate.score_2d3d);
  members.If(has_pose, "score_2d2d", estimate.score_2d2d);
  members.If(has_pose, "ransac_value", estimate.ransac_value);
  members.If(has_pose, "refined_value", estimate.refined_value);
  members.If(estimate.noise.has_value(), "noise", estimate.noise);
  std::string camera = estimate.refined_camera ? estimate.refined_camera->ToString() : "";
  members.If(!camera.empty(), "refined_camera", camera);
  if (members.reads() && !camera.empty()) {
    estimate.refined_camera = ParseCamera("refined_camera", camera);
  }
  const bool has_covariance = estimate.covariance.has_value();
  members.If(has_covariance, "rotation_sigma_deg", estimate.rotation_sigma_deg);
  members.If(has_covariance, "position_sigma", estimate.position_sigma);
  members.If(has_covariance, "covariance", estimate.covariance);
  members.If(!estimate.alternatives.empty(), "alternatives", estimate.alternatives);
}

void Members(JsonMembers& members, StageTimes& times) {
  for (const QueryStage& stage : kQueryStages) members(stage.name, times.*stage.milliseconds);
}

void Members(JsonMembers& members, GeometrySummary& used) {
  members("spec", used.spec);
  members("interpretation", used.interpretation);
  members.If(used.alignment.has_value(), "alignment", used.alignment);
}

void Members(JsonMembers& members, GeometrySummary::Alignment& alignment) {
  members("mode", alignment.mode);
  members("median_factor", alignment.median_factor);
  Medians(members, alignment);
}

void Members(JsonMembers& members, LocalizedQuery& query) {
  StageCounts& counts = query.counts;
  PoseEstimate& estimate = query.estimate;
  members("name", query.name);
  std::string status = query.localized() ? "ok" : "not localized";
  members("status", status);
  members("reason", query.reason);
  estimate.verdict = query.verdict();
  members("verdict", estimate.verdict);
  estimate.confidence = query.confidence();
  members("confidence", estimate.confidence);
  ForEachNumber<uint64_t>(FieldsOf(counts), [&](const std::string& name, uint64_t& count) {
    members(name, count);
    if (name == "hit") members("points_by_geometry", counts.points_of_source);
  });
  members.If(!query.rig.empty(), "rig", query.rig);
  MultiViewNoise noise = counts.noise.value_or(MultiViewNoise());
  members.If(counts.noise.has_value(), "keypoint_noise_px", noise.keypoints_px);
  members.If(counts.noise.has_value(), "geometry_noise_px", noise.geometry_px);
  members.If(estimate.cam_from_world.has_value(), "cam_from_world", estimate.cam_from_world);
  if (members.reads() && query.localized() && !estimate.cam_from_world) {
    members.Fail("cam_from_world", "a localized query needs one");
  }
  Members(members, estimate);
  members.If(query.rerender_rounds.has_value(), "rerender_rounds_kept", query.rerender_rounds);
}

void MembersOfDiagnostics(JsonMembers& members, std::string& line, LocalizedQuery& query) {
  auto json = members.reads() ? JsonMembers::Json() : JsonMembers::Json::parse(line);
  members("diagnostics", json);
  if (!members.reads()) return;
  members("diagnostics", query);
  line = JsonText(json);
}

}  // namespace raylift
