// What the town's walls, roofs and ground are painted with.

#pragma once

#include "base/rng.h"
#include "canvas.h"
#include "town_plan.h"

namespace raylift::demo {

// What a house is made of; no two are alike.
struct HouseStyle {
  enum class Wall { kBrick, kPlaster, kTimber, kPlanks };
  Wall wall;
  Color base, trim, roof;
  double plinth_m;  // dressed stone at the foot, 0 for none
  uint32_t seed;

  static HouseStyle Draw(Rng& rng);
  // At a place on a wall, y from the ground floor.
  Color WallColor(double x, double y) const;
};

Canvas PaintWall(const HouseStyle& style, double width_m, double height_m, double px_per_m);
// The wall between the eaves and the ridge, with an attic's window.
Canvas PaintGable(const HouseStyle& style, double width_m, double rise_m, double wall_m,
                  double px_per_m, Rng& rng);
Canvas PaintRoof(const HouseStyle& style, House::Roof roof, double width_m, double height_m,
                 double px_per_m, Rng& rng);
// Streets with what is painted on them, pavements, paths to the houses, lawns and beds.
Canvas PaintTownGround(const Town& town, double px_per_m, Rng rng);

// Posters and graffiti on what is left free from x0 to x1 at the height of people.
void PaintTraces(Canvas& canvas, double x0, double x1, Rng& rng);

}  // namespace raylift::demo
