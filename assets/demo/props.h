// The things in the yard. Each is built in a frame whose z points up and whose origin is where it
// stands.

#pragma once

#include "materials.h"
#include "mesh_builder.h"

namespace raylift::demo {

struct PropContext {
  MeshBuilder& mesh;
  const Materials& materials;
  Rng& rng;
};

void AddFountain(PropContext& context, const Frame& frame);
void AddCrate(PropContext& context, const Frame& frame, double size_m, size_t which);
void AddBarrel(PropContext& context, const Frame& frame, double height_m);
void AddBench(PropContext& context, const Frame& frame);
void AddTable(PropContext& context, const Frame& frame);
void AddChair(PropContext& context, const Frame& frame, const Material& paint);
void AddPlanter(PropContext& context, const Frame& frame, double length_m);
void AddPot(PropContext& context, const Frame& frame, double height_m);
void AddTree(PropContext& context, const Frame& frame, double height_m, int leaves);
void AddMenuBoard(PropContext& context, const Frame& frame);
void AddLampPost(PropContext& context, const Frame& frame);
void AddCart(PropContext& context, const Frame& frame);
void AddLadder(PropContext& context, const Frame& frame, double height_m);
void AddParasol(PropContext& context, const Frame& frame);
// Its front looks along x.
void AddCar(PropContext& context, const Frame& frame, const Material& paint, const Material& glass);
// Washing on a sagging line.
void AddWashingLine(PropContext& context, const Eigen::Vector3d& from, const Eigen::Vector3d& to);

// Leaves around a ball (half axes `radii`), as a bush or a crown has them.
void AddLeaves(PropContext& context, const Frame& frame, const Eigen::Vector3d& radii, int count,
               double leaf_m, const std::vector<Material>& kinds);
// Leaves in front of a wall (the frame's x, y plane; z out of it), thinning out upwards.
void AddIvy(PropContext& context, const Frame& wall, double x0, double x1, double top_m, int count);

}  // namespace raylift::demo
