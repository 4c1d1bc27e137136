// A house of the town as it stands there: facades with windows and doors, a roof that reaches over
// them, dormers, chimneys, parapets.

#pragma once

#include "materials.h"
#include "mesh_builder.h"
#include "town_plan.h"

#include "raylift/scene/image.h"

namespace raylift::demo {

struct BuiltHouse {
  MeshBuilder mesh;
  Image sheet;  // its own texture
};

// `number` is painted beside its door; `texture` is the index that its sheet will have.
BuiltHouse BuildHouse(const House& house, const Materials& materials, int number, int texture,
                      Rng rng);

}  // namespace raylift::demo
