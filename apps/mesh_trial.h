// Meshes that may end the process that reads them are tried in another one first.

#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace raylift {

// `raylift --try-mesh FILE` is such a process.
inline constexpr const char* kTryMesh = "--try-mesh";

// Lets this command, with the file's path as its last argument, try such meshes (SetMeshTrial).
void TryMeshesBy(const std::vector<std::string>& command);

// Does what such a process is for: reads the mesh and returns 0, whatever is wrong with it.
int TryMesh(const std::filesystem::path& file);

}  // namespace raylift
