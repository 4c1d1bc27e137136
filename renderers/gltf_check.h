// What assimp takes for granted of a glTF file, and ends the process where it is not so. Private to
// renderers.

#pragma once

#include <filesystem>
#include <string_view>

namespace raylift {

// InputError naming the file and the JSON path where the file is no glTF 2 (text or binary), its
// sizes are beyond what is there, an index is beyond its list, or nodes are no tree.
void CheckGltf(const std::filesystem::path& path, std::string_view contents);

}  // namespace raylift
