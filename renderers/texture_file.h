// Pictures on a mesh, from files beside it or from memory.

#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>

#include "raw_mesh.h"

#include "raylift/scene/image.h"

namespace raylift {

// The picture as RGB; none where the bytes are no picture that can be decoded.
std::optional<Image> DecodeTexture(std::span<const uint8_t> bytes);

// Adds the picture `name`, as the mesh file calls it (relative to the mesh's folder; Windows
// separators allowed), to the textures and returns its index. -1 and a warning where it cannot be
// read: a mesh is of use without its texture.
int32_t AddTextureFile(const std::filesystem::path& mesh_path, const std::string& name,
                       RawMesh& mesh);

}  // namespace raylift
