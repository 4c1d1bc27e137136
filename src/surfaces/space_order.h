// Orders points so that neighbors in space are close to each other in memory.

#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace raylift {

// Returns the points' indices along Morton's curve through a grid over all of them, of 2^bits cells
// along each axis (21 at most); in their own order within a cell.
std::vector<uint32_t> OrderInSpace(const std::vector<Eigen::Vector3f>& points, unsigned bits);

}  // namespace raylift
