// Tries meshes that may end the process that reads them in another process first.

#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace raylift {

// `raylift --try-mesh FILE` is that process.
inline constexpr const char* kTryMesh = "--try-mesh";

// Makes `command`, with the file's path as its last argument, try such meshes (SetMeshTrial).
void TryMeshesBy(const std::vector<std::string>& command);

// Does the work of that process: reads the mesh and returns 0, whatever is wrong with it.
int TryMesh(const std::filesystem::path& file);

}  // namespace raylift
