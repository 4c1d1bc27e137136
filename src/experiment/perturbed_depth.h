// Geometry made worse on purpose, as a folder of depth maps of a scene's references.

#pragma once

#include <filesystem>
#include <span>
#include <string>

#include "raylift/evaluation/depth_perturbation.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/scene/photographs.h"

namespace raylift {

// Writes the maps unless the folder is complete, and returns its specification. InputError where
// the geometry is neither a mesh nor depth maps.
std::string WritePerturbedDepth(const std::filesystem::path& folder, const std::string& spec,
                                const GeometryContext& context,
                                const DepthPerturbation& perturbation, int threads);

}  // namespace raylift
