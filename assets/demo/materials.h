// The patches of the atlas by name.

#pragma once

#include <vector>

#include "atlas.h"
#include "mesh_builder.h"

namespace raylift::demo {

struct Materials {
  Material white_paint, green_paint, blue_paint, red_paint;
  Material stone, pale_stone, wood, dark_wood, iron, copper, terracotta, roof, bark, soil, water;
  Material louvers_blue, louvers_green, louvers_brown;
  Material awning, parasol, menu_board, lamp_glass, barrel;
  std::vector<Material> leaves, flowers, crates, cloths, signs;
};

Materials PaintMaterials(Atlas& atlas);

}  // namespace raylift::demo
