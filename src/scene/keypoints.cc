#include "raylift/scene/keypoints.h"

#include <algorithm>
#include <limits>
#include <map>

#include <fmt/format.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

// An index for every match.
struct KeypointIndices {
  std::vector<int> of_2d2d;
  std::vector<int> of_2d3d;
};

// Completes the given indices by the pixels of the matches without one, for each camera by itself.
class IndexCompletion {
 public:
  IndexCompletion(std::span<const Match2D2D> matches_2d2d,
                  std::span<const Match2D3D> matches_2d3d) {
    const auto has_index = [](const auto& match) { return match.query_keypoint.has_value(); };
    looks_at_pixels_ = !std::all_of(matches_2d2d.begin(), matches_2d2d.end(), has_index) ||
                       !std::all_of(matches_2d3d.begin(), matches_2d3d.end(), has_index);
  }

  template <typename Match>
  void TakeGiven(std::span<const Match> matches) {
    for (const Match& match : matches) {
      if (!match.query_keypoint) continue;
      const int index = *match.query_keypoint;
      if (index < 0 || index > kLargestKeypoint) {
        throw InputError(fmt::format("query_keypoint: expected an index from 0 to {}, found {}",
                                     kLargestKeypoint, index));
      }
      if (!looks_at_pixels_) continue;
      OfCamera& keypoints = of_camera_[match.camera];
      keypoints.by_pixel.FindOrAdd(match.query_px, index);
      keypoints.next = std::max(keypoints.next, index + 1);
    }
  }

  // Returns an index for each match; is called after all given indices have been taken.
  template <typename Match>
  std::vector<int> Complete(std::span<const Match> matches) {
    std::vector<int> indices;
    indices.reserve(matches.size());
    for (const Match& match : matches) {
      indices.push_back(match.query_keypoint ? *match.query_keypoint
                                             : of_camera_[match.camera].IndexAt(match.query_px));
    }
    return indices;
  }

 private:
  struct OfCamera {
    KeypointsByPixel by_pixel;
    int next = 0;

    int IndexAt(const Eigen::Vector2d& pixel) {
      const int index = by_pixel.FindOrAdd(pixel, next);
      if (index == next) {
        RAYLIFT_CHECK(next < std::numeric_limits<int>::max());
        ++next;
      }
      return index;
    }
  };
  bool looks_at_pixels_;  // as some matches have no index
  std::map<int, OfCamera> of_camera_;
};

KeypointIndices CompleteIndices(std::span<const Match2D2D> matches_2d2d,
                                std::span<const Match2D3D> matches_2d3d) {
  IndexCompletion completion(matches_2d2d, matches_2d3d);
  completion.TakeGiven(matches_2d2d);
  completion.TakeGiven(matches_2d3d);
  KeypointIndices indices;
  indices.of_2d2d = completion.Complete(matches_2d2d);
  indices.of_2d3d = completion.Complete(matches_2d3d);
  return indices;
}

}  // namespace

int KeypointsByPixel::FindOrAdd(const Eigen::Vector2d& pixel, int index) {
  if (!pixel.allFinite()) return index;
  return index_of_pixel_.try_emplace({pixel.x(), pixel.y()}, index).first->second;
}

std::optional<int> KeypointsByPixel::Find(const Eigen::Vector2d& pixel) const {
  const auto found = index_of_pixel_.find({pixel.x(), pixel.y()});
  if (found == index_of_pixel_.end()) return std::nullopt;
  return found->second;
}

std::vector<int> CanonicalKeypoints(std::span<const Eigen::Vector2d> pixels) {
  KeypointsByPixel keypoints;
  std::vector<int> canonical;
  canonical.reserve(pixels.size());
  for (size_t i = 0; i < pixels.size(); ++i) {
    canonical.push_back(keypoints.FindOrAdd(pixels[i], static_cast<int>(i)));
  }
  return canonical;
}

KeypointNumbers NumberQueryKeypoints(std::span<const Match2D2D> matches_2d2d,
                                     std::span<const Match2D3D> matches_2d3d) {
  const KeypointIndices indices = CompleteIndices(matches_2d2d, matches_2d3d);
  std::map<int, std::unordered_map<int, size_t>> number_of_index;  // by camera
  KeypointNumbers numbers;
  const auto numbers_of = [&](const auto& matches, const std::vector<int>& of_matches) {
    std::vector<size_t> result;
    result.reserve(of_matches.size());
    for (size_t i = 0; i < of_matches.size(); ++i) {
      const auto [number, is_new] =
          number_of_index[matches[i].camera].try_emplace(of_matches[i], numbers.count);
      numbers.count += is_new ? 1 : 0;
      result.push_back(number->second);
    }
    return result;
  };
  numbers.of_2d2d = numbers_of(matches_2d2d, indices.of_2d2d);
  numbers.of_2d3d = numbers_of(matches_2d3d, indices.of_2d3d);
  return numbers;
}

std::vector<std::vector<size_t>> GroupByKeypoint(std::span<const size_t> numbers, size_t count) {
  std::vector<std::vector<size_t>> groups(count);
  for (size_t i = 0; i < numbers.size(); ++i) groups[numbers[i]].push_back(i);
  return groups;
}

void AssignKeypointsByPixel(PoseProblem& problem) {
  const KeypointIndices indices = CompleteIndices(problem.matches_2d2d, problem.matches_2d3d);
  for (size_t i = 0; i < problem.matches_2d2d.size(); ++i) {
    problem.matches_2d2d[i].query_keypoint = indices.of_2d2d[i];
  }
  for (size_t i = 0; i < problem.matches_2d3d.size(); ++i) {
    problem.matches_2d3d[i].query_keypoint = indices.of_2d3d[i];
  }
}

}  // namespace raylift
