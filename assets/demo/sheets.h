// The base coats of the four fronts and the ground, with what people have left on them: posters,
// graffiti, signs, stains.

#pragma once

#include "base/rng.h"
#include "canvas.h"

namespace raylift::demo {

Canvas PaintNorthSheet(Rng rng);  // brick town house, 16 m x 8.4 m
Canvas PaintEastSheet(Rng rng);   // ochre plaster, 12 m x 6.2 m
Canvas PaintSouthSheet(Rng rng);  // stone below, cream plaster above, 16 m x 8.6 m
Canvas PaintWestSheet(Rng rng);   // gray-green plaster, 12 m x 7 m
Canvas PaintGround(Rng rng);      // 16 m x 12 m

}  // namespace raylift::demo
