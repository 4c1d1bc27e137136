// What is painted inside a facade's openings: glass with curtains behind it, doors, dark passages.

#pragma once

#include "canvas.h"
#include "facade.h"

namespace raylift::demo {

void PaintOpening(Canvas& canvas, const Opening& opening, Rng& rng);

}  // namespace raylift::demo
