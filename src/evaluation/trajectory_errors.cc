#include <algorithm>
#include <cmath>
#include <utility>

#include "base/json_text.h"
#include "base/statistics.h"
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "raylift/base/text.h"
#include "raylift/evaluation/pose_errors.h"

namespace raylift {
namespace {

using Json = nlohmann::ordered_json;

struct NamedStatistics {
  const char* name;
  ErrorStatistics TrajectoryErrors::*statistics;
};
constexpr NamedStatistics kErrors[] = {{"ape_position", &TrajectoryErrors::ape_position},
                                       {"ape_rotation_deg", &TrajectoryErrors::ape_rotation_deg},
                                       {"rpe_position", &TrajectoryErrors::rpe_position},
                                       {"rpe_rotation_deg", &TrajectoryErrors::rpe_rotation_deg}};

struct NamedNumber {
  const char* name;
  double ErrorStatistics::*number;
};
constexpr NamedNumber kNumbers[] = {
    {"rmse", &ErrorStatistics::rmse},     {"mean", &ErrorStatistics::mean},
    {"median", &ErrorStatistics::median}, {"std", &ErrorStatistics::std},
    {"min", &ErrorStatistics::min},       {"max", &ErrorStatistics::max},
    {"sse", &ErrorStatistics::sse}};

}  // namespace

ErrorStatistics StatisticsOf(std::vector<double> errors) {
  ErrorStatistics statistics;
  if (errors.empty()) return statistics;
  const auto count = static_cast<double>(errors.size());
  for (const double error : errors) {
    statistics.mean += error / count;
    statistics.sse += error * error;
  }
  double variance = 0;
  for (const double error : errors) {
    variance += (error - statistics.mean) * (error - statistics.mean) / count;
  }
  statistics.std = std::sqrt(variance);
  statistics.rmse = std::sqrt(statistics.sse / count);
  const auto [min, max] = std::minmax_element(errors.begin(), errors.end());
  statistics.min = *min;
  statistics.max = *max;
  statistics.median = MidpointMedianInPlace(std::span(errors));
  return statistics;
}

TrajectoryErrors CompareTrajectories(std::string name, std::span<const TrajectoryPose> poses) {
  std::vector<double> positions, rotations, steps, turns;
  for (size_t i = 0; i < poses.size(); ++i) {
    const Rigid3& estimated = poses[i].estimated_cam_from_world;
    const Rigid3& truth = poses[i].true_cam_from_world;
    positions.push_back((estimated.OriginInSource() - truth.OriginInSource()).norm());
    rotations.push_back(AngleBetweenDeg(estimated.rotation, truth.rotation));
    if (i == 0) continue;
    // cam i from cam i+1.
    const Rigid3 estimated_step = poses[i - 1].estimated_cam_from_world * estimated.Inverse();
    const Rigid3 true_step = poses[i - 1].true_cam_from_world * truth.Inverse();
    steps.push_back((true_step.Inverse() * estimated_step).translation.norm());
    turns.push_back(AngleBetweenDeg(true_step.rotation, estimated_step.rotation));
  }
  return {.name = std::move(name),
          .poses = poses.size(),
          .ape_position = StatisticsOf(positions),
          .ape_rotation_deg = StatisticsOf(rotations),
          .rpe_position = StatisticsOf(steps),
          .rpe_rotation_deg = StatisticsOf(turns)};
}

std::string FormatTrajectoryText(std::span<const TrajectoryErrors> trajectories) {
  std::vector<TableRow> rows = {{"trajectory", "poses", "error"}};
  for (const NamedNumber& number : kNumbers) rows.front().emplace_back(number.name);
  for (const TrajectoryErrors& trajectory : trajectories) {
    for (const NamedStatistics& error : kErrors) {
      TableRow& row = rows.emplace_back(
          TableRow{Printable(trajectory.name), std::to_string(trajectory.poses), error.name});
      for (const NamedNumber& number : kNumbers) {
        row.push_back(fmt::format("{:.5g}", trajectory.*error.statistics.*number.number));
      }
    }
  }
  return AlignColumns(rows);
}

std::string FormatTrajectoryJson(std::span<const TrajectoryErrors> trajectories) {
  Json json = Json::array();
  for (const TrajectoryErrors& trajectory : trajectories) {
    Json& of_one = json.emplace_back(Json{{"name", trajectory.name}, {"poses", trajectory.poses}});
    for (const NamedStatistics& error : kErrors) {
      for (const NamedNumber& number : kNumbers) {
        of_one[error.name][number.name] = trajectory.*error.statistics.*number.number;
      }
    }
  }
  return JsonText(json, 2) + '\n';
}

}  // namespace raylift
