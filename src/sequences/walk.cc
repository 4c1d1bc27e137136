#include "raylift/sequences/walk.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <optional>
#include <string_view>
#include <utility>

#include "base/statistics.h"
#include "io/scene/trajectory_file.h"
#include "io/text/line_tokens.h"
#include "sequences/odometry.h"
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/text.h"
#include "raylift/io/scene_file.h"

namespace raylift {
namespace {

using std::filesystem::path;

using TimesByName = std::map<std::string, double>;
using PosesByName = std::map<std::string, Rigid3>;

// A walk in which the camera turns and moves by less has no motion; the latter is relative to the
// farthest center.
constexpr double kLeastTurnDeg = 1e-3;
constexpr double kLeastShareOfMotion = 1e-9;

// Returns the times that the names hold; empty where one holds none.
TimesByName TimesInNames(std::span<const std::string> names) {
  TimesByName times;
  for (const std::string& name : names) {
    const auto time_s = TimeInName(name);
    if (!time_s || !std::isfinite(*time_s)) return {};
    times.emplace(name, *time_s);
  }
  return times;
}

// Returns the part of a name after its first folder; empty where it has none.
std::string_view AfterFolder(std::string_view name) {
  const size_t slash = name.find('/');
  return slash == std::string_view::npos ? std::string_view() : name.substr(slash + 1);
}

// A line of a list of walks.
struct ListedWalk {
  std::string folder;  // ends in '/'
  path odometry;
  path times;  // empty: not given
};

// The photographs of a walk. Where it is of a list, all names start with its folder, which other
// files may leave out.
struct Photographs {
  std::span<const std::string> names;
  std::string_view folder = {};
  std::span<const ListedWalk> list = {};

  // Returns whether a name, in other folders or not, is in the folder of another walk and not in
  // this one's.
  bool IsOfOther(std::string_view name) const {
    bool is_of_other = false;
    for (; !name.empty(); name = AfterFolder(name)) {
      if (name.starts_with(folder)) return false;
      is_of_other |= std::any_of(list.begin(), list.end(), [&](const ListedWalk& walk) {
        return name.starts_with(walk.folder);
      });
    }
    return is_of_other;
  }
};

// Returns the values of the names that have one: that of the name itself, or of the only key that
// ends in it from a folder on, as "images/a.jpg" does in "a.jpg". Where no name of a list's walk
// has a value, the names are tried without its folder.
template <typename T>
std::map<std::string, T> OfNames(const Photographs& photographs,
                                 const std::map<std::string, T>& values) {
  std::map<std::string_view, std::vector<const T*>> by_end;
  for (const auto& [name, value] : values) {
    if (photographs.IsOfOther(name)) continue;
    for (std::string_view end = name; !end.empty(); end = AfterFolder(end)) {
      by_end[end].push_back(&value);
    }
  }
  const auto find_all = [&](size_t without) {
    std::map<std::string, T> found;
    for (const std::string& name : photographs.names) {
      const std::string called = name.substr(without);
      const auto same = values.find(called);
      const auto ends = by_end.find(called);
      if (same != values.end() && !photographs.IsOfOther(called)) {
        found.emplace(name, same->second);
      } else if (ends != by_end.end() && ends->second.size() == 1) {
        found.emplace(name, *ends->second.front());
      }
    }
    return found;
  };
  std::map<std::string, T> found = find_all(0);
  return found.empty() ? find_all(photographs.folder.size()) : found;
}

// Returns the times in seconds: some programs write milli-, micro- or nanoseconds.
TimesByName InSeconds(TimesByName times) {
  double latest = 0;
  for (const auto& [name, time] : times) latest = std::max(latest, time);
  const double seconds = SecondsPerTick(latest);
  for (auto& [name, time] : times) time *= seconds;
  return times;
}

// The files that may hold the times of a walk's photographs.
struct TimeFiles {
  path of_walk;   // goes first; empty: not given
  path of_walks;  // where nothing else tells the times; empty: not given
};

// Returns the times that are known, in seconds.
TimesByName TimesOf(const TimeFiles& files, const Odometry& odometry,
                    const Photographs& photographs) {
  if (!files.of_walk.empty()) {
    TimesByName times = OfNames(photographs, InSeconds(ReadTimes(files.of_walk)));
    if (times.empty()) {
      throw InputError(files.of_walk,
                       fmt::format("expected times of photographs, found none of {} names, such "
                                   "as {}",
                                   photographs.names.size(), photographs.names.front()));
    }
    return times;
  }
  if (!odometry.times.empty()) return OfNames(photographs, InSeconds(odometry.times));
  TimesByName times;
  if (!files.of_walks.empty()) times = OfNames(photographs, InSeconds(ReadTimes(files.of_walks)));
  return times.empty() ? InSeconds(TimesInNames(photographs.names)) : times;
}

double MedianStep(std::span<const TimedPose> poses) {
  std::vector<double> steps;
  for (size_t i = 1; i < poses.size(); ++i) {
    steps.push_back(poses[i].time_s - poses[i - 1].time_s);
  }
  return UpperMedianOr(std::move(steps), 0);
}

// Returns the index of the time that is nearest to another one, the earlier one of two.
size_t NearestTime(std::span<const double> times_s, double time_s) {
  const auto next = std::lower_bound(times_s.begin(), times_s.end(), time_s);
  const bool is_before = next == times_s.end() ||
                         (next != times_s.begin() && time_s - *std::prev(next) <= *next - time_s);
  return static_cast<size_t>(next - times_s.begin()) - (is_before ? 1 : 0);
}

// Returns the poses with times in seconds: some programs write nanoseconds in TUM's lines.
std::vector<TimedPose> InSeconds(std::vector<TimedPose> poses) {
  const double seconds = SecondsPerTick(poses.back().time_s);
  for (TimedPose& pose : poses) pose.time_s *= seconds;
  return poses;
}

// Adds the frames that have a pose near their time. A pose is that of the photograph which is the
// nearest to it: where poses are missing, the next photograph's is none.
void AddByTime(const path& file, std::span<const TimedPose> poses, const TimesByName& times,
               std::span<const std::string> names, Walk& walk) {
  std::vector<double> of_poses, of_photographs;
  for (const TimedPose& pose : poses) of_poses.push_back(pose.time_s);
  for (const std::string& name : names) {
    const auto time = times.find(name);
    if (time != times.end()) of_photographs.push_back(time->second);
  }
  std::sort(of_photographs.begin(), of_photographs.end());
  const double within_s = 0.5 * MedianStep(poses);
  for (size_t i = 0; i < names.size(); ++i) {
    const auto time = times.find(names[i]);
    if (time == times.end()) continue;
    const double time_s = time->second;
    const TimedPose& nearest = poses[NearestTime(of_poses, time_s)];
    const bool is_of_another =
        of_photographs[NearestTime(of_photographs, nearest.time_s)] != time_s;
    if (std::abs(nearest.time_s - time_s) > within_s || is_of_another) continue;
    walk.frames.push_back({i, time_s, nearest.cam_from_world});
  }
  if (walk.frames.empty() && !times.empty()) {
    throw InputError(
        file, fmt::format("expected poses at the photographs' times, as {} at {} s; found {} to {} "
                          "s",
                          times.begin()->first, FormatDouble(times.begin()->second),
                          FormatDouble(poses.front().time_s), FormatDouble(poses.back().time_s)));
  }
}

// Returns the number that a photograph's name is, but for folder and extension.
std::optional<size_t> NumberOf(std::string_view name) {
  while (!AfterFolder(name).empty()) name = AfterFolder(name);
  const auto number = ParseUint(name.substr(0, name.rfind('.')));
  return number ? std::optional<size_t>(*number) : std::nullopt;
}

// Returns the pose of each photograph: the one whose index, from 0, is the photograph's name, as
// KITTI's are, or else the one at the same place in the order of names.
PosesByName PosesInOrder(const path& file, std::span<const std::string> names,
                         std::span<const Rigid3> poses) {
  const bool are_numbers = std::all_of(names.begin(), names.end(), [&](const std::string& name) {
    return NumberOf(name).value_or(poses.size()) < poses.size();
  });
  if (!are_numbers && names.size() != poses.size()) {
    throw InputError(file, fmt::format("expected a pose of each of {} photographs, or photographs "
                                       "called by the numbers of poses from 0, found {} poses",
                                       names.size(), poses.size()));
  }
  PosesByName by_name;
  for (const auto& [name, place] : PlacesByNumbers(names)) {
    by_name.emplace(name, poses[are_numbers ? *NumberOf(name) : static_cast<size_t>(place)]);
  }
  return by_name;
}

void AddByName(const PosesByName& poses, const TimesByName& times,
               std::span<const std::string> names, Walk& walk) {
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

void WarnOfFramesWithoutPose(const path& file, std::span<const std::string> names, Walk& walk) {
  if (walk.frames.size() == names.size()) return;
  std::vector<bool> in_walk(names.size());
  for (const WalkFrame& frame : walk.frames) in_walk[frame.query] = true;
  const auto first = std::find(in_walk.begin(), in_walk.end(), false) - in_walk.begin();
  walk.warnings.push_back(fmt::format(
      "{}: no pose of {} of {} photographs, such as {}: these are localized alone", file.string(),
      names.size() - walk.frames.size(), names.size(), names[static_cast<size_t>(first)]));
}

Walk ReadWalkOf(const path& file, const TimeFiles& times, const Photographs& photographs,
                const Rigid3& cam_from_body) {
  const std::span<const std::string> names = photographs.names;
  if (names.empty()) throw InputError(file, "there are no photographs that it could be of");
  Odometry odometry = ReadOdometry(file);
  Walk walk{.folder = std::string(photographs.folder),
            .warnings = std::move(odometry.warnings),
            .cam_from_body = cam_from_body};
  TimesByName known = TimesOf(times, odometry, photographs);
  if (!odometry.by_time.empty()) {
    if (known.empty()) {
      throw InputError(file,
                       "holds times, and neither a list of times nor names tell when the "
                       "photographs were taken");
    }
    AddByTime(file, InSeconds(std::move(odometry.by_time)), known, names, walk);
  } else {
    if (known.empty()) known = PlacesByNumbers(names);
    AddByName(odometry.in_order.empty() ? OfNames(photographs, odometry.by_name)
                                        : PosesInOrder(file, names, odometry.in_order),
              known, names, walk);
  }
  const bool body_is_camera = cam_from_body.translation.isZero(0) &&
                              cam_from_body.rotation.coeffs() == Rigid3{}.rotation.coeffs();
  for (WalkFrame& frame : walk.frames) {
    // Poses of the camera itself stay as they are read, to the bit.
    if (!body_is_camera) frame.cam_from_odometry = cam_from_body * frame.cam_from_odometry;
  }
  std::stable_sort(walk.frames.begin(), walk.frames.end(),
                   [](const WalkFrame& a, const WalkFrame& b) { return a.time_s < b.time_s; });
  Check(file, names, walk);
  WarnOfFramesWithoutPose(file, names, walk);
  return walk;
}

constexpr std::string_view kWalkWord = "walk";

// Returns whether the line begins a list of walks: another one's first name may be this word, and
// then has a pose.
bool IsOfList(const LineReader& lines, std::string_view line) {
  LineTokens tokens(lines, line);
  if (tokens.Token(kWalkWord) != kWalkWord) return false;
  size_t others = 0;
  for (; !tokens.AtEnd(); tokens.Name()) ++others;
  return others < 7;
}

void CheckFolder(const LineReader& lines, const std::string& folder,
                 std::span<const ListedWalk> before, std::span<const std::string> names) {
  for (const ListedWalk& other : before) {
    if (folder.starts_with(other.folder) || other.folder.starts_with(folder)) {
      lines.Fail(fmt::format("{} and {} are not apart", other.folder, folder));
    }
  }
  const bool has_photographs = std::any_of(
      names.begin(), names.end(), [&](const auto& name) { return name.starts_with(folder); });
  if (has_photographs) return;
  lines.Fail(fmt::format("no photograph's name starts with {}{}", folder,
                         names.empty() ? "" : ", such a name is " + names.front()));
}

// Reads a list of walks; nullopt where the file holds no list, but odometry.
std::optional<std::vector<ListedWalk>> ReadListOfWalks(const path& file,
                                                       std::span<const std::string> names) {
  if (std::filesystem::is_directory(file)) return std::nullopt;
  std::vector<ListedWalk> walks;
  LineReader lines(file);
  while (const auto line = lines.NextContent()) {
    if (walks.empty() && !IsOfList(lines, *line)) return std::nullopt;
    LineTokens tokens(lines, *line);
    if (tokens.Token(kWalkWord) != kWalkWord) lines.Fail("expected walk FOLDER ODOMETRY [TIMES]");
    std::string folder(tokens.Name("FOLDER"));
    while (folder.ends_with('/')) folder.pop_back();
    if (folder.empty()) lines.Fail("expected the folder of the walk's photographs");
    folder += '/';
    CheckFolder(lines, folder, walks, names);
    ListedWalk& walk = walks.emplace_back();
    walk.folder = std::move(folder);
    walk.odometry = file.parent_path() / tokens.Name("ODOMETRY");
    if (!tokens.AtEnd()) walk.times = file.parent_path() / tokens.Name("TIMES");
    tokens.ExpectEnd();
  }
  if (walks.empty()) return std::nullopt;
  return walks;
}

Walk ReadListedWalk(const ListedWalk& walk, std::span<const ListedWalk> list, const path& times,
                    std::span<const std::string> names, const Rigid3& cam_from_body) {
  std::vector<size_t> queries;
  std::vector<std::string> of_walk;
  for (size_t i = 0; i < names.size(); ++i) {
    if (!names[i].starts_with(walk.folder)) continue;
    queries.push_back(i);
    of_walk.push_back(names[i]);
  }
  Walk read =
      ReadWalkOf(walk.odometry, {walk.times, times}, {of_walk, walk.folder, list}, cam_from_body);
  for (WalkFrame& frame : read.frames) frame.query = queries[frame.query];
  return read;
}

void WarnOfPhotographsOfNoWalk(const path& list, std::span<const ListedWalk> walks,
                               std::span<const std::string> names, Walk& walk) {
  std::vector<std::string> of_none;
  std::copy_if(names.begin(), names.end(), std::back_inserter(of_none), [&](const auto& name) {
    return std::none_of(walks.begin(), walks.end(),
                        [&](const ListedWalk& one) { return name.starts_with(one.folder); });
  });
  if (of_none.empty()) return;
  walk.warnings.push_back(
      fmt::format("{}: {} of {} photographs are of no walk, such as {}: these are localized alone",
                  list.string(), of_none.size(), names.size(), of_none.front()));
}

}  // namespace

Walk ReadWalk(const path& odometry, const path& times, std::span<const std::string> names,
              const Rigid3& cam_from_body) {
  return ReadWalkOf(odometry, {times, {}}, {names}, cam_from_body);
}

std::vector<Walk> ReadWalks(const path& odometry, const path& times,
                            std::span<const std::string> names, const Rigid3& cam_from_body) {
  const auto list = ReadListOfWalks(odometry, names);
  if (!list) return {ReadWalk(odometry, times, names, cam_from_body)};
  std::vector<Walk> walks;
  for (const ListedWalk& walk : *list) {
    walks.push_back(ReadListedWalk(walk, *list, times, names, cam_from_body));
  }
  WarnOfPhotographsOfNoWalk(odometry, *list, names, walks.front());
  return walks;
}

}  // namespace raylift
