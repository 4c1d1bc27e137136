// Matches between references, from the matches of queries: where a query keypoint is matched with
// several references, the matched keypoints show the same thing. They tell how well a source of
// geometry fits the references' poses without any ground truth.

#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/pose_problem.h"

namespace raylift {

// Indices count in a list of references that comes with the matches.
struct ReferenceMatch {
  int reference_a = 0;
  int reference_b = 0;  // another
  Eigen::Vector2d a_px;
  Eigen::Vector2d b_px;
};

// All pairs of keypoints of different references that are matched with one query keypoint; each
// pair once.
std::vector<ReferenceMatch> TransitiveMatches(std::span<const Match2D2D> matches);

// A match as one of its two references sees it.
struct HalfMatch {
  Eigen::Vector2d pixel;
  int other;  // reference
  Eigen::Vector2d other_px;
};

// Both halves of every match, by the reference that sees them, in the order of the matches.
std::vector<std::vector<HalfMatch>> HalvesByReference(std::span<const ReferenceMatch> matches,
                                                      size_t num_references);

}  // namespace raylift
