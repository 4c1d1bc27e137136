#include "raylift/sequences/walk.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <string_view>
#include <utility>

#include "base/name_order.h"
#include "base/statistics.h"
#include "io/scene/named_poses.h"
#include "io/scene/trajectory_file.h"
#include "io/text/line_tokens.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/io/scene_file.h"

namespace raylift {
namespace {

using std::filesystem::path;

using TimesByName = std::map<std::string, double>;

// What the camera turns and moves less than over the whole walk is no motion.
constexpr double kLeastTurnDeg = 1e-3;
constexpr double kLeastShareOfMotion = 1e-9;

bool IsTumTrajectory(const path& file) {
  LineReader lines(file);
  const auto line = lines.NextContent();
  if (!line) throw InputError(file, "expected poses, found none");
  const auto tokens = SplitTokens(*line);
  return std::all_of(tokens.begin(), tokens.end(),
                     [](std::string_view token) { return ParseDouble(token).has_value(); });
}

// Returns the times that are known; empty where names hold none.
TimesByName TimesOf(const path& times, std::span<const std::string> names) {
  if (!times.empty()) return ReadTimes(times);
  TimesByName in_names;
  for (const std::string& name : names) {
    const auto time_s = TimeInName(name);
    if (!time_s || !std::isfinite(*time_s)) return {};
    in_names.emplace(name, *time_s);
  }
  return in_names;
}

double MedianStep(std::span<const TimedPose> poses) {
  std::vector<double> steps;
  for (size_t i = 1; i < poses.size(); ++i) {
    steps.push_back(poses[i].time_s - poses[i - 1].time_s);
  }
  return UpperMedianOr(std::move(steps), 0);
}

// Adds the frames that have a pose near their time.
void AddByTime(const path& file, std::span<const TimedPose> poses, const TimesByName& times,
               std::span<const std::string> names, Walk& walk) {
  const double within_s = 0.5 * MedianStep(poses);
  for (size_t i = 0; i < names.size(); ++i) {
    const auto time = times.find(names[i]);
    if (time == times.end()) continue;
    const double time_s = time->second;
    auto nearest =
        std::lower_bound(poses.begin(), poses.end(), time_s,
                         [](const TimedPose& pose, double t) { return pose.time_s < t; });
    if (nearest == poses.end() || (nearest != poses.begin() && time_s - std::prev(nearest)->time_s <
                                                                   nearest->time_s - time_s)) {
      --nearest;
    }
    if (std::abs(nearest->time_s - time_s) > within_s) continue;
    walk.frames.push_back({i, time_s, nearest->cam_from_world});
  }
  if (walk.frames.empty() && !times.empty()) {
    throw InputError(
        file, fmt::format("expected poses at the photographs' times, as {} at {} s; found {} to {} "
                          "s",
                          times.begin()->first, FormatDouble(times.begin()->second),
                          FormatDouble(poses.front().time_s), FormatDouble(poses.back().time_s)));
  }
}

void AddByName(const path& odometry, TimesByName times, std::span<const std::string> names,
               Walk& walk) {
  const std::map<std::string, Rigid3> poses = ReadModelOrPoses(odometry);
  if (times.empty()) times = PlacesByNumbers(names);
  for (size_t i = 0; i < names.size(); ++i) {
    const auto pose = poses.find(names[i]);
    const auto time = times.find(names[i]);
    if (pose == poses.end() || time == times.end()) continue;
    walk.frames.push_back({i, time->second, pose->second});
  }
}

// Throws InputError where times repeat or there is nothing to learn from.
void Check(const path& odometry, std::span<const std::string> names, const Walk& walk) {
  if (walk.frames.size() < 2) {
    throw InputError(odometry, fmt::format("expected poses of two photographs at least, found {} "
                                           "of {}",
                                           walk.frames.size(), names.size()));
  }
  double turned_deg = 0, moved = 0, farthest = 0;
  for (size_t i = 1; i < walk.frames.size(); ++i) {
    const WalkFrame &before = walk.frames[i - 1], &frame = walk.frames[i];
    if (before.time_s == frame.time_s) {
      throw InputError(odometry,
                       fmt::format("{} and {} have the same time, {} s", names[before.query],
                                   names[frame.query], FormatDouble(frame.time_s)));
    }
    const Eigen::Vector3d center = frame.cam_from_odometry.OriginInSource();
    turned_deg +=
        AngleBetweenDeg(before.cam_from_odometry.rotation, frame.cam_from_odometry.rotation);
    moved += (center - before.cam_from_odometry.OriginInSource()).norm();
    farthest = std::max(farthest, center.norm());
  }
  if (turned_deg < kLeastTurnDeg && moved <= kLeastShareOfMotion * farthest) {
    throw InputError(
        odometry,
        fmt::format("no motion: the poses of all {} photographs are the same", walk.frames.size()));
  }
}

}  // namespace

Walk ReadWalk(const path& odometry, const path& times, std::span<const std::string> names) {
  Walk walk;
  const TimesByName known = TimesOf(times, names);
  if (!std::filesystem::is_directory(odometry) && IsTumTrajectory(odometry)) {
    if (known.empty()) {
      throw InputError(odometry,
                       "holds times, and neither a list of times nor names tell when the "
                       "photographs were taken");
    }
    AddByTime(odometry, ReadTumTrajectory(odometry), known, names, walk);
  } else {
    AddByName(odometry, known, names, walk);
  }
  std::stable_sort(walk.frames.begin(), walk.frames.end(),
                   [](const WalkFrame& a, const WalkFrame& b) { return a.time_s < b.time_s; });
  Check(odometry, names, walk);
  if (walk.frames.size() < names.size()) {
    std::vector<bool> in_walk(names.size());
    for (const WalkFrame& frame : walk.frames) in_walk[frame.query] = true;
    const auto first = std::find(in_walk.begin(), in_walk.end(), false) - in_walk.begin();
    walk.warnings.push_back(
        fmt::format("{}: no pose of {} of {} photographs, such as {}: these are localized alone",
                    odometry.string(), names.size() - walk.frames.size(), names.size(),
                    names[static_cast<size_t>(first)]));
  }
  return walk;
}

}  // namespace raylift
