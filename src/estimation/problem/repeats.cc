#include "estimation/problem/repeats.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <optional>
#include <span>
#include <tuple>
#include <utility>
#include <vector>

namespace raylift {
namespace {

using Eigen::Vector3d;

// An item, by its index, that may coincide with others of its group.
struct Member {
  uint64_t group;
  size_t index;
  bool operator<(const Member& other) const {
    return std::tie(group, index) < std::tie(other.group, other.index);
  }
};

// Sets same[i] to another member's index for members of a group that lie, at `at(i)`, no farther
// from that one than `within` of it. What is not finite coincides with nothing. Members are first
// compared along a direction that neither rows nor columns of pixels are normal to.
template <typename At, typename Within>
void CompareInGroup(std::span<const Member> group, const At& at, const Within& within,
                    std::vector<size_t>& same) {
  const Vector3d direction = Vector3d(1, 0.618, 0.382).normalized();
  std::vector<std::pair<double, size_t>> along;
  along.reserve(group.size());
  for (const Member& member : group) {
    const double x = direction.dot(at(member.index));
    if (std::isfinite(x)) along.emplace_back(x, member.index);
  }
  std::sort(along.begin(), along.end());
  for (auto a = along.begin(); a != along.end(); ++a) {
    const size_t i = a->second;
    if (same[i] != i) continue;
    const double radius = within(i);
    for (auto b = a + 1; b != along.end() && b->first <= a->first + radius; ++b) {
      if ((at(b->second) - at(i)).norm() <= radius) same[b->second] = i;
    }
  }
}

// Returns for each index below `count` the first one that it coincides with.
template <typename At, typename Within>
std::vector<size_t> Coinciding(std::vector<Member> members, size_t count, const At& at,
                               const Within& within) {
  std::vector<size_t> same(count);
  std::iota(same.begin(), same.end(), size_t{0});
  std::sort(members.begin(), members.end());
  for (auto begin = members.begin(); begin != members.end();) {
    const auto end = std::find_if(begin, members.end(),
                                  [&](const Member& m) { return m.group != begin->group; });
    if (end - begin > 1) CompareInGroup(std::span(begin, end), at, within, same);
    begin = end;
  }
  std::vector<size_t> first(count, count);
  for (size_t i = 0; i < count; ++i) {
    size_t& of_same = first[same[i]];
    of_same = std::min(of_same, i);
    same[i] = of_same;
  }
  return same;
}

Vector3d AtPixel(const Eigen::Vector2d& pixel) { return {pixel.x(), pixel.y(), 0}; }

// Gives keypoints that coincide the number of one of them.
void Unite(const PoseProblem& problem, double within_px, KeypointNumbers& keypoints) {
  std::vector<Member> members;
  std::vector<const Eigen::Vector2d*> pixels(keypoints.count, nullptr);
  const auto place = [&](const auto& matches, const std::vector<size_t>& numbers) {
    for (size_t i = 0; i < matches.size(); ++i) {
      if (pixels[numbers[i]]) continue;
      pixels[numbers[i]] = &matches[i].query_px;
      members.push_back({static_cast<uint64_t>(matches[i].camera), numbers[i]});
    }
  };
  place(problem.matches_2d2d, keypoints.of_2d2d);
  place(problem.matches_2d3d, keypoints.of_2d3d);
  const std::vector<size_t> first = Coinciding(
      std::move(members), keypoints.count, [&](size_t k) { return AtPixel(*pixels[k]); },
      [&](size_t) { return within_px; });
  for (size_t& keypoint : keypoints.of_2d2d) keypoint = first[keypoint];
  for (size_t& keypoint : keypoints.of_2d3d) keypoint = first[keypoint];
}

// Makes the points of a pair that repeats another one repeat that one's: a point is on its own
// pair's ray, so that it stays only with that. Of pairs that repeat each other one that has a point
// is kept.
void RepeatAsPairs(const std::vector<std::optional<size_t>>& pair_of, Repeats& repeats) {
  constexpr size_t kNone = std::numeric_limits<size_t>::max();
  std::vector<size_t> kept_point(repeats.of_2d2d.size(), kNone);
  for (size_t i = 0; i < pair_of.size(); ++i) {
    if (!pair_of[i]) continue;
    size_t& kept = kept_point[repeats.of_2d2d[*pair_of[i]]];
    if (kept == kNone) kept = i;
    if (pair_of[i] != pair_of[kept]) repeats.of_2d3d[i] = kept;
  }
  for (size_t& pair : repeats.of_2d2d) {
    if (kept_point[pair] != kNone) pair = *pair_of[kept_point[pair]];
  }
}

}  // namespace

std::optional<size_t> PairOf(const PoseProblem& problem, size_t match_2d3d) {
  const Match2D3D& point = problem.matches_2d3d[match_2d3d];
  const size_t likely = point.match_2d2d.value_or(match_2d3d);
  if (likely >= problem.matches_2d2d.size()) return std::nullopt;
  const Match2D2D& match = problem.matches_2d2d[likely];
  const bool is_of_it = match.camera == point.camera && match.query_px == point.query_px &&
                        point.reference.value_or(match.reference) == match.reference;
  return is_of_it ? std::optional(likely) : std::nullopt;
}

std::optional<size_t> ReferenceOf(const PoseProblem& problem, size_t match_2d3d) {
  std::optional<int> reference = problem.matches_2d3d[match_2d3d].reference;
  if (!reference) {
    const std::optional<size_t> pair = PairOf(problem, match_2d3d);
    if (pair) reference = problem.matches_2d2d[*pair].reference;
  }
  const bool is_one =
      reference && *reference >= 0 && static_cast<size_t>(*reference) < problem.references.size();
  return is_one ? std::optional(static_cast<size_t>(*reference)) : std::nullopt;
}

Repeats FindRepeats(const PoseProblem& problem, double within_px, const Vector3d& from) {
  Repeats repeats{NumberQueryKeypoints(problem.matches_2d2d, problem.matches_2d3d), {}, {}};
  const size_t num_points = problem.matches_2d3d.size();
  std::vector<std::optional<size_t>> pair_of(num_points);
  std::vector<Member> pairs, points;
  if (within_px > 0) {
    Unite(problem, within_px, repeats.keypoints);
    const auto group_of = [](size_t keypoint, int reference) {
      return keypoint << 32 | static_cast<uint32_t>(reference);
    };
    for (size_t i = 0; i < problem.matches_2d2d.size(); ++i) {
      pairs.push_back(
          {group_of(repeats.keypoints.of_2d2d[i], problem.matches_2d2d[i].reference), i});
    }
    constexpr uint64_t kOfPair = uint64_t{1} << 63;
    for (size_t i = 0; i < num_points; ++i) {
      const Match2D3D& point = problem.matches_2d3d[i];
      if (point.point_in_world.allFinite()) pair_of[i] = PairOf(problem, i);
      points.push_back({pair_of[i]
                            ? kOfPair | *pair_of[i]
                            : group_of(repeats.keypoints.of_2d3d[i], point.reference.value_or(-1)),
                        i});
    }
  }
  repeats.of_2d2d = Coinciding(
      std::move(pairs), problem.matches_2d2d.size(),
      [&](size_t i) { return AtPixel(problem.matches_2d2d[i].reference_px); },
      [&](size_t) { return within_px; });
  const auto from_there = [&](size_t i) -> Vector3d {
    return problem.matches_2d3d[i].point_in_world - from;
  };
  const double angle =
      problem.matches_2d2d.empty() ? 0 : within_px / problem.query_camera.MeanFocalPx();
  repeats.of_2d3d = Coinciding(std::move(points), num_points, from_there,
                               [&](size_t i) { return angle * from_there(i).norm(); });
  RepeatAsPairs(pair_of, repeats);
  return repeats;
}

}  // namespace raylift
