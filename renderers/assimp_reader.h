// Every mesh format without a reader of our own, through assimp. Its coordinates are float.

#pragma once

#include <filesystem>

#include "raw_mesh.h"

namespace raylift {

// All meshes of the file's node graph, in the root's frame.
RawMesh ReadWithAssimp(const std::filesystem::path& path);

}  // namespace raylift
