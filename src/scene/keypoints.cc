#include "raylift/scene/keypoints.h"

#include <algorithm>
#include <limits>

#include "raylift/base/error.h"

namespace raylift {
namespace {

// An index for every match.
struct KeypointIndices {
  std::vector<int> of_2d2d;
  std::vector<int> of_2d3d;
};

// The given indices, and for matches without one those by their pixels.
class IndexCompletion {
 public:
  template <typename Match>
  void TakeGiven(std::span<const Match> matches) {
    for (const Match& match : matches) {
      if (!match.query_keypoint) continue;
      const int index = *match.query_keypoint;
      RAYLIFT_CHECK(index >= 0 && index < std::numeric_limits<int>::max());
      keypoints_.FindOrAdd(match.query_px, index);
      next_ = std::max(next_, index + 1);
    }
  }

  // After all given indices have been taken.
  template <typename Match>
  std::vector<int> Complete(std::span<const Match> matches) {
    std::vector<int> indices;
    indices.reserve(matches.size());
    for (const Match& match : matches) {
      indices.push_back(match.query_keypoint ? *match.query_keypoint : IndexAt(match.query_px));
    }
    return indices;
  }

 private:
  int IndexAt(const Eigen::Vector2d& pixel) {
    const int index = keypoints_.FindOrAdd(pixel, next_);
    if (index == next_) {
      RAYLIFT_CHECK(next_ < std::numeric_limits<int>::max());
      ++next_;
    }
    return index;
  }

  KeypointsByPixel keypoints_;
  int next_ = 0;
};

KeypointIndices CompleteIndices(std::span<const Match2D2D> matches_2d2d,
                                std::span<const Match2D3D> matches_2d3d) {
  IndexCompletion completion;
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
  return index_of_place_.try_emplace({pixel.x(), pixel.y()}, index).first->second;
}

std::optional<int> KeypointsByPixel::Find(const Eigen::Vector2d& pixel) const {
  const auto found = index_of_place_.find({pixel.x(), pixel.y()});
  if (found == index_of_place_.end()) return std::nullopt;
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
  std::unordered_map<int, size_t> number_of_index;
  const auto numbers_of = [&number_of_index](const std::vector<int>& of_matches) {
    std::vector<size_t> numbers;
    numbers.reserve(of_matches.size());
    for (const int index : of_matches) {
      numbers.push_back(number_of_index.try_emplace(index, number_of_index.size()).first->second);
    }
    return numbers;
  };
  KeypointNumbers numbers;
  numbers.of_2d2d = numbers_of(indices.of_2d2d);
  numbers.of_2d3d = numbers_of(indices.of_2d3d);
  numbers.count = number_of_index.size();
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
