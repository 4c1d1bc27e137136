// Where what nerfstudio exports belongs: it trains in a frame of its own, whose way from the data
// set's is in dataparser_transforms.json. Private to lifting.

#pragma once

#include <filesystem>

#include "raylift/lifting/mesh_placement.h"

namespace raylift {

inline constexpr const char* kNerfstudioTransforms = "dataparser_transforms.json";

// point_in_model = scale * (transform * point_in_world), the other way round. InputError naming the
// file and field.
MeshPlacement ReadNerfstudioPlacement(const std::filesystem::path& path);

}  // namespace raylift
