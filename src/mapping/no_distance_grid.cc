// Replaces the grid in a build without OpenVDB.

#include "mapping/distance_grid.h"

#include "raylift/base/error.h"

namespace raylift {

bool CanFuse() { return false; }

struct DistanceGrid::Impl {};

DistanceGrid::DistanceGrid(const DistanceGridOptions&) { RequireFusion(); }
DistanceGrid::~DistanceGrid() = default;
void DistanceGrid::MakeBlocks(std::span<const ViewPlanes>) {}
void DistanceGrid::Add(const ViewPlanes&) {}
ZeroSurface DistanceGrid::Surface() { return {}; }
size_t DistanceGrid::MemoryBytes() const { return 0; }

}  // namespace raylift
