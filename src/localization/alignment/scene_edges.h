// Finds the edges of a scene as a camera sees them: where one surface ends before another, where
// surfaces meet at an angle, and where the scene ends before the sky.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "raylift/geometry/rigid3.h"
#include "raylift/renderers/frame_renderer.h"
#include "raylift/renderers/pixel_rays.h"

namespace raylift {

enum class SceneEdgeKind : uint8_t { kOccluding, kCrease, kSkyline };

// A short piece of an edge.
struct SceneEdge {
  Eigen::Vector3d point_in_world;
  // Unit, along the edge as it is seen: across the ray.
  Eigen::Vector3d tangent_in_world;
  double length_px;  // in the picture that it was seen in
  SceneEdgeKind kind;
};

// Returns the maps that a frame must hold for SceneEdges().
FrameOptions FrameOfEdges();

// Returns up to `most` pieces, drawn evenly from all; their lengths add up to that of all.
std::vector<SceneEdge> SceneEdges(const Frame& frame, const PixelRays& rays,
                                  const Rigid3& cam_from_world, size_t most);

}  // namespace raylift
