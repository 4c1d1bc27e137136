// The made town as it stands there: its map with textures, and what the map lacks.

#pragma once

#include "scene_writer.h"
#include "town_plan.h"

namespace raylift::demo {

struct TownScene {
  TexturedScene map;
  // What only photographs show, with the map's textures: trees, cars, parasols.
  MeshBuilder objects;
  // The fields around the town, for all pictures taken there.
  MeshBuilder fields;
};

TownScene BuildTown(const Town& town, uint64_t seed);

// In the town's frame.
std::vector<PosedImage> PhoneViews(const Town& town, const RayCaster& caster, Rng rng, int count);
std::vector<PosedImage> DroneViews(const Town& town, const RayCaster& caster, Rng rng, int count);

}  // namespace raylift::demo
