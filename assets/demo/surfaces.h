// What walls, grounds and things are made of: the color of a surface at a place (meters), from
// noise. Each function is a plain pattern; who paints adds stains and wear.

#pragma once

#include <cstdint>

#include "canvas.h"

namespace raylift::demo {

Color Brick(double x, double y, const Color& base, uint32_t seed);
Color Plaster(double x, double y, const Color& base, uint32_t seed);
// Dressed stone blocks of the given course height.
Color Ashlar(double x, double y, const Color& base, double course_m, uint32_t seed);
// Planks side by side along x, grain along y.
Color Planks(double x, double y, const Color& base, double plank_m, uint32_t seed);
Color RoughStone(double x, double y, const Color& base, uint32_t seed);
Color Cobbles(double x, double y, const Color& base, double stone_m, uint32_t seed);
Color Flagstones(double x, double y, const Color& base, double slab_m, uint32_t seed);
Color RoofTiles(double x, double y, uint32_t seed);
// Painted metal with rust.
Color Metal(double x, double y, const Color& base, uint32_t seed);
Color Foliage(double x, double y, const Color& base, uint32_t seed);
Color Water(double x, double y, uint32_t seed);
Color Cloth(double x, double y, const Color& base, uint32_t seed);
Color Bark(double x, double y, uint32_t seed);

}  // namespace raylift::demo
