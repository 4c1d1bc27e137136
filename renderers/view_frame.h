// What a view shows, through a lens or all around.

#pragma once

#include "raylift/renderers/frame_renderer.h"
#include "raylift/renderers/pixel_rays.h"
#include "raylift/scene/photographs.h"

namespace raylift {

PixelRays RaysOf(const ViewCamera& camera, int threads);

// Renders a view with a longer side of so many pixels, on one thread.
Frame RenderScaled(const FrameRenderer& renderer, const View& view, int longer_side_px);

}  // namespace raylift
