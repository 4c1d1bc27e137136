// Writes the demo's files: the mesh as OBJ with its textures, the models and the lists.

#pragma once

#include <filesystem>
#include <vector>

#include "courtyard.h"

#include "raylift/scene/photographs.h"

namespace raylift::demo {

// scene.obj, scene.mtl and one JPEG per texture.
void WriteScene(const std::filesystem::path& folder, const Courtyard& yard);

// A COLMAP text model without points.
void WriteViews(const std::filesystem::path& folder, const std::vector<PosedImage>& views);

}  // namespace raylift::demo
