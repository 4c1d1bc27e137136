#include "estimation/problem/repeats.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <span>
#include <tuple>
#include <utility>
#include <vector>

namespace raylift {
namespace {

using Eigen::Vector3d;

// What may coincide with others of its group.
struct Member {
  uint64_t group;
  size_t index;
  bool operator<(const Member& other) const {
    return std::tie(group, index) < std::tie(other.group, other.index);
  }
};

// Lets those of one group coincide that lie no farther apart than `within(index)`, at `at(index)`:
// same[index] becomes another one's index. What is not finite coincides with nothing. They are only
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

// Numbers the keypoints that coincide by one of them.
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

// The reference that a point was lifted from, or -1.
int ReferenceOf(const PoseProblem& problem, const Match2D3D& match) {
  if (match.reference) return *match.reference;
  if (!match.match_2d2d || *match.match_2d2d >= problem.matches_2d2d.size()) return -1;
  return problem.matches_2d2d[*match.match_2d2d].reference;
}

}  // namespace

Repeats FindRepeats(const PoseProblem& problem, double within_px, const Vector3d& from) {
  Repeats repeats{NumberQueryKeypoints(problem.matches_2d2d, problem.matches_2d3d), {}, {}};
  std::vector<Member> pairs, points;
  const auto add = [](std::vector<Member>& members, size_t keypoint, int reference) {
    members.push_back({keypoint << 32 | static_cast<uint32_t>(reference), members.size()});
  };
  if (within_px > 0) {
    Unite(problem, within_px, repeats.keypoints);
    for (const Match2D2D& match : problem.matches_2d2d) {
      add(pairs, repeats.keypoints.of_2d2d[pairs.size()], match.reference);
    }
    for (const Match2D3D& match : problem.matches_2d3d) {
      add(points, repeats.keypoints.of_2d3d[points.size()], ReferenceOf(problem, match));
    }
  }
  repeats.of_2d2d = Coinciding(
      std::move(pairs), problem.matches_2d2d.size(),
      [&](size_t i) { return AtPixel(problem.matches_2d2d[i].reference_px); },
      [&](size_t) { return within_px; });
  const auto from_there = [&](size_t i) -> Vector3d {
    return problem.matches_2d3d[i].point_in_world - from;
  };
  const double angle = within_px / problem.query_camera.MeanFocalPx();
  repeats.of_2d3d = Coinciding(std::move(points), problem.matches_2d3d.size(), from_there,
                               [&](size_t i) { return angle * from_there(i).norm(); });
  return repeats;
}

}  // namespace raylift
