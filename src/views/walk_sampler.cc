// Walks through a mesh.

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <queue>
#include <span>
#include <utility>
#include <vector>

#include "base/constants.h"
#include "base/index_sets.h"
#include "base/rng.h"
#include "views/polyline.h"
#include "views/space_probe.h"
#include <Eigen/Geometry>
#include <fmt/format.h>

#include "raylift/base/error.h"
#include "raylift/base/parallel.h"
#include "raylift/base/text.h"
#include "raylift/views/view_sampler.h"

namespace raylift {
namespace {

using Line = std::vector<Eigen::Vector3d>;

// Lengths are in eye heights, of which an adult's is 1.6 m: motions of a body grow with it.
constexpr double kDefaultSpacing = 0.25;
constexpr double kLineSpacing = 0.125;  // of the points that corners are rounded by
constexpr int kRoundings = 16;  // each moves a point to (1, 2, 1) / 4 of itself and both beside
constexpr double kAhead = 0.5;  // half of the way whose direction is looked along
constexpr double kMostTurnDeg = 30;  // from pose to pose; one stands while one turns more
constexpr double kStride = 0.9;      // two steps
constexpr double kBob = 0.0125;      // up and down, once a step
constexpr double kSway = 0.0125;     // aside, once a stride
constexpr double kRollDeg = 1.5;     // once a stride
// Standard deviations of a hand's turns of the camera about its axes x, y and z, in waves of these
// lengths.
constexpr std::array<double, 3> kHandDeg = {4, 8, 2};
constexpr std::array<double, 3> kHandWaves = {2, 3.7, 7};
constexpr size_t kMostTargets = 64;  // of a lap

// Returns the places of the largest set that one can walk between, no wall being in between.
std::vector<EyePlace> Connected(const RayCaster& mesh, std::vector<EyePlace> places, int threads) {
  ParallelFor(places.size(), threads, [&](size_t i) {
    std::erase_if(places[i].neighbors, [&](size_t other) {
      // The same ray for both.
      const Eigen::Vector3d from = places[std::min(i, other)].center;
      const Eigen::Vector3d step = places[std::max(i, other)].center - from;
      const Ray ray{from, step.normalized()};
      const auto hit = mesh.Cast(std::span(&ray, 1)).front();
      return hit && hit->ray_t < step.norm();
    });
  });
  DisjointSets sets(places.size());
  for (size_t i = 0; i < places.size(); ++i) {
    for (const size_t other : places[i].neighbors) sets.Join(i, other);
  }
  const std::vector<bool> is_connected = sets.InLargest();
  std::vector<EyePlace> connected;
  std::vector<size_t> new_index(places.size());
  for (size_t i = 0; i < places.size(); ++i) {
    new_index[i] = connected.size();
    if (is_connected[i]) connected.push_back(places[i]);
  }
  for (EyePlace& place : connected) {
    for (size_t& other : place.neighbors) other = new_index[other];
  }
  return connected;
}

// Appends the shortest way between two places, without the first, and returns its length
// (Dijkstra).
double AppendWay(const std::vector<EyePlace>& places, size_t from, size_t to, Line& line) {
  std::vector<double> distances(places.size(), std::numeric_limits<double>::infinity());
  std::vector<size_t> next(places.size());
  using Reached = std::pair<double, size_t>;
  std::priority_queue<Reached, std::vector<Reached>, std::greater<>> reached;
  distances[to] = 0;
  reached.emplace(0, to);
  while (reached.top().second != from) {
    const auto [distance, place] = reached.top();
    reached.pop();
    if (distance > distances[place]) continue;
    for (const size_t other : places[place].neighbors) {
      const double longer = distance + (places[other].center - places[place].center).norm();
      if (longer >= distances[other]) continue;
      distances[other] = longer;
      next[other] = place;
      reached.emplace(longer, other);
    }
  }
  for (size_t place = from; place != to;) {
    place = next[place];
    line.push_back(places[place].center);
  }
  return distances[from];
}

// Returns a lap past places that lie far apart, which ends where it begins. It has at least this
// length, unless that takes too many places.
Line PlanLap(const std::vector<EyePlace>& places, double length, Rng& rng) {
  Line centers;
  for (const EyePlace& place : places) centers.push_back(place.center);
  const std::vector<size_t> targets = FarthestFirst(centers, kMostTargets, rng);
  Line lap = {centers[targets[0]]};
  size_t last = 0;
  do {
    length -= AppendWay(places, targets[last], targets[last + 1], lap);
    ++last;
  } while (length > 0 && last + 1 < targets.size());
  AppendWay(places, targets[last], targets[0], lap);
  return lap;
}

// Walks round and round.
class Track {
 public:
  // Rounds the lap's corners where there is room.
  Track(const RayCaster& mesh, const ViewSamplerOptions& options, double spacing, const Line& lap)
      : line_(Closed(Rounded(mesh, options, Open(Polyline(lap), spacing)))) {}

  double length() const { return line_.length(); }
  Eigen::Vector3d At(double way) const {
    return line_.At(way - length() * std::floor(way / length()));
  }

 private:
  static Line Open(const Polyline& lap, double spacing) {
    const int count = std::max(8, static_cast<int>(lap.length() / spacing));
    Line points;
    for (int i = 0; i < count; ++i) points.push_back(lap.At(i * lap.length() / count));
    return points;
  }

  static Line Rounded(const RayCaster& mesh, const ViewSamplerOptions& options, Line points) {
    const size_t count = points.size();
    for (int round = 0; round < kRoundings; ++round) {
      Line rounder = points;
      ParallelFor(count, options.threads, [&](size_t i) {
        const Eigen::Vector3d beside = points[(i + count - 1) % count] + points[(i + 1) % count];
        const Eigen::Vector3d point = 0.5 * points[i] + 0.25 * beside;
        if (IsClear(mesh, point, options, kFewDirections)) rounder[i] = point;
      });
      points = std::move(rounder);
    }
    return points;
  }

  static Line Closed(Line points) {
    points.push_back(points.front());
    return points;
  }

  Polyline line_;
};

// Moves the camera as a walking person does, by the way in eye heights.
class Gait {
 public:
  explicit Gait(Rng& rng) {
    for (auto& phases : phases_) {
      for (double& phase : phases) phase = rng.Uniform(0, 2 * std::numbers::pi);
    }
  }

  // Returns the offset from where the camera is carried, x aside and y up.
  Eigen::Vector2d Offset(double way) const {
    const double phase = PhaseOf(way);
    return {kSway * std::sin(phase), kBob * std::cos(2 * phase)};
  }

  // Returns the camera's turn from looking ahead, upright.
  Eigen::Quaterniond Turn(double way) const {
    Eigen::Vector3d turn_deg{0, 0, kRollDeg * std::sin(PhaseOf(way))};
    for (size_t axis = 0; axis < 3; ++axis) {
      double sum = 0;  // of sinusoids, whose variance is one half each
      for (size_t k = 0; k < kHandWaves.size(); ++k) {
        sum += std::sin(2 * std::numbers::pi * way / kHandWaves[k] + phases_[axis][k]);
      }
      turn_deg[static_cast<Eigen::Index>(axis)] +=
          kHandDeg[axis] * sum * std::sqrt(2.0 / kHandWaves.size());
    }
    const Eigen::Vector3d turn = turn_deg * kRadPerDeg;
    return Eigen::Quaterniond(Eigen::AngleAxisd(turn.norm(), turn.normalized()));
  }

 private:
  static double PhaseOf(double way) { return 2 * std::numbers::pi * way / kStride; }

  std::array<std::array<double, kHandWaves.size()>, 3> phases_;
};

std::vector<Rigid3> PosesOn(const Track& track, const ViewSamplerOptions& options,
                            const InsideOptions& inside, double spacing, Rng& rng) {
  const Gait gait(rng);
  const double height = inside.eye_height;
  const Eigen::Vector3d up = options.up_in_world.normalized();
  const double down = inside.look_down_deg * kRadPerDeg;
  // Returns the level direction of the way around a place, `before` where it has none.
  const auto direction = [&](double way, const Eigen::Vector3d& before) -> Eigen::Vector3d {
    const Eigen::Vector3d along = track.At(way + kAhead * height) - track.At(way - kAhead * height);
    const Eigen::Vector3d level = along - along.dot(up) * up;
    return level.norm() > 1e-6 * height ? level.normalized() : before;
  };
  std::vector<Rigid3> poses;
  double way = 0;
  Eigen::Vector3d ahead = direction(way, up.unitOrthogonal());
  while (static_cast<int>(poses.size()) < options.count) {
    const Eigen::Vector2d offset = height * gait.Offset(way / height);
    const Eigen::Vector3d center = track.At(way) + offset.x() * ahead.cross(up) + offset.y() * up;
    const Rigid3 upright = LookAlong(center, std::cos(down) * ahead - std::sin(down) * up, up);
    const Eigen::Quaterniond rotation = gait.Turn(way / height) * upright.rotation;
    poses.push_back({rotation, -(rotation * center)});

    const Eigen::Vector3d next = direction(way + spacing, ahead);
    const double turn = std::atan2(ahead.cross(next).dot(up), ahead.dot(next));
    const double most = kMostTurnDeg * kRadPerDeg;
    if (std::abs(turn) <= most) way += spacing;
    ahead = Eigen::AngleAxisd(std::clamp(turn, -most, most), up) * ahead;
  }
  return poses;
}

}  // namespace

SampledViews SampleWalk(const RayCaster& mesh, const ViewSamplerOptions& options,
                        const InsideOptions& inside, const WalkOptions& walk) {
  const double height = inside.eye_height;
  const double spacing = walk.spacing.value_or(kDefaultSpacing * height);
  if (!(spacing > 0)) throw OptionError("spacing", FormatDouble(spacing), "must be above 0");
  // So that there is room to bob and to sway, between two places, too.
  ViewSamplerOptions with_room = options;
  with_room.clearance += 2 * (kBob + kSway) * height;
  const std::vector<EyePlace> places =
      Connected(mesh, FindEyePlaces(mesh, with_room, inside), options.threads);
  SampledViews views;
  if (places.size() > 1) {
    Rng rng(StreamSeed(options.seed, "walk", "views"));
    const Line lap = PlanLap(places, options.count * spacing, rng);
    const Track track(mesh, with_room, kLineSpacing * height, lap);
    views.cam_from_world = PosesOn(track, options, inside, spacing, rng);
    std::erase_if(views.cam_from_world, [&](const Rigid3& pose) {
      return !IsClear(mesh, pose.OriginInSource(), options, kManyDirections);
    });
  }
  const auto found = static_cast<int>(views.cam_from_world.size());
  if (found == 0) {
    throw InputError(
        "no way to walk was found: is the direction of up right, and are the clearance and the eye "
        "height in the scene's unit?");
  }
  if (found < options.count) {
    views.warnings.push_back(
        fmt::format("{} of {} poses of the walk are left out, as they are not clear of surfaces",
                    options.count - found, options.count));
  }
  return views;
}

}  // namespace raylift
