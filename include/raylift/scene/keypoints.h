// Groups matches by the keypoint of the query. A keypoint that is matched with several references
// has one error in all of its matches, and they show one point of the scene.
//
// Matches that are read or made from features carry the keypoint's index. Matches that carry none,
// as a caller may fill them in, are of one keypoint where their query pixels are equal: that is
// right wherever pixels are copies of the features'. Whatever groups matches asks for their
// keypoints here, and nothing else compares pixels to find them.

#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/pose_problem.h"

namespace raylift {

// Indices of keypoints are at most this; readers throw InputError for larger and for negative ones.
inline constexpr int kLargestKeypoint = 1'000'000'000;

// The keypoints of one image by their pixels.
class KeypointsByPixel {
 public:
  // Returns the keypoint at this pixel; where there is none yet, `index` becomes it. A pixel that
  // is not finite holds no keypoint.
  int FindOrAdd(const Eigen::Vector2d& pixel, int index);
  std::optional<int> Find(const Eigen::Vector2d& pixel) const;

 private:
  using Pixel = std::pair<double, double>;
  struct HashOfPixel {
    size_t operator()(const Pixel& pixel) const {
      return 31 * std::hash<double>()(pixel.first) + std::hash<double>()(pixel.second);
    }
  };
  std::unordered_map<Pixel, int, HashOfPixel> index_of_pixel_;
};

// Returns for each feature of an image the index of the first one at the same pixel: several
// features at one pixel, such as those of several orientations, are one keypoint.
std::vector<int> CanonicalKeypoints(std::span<const Eigen::Vector2d> pixels);

// The query keypoints of matches, numbered from 0 in the order of their first matches, those of
// `of_2d2d` before those of `of_2d3d`.
struct KeypointNumbers {
  std::vector<size_t> of_2d2d;
  std::vector<size_t> of_2d3d;
  size_t count = 0;
};
// Numbers the keypoints. Equal indices of one camera are one keypoint wherever its pixels are. A
// match without an index belongs to the first keypoint at its pixel that has one, else all matches
// without one at this pixel are one keypoint.
KeypointNumbers NumberQueryKeypoints(std::span<const Match2D2D> matches_2d2d,
                                     std::span<const Match2D3D> matches_2d3d);

// Returns the indices of each keypoint's matches, in their order, from the numbers of the matches.
std::vector<std::vector<size_t>> GroupByKeypoint(std::span<const size_t> numbers, size_t count);

// Gives an index to the matches that have none, by the same rule; indices of new keypoints follow
// the highest one in use.
void AssignKeypointsByPixel(PoseProblem& problem);

}  // namespace raylift
