// Cuts polygons into triangles.

#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Core>

namespace raylift {

// The triangles of a (nearly) plane, simple polygon as indices into `corners`, by cutting ears;
// concave polygons are filled correctly. A polygon that is not simple, or has a corner that is not
// finite, comes back as a fan. Three corners or more; n - 2 triangles, wound as the polygon.
std::vector<std::array<uint32_t, 3>> TriangulatePolygon(std::span<const Eigen::Vector3d> corners);

}  // namespace raylift
