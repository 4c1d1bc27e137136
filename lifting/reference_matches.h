// Matches between references as one of the two sees them, and the depth that they triangulate. Each
// depth of a keypoint in a map puts it on another place of a line in the camera of its match.

#pragma once

#include <optional>
#include <span>
#include <vector>

#include "geometry/triangulation.h"
#include <Eigen/Core>

#include "raylift/geometry/camera.h"
#include "raylift/lifting/depth_alignment.h"
#include "raylift/scene/pose_problem.h"

namespace raylift {

// A match as one of its two references sees it.
struct HalfMatch {
  Eigen::Vector2d pixel;
  int other;  // reference
  Eigen::Vector2d other_px;
};

// Both halves of every match, by the reference that sees them, in the order of the matches.
std::vector<std::vector<HalfMatch>> HalvesByReference(std::span<const ReferenceMatch> matches,
                                                      size_t num_references);

// Returns the ray of a map's pixel in the other camera's frame, where ray_t is the depth z in the
// map; nullopt where the pixel has no ray in front of the map's image plane.
std::optional<SightLine> LineInOther(const PosedImage& map, const Eigen::Vector2d& pixel,
                                     const PosedImage& other);

// The depth at which the keypoint's ray passes closest to its match's ray.
struct TriangulatedDepth {
  double z;
  Eigen::Vector2d projected_px;  // in the other image
  // By how much a unit of log z moves the projection: the more, the better the depth is known.
  double gain_px;
};

// Returns nullopt where it lies behind either camera.
std::optional<TriangulatedDepth> TriangulateDepth(const SightLine& line_in_other,
                                                  const Camera& other_camera,
                                                  const Eigen::Vector2d& other_px);

}  // namespace raylift
