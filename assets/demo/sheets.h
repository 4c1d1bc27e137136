// The base coats of the four fronts and the ground, with what people have left on them: posters,
// graffiti, signs, stains.

#pragma once

#include <string>

#include "base/rng.h"
#include "canvas.h"

namespace raylift::demo {

// Damp at the foot of a wall, soot under the eaves.
void Weather(Canvas& canvas, uint32_t seed);
void PaintPoster(Canvas& canvas, const Rect& area, const std::string& title, Rng& rng);
void PaintGraffiti(Canvas& canvas, const Rect& area, const std::string& text, const Color& color,
                   Rng& rng);
void PaintHouseNumber(Canvas& canvas, double x, double y, const std::string& number);

Canvas PaintNorthSheet(Rng rng);  // brick town house, 16 m x 8.4 m
Canvas PaintEastSheet(Rng rng);   // ochre plaster, 12 m x 6.2 m
Canvas PaintSouthSheet(Rng rng);  // stone below, cream plaster above, 16 m x 8.6 m
Canvas PaintWestSheet(Rng rng);   // gray-green plaster, 12 m x 7 m
Canvas PaintGround(Rng rng);      // 16 m x 12 m

}  // namespace raylift::demo
