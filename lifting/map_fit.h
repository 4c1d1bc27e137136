// Networks take pictures of few sizes: they stretch, cut or pad a photograph before they make a map
// of it. Cut and padded maps are laid into the photograph again here, sample by sample.

#pragma once

#include <filesystem>

#include "raylift/io/depth_file.h"
#include "raylift/lifting/depth_source.h"
#include "raylift/scene/image.h"

namespace raylift {

// Returns the map on the whole photograph: 0 where it has no samples, and without those beyond it.
// InputError naming the file where the photograph would take more samples than a map can have.
StoredDepth OnWholeImage(StoredDepth map, MapFit fit, PlaneSize image,
                         const std::filesystem::path& file_for_messages);

}  // namespace raylift
