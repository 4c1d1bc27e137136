// The paths in a specification of geometry, "kind:a.ply+b.ply,key=value".

#pragma once

#include <filesystem>
#include <functional>
#include <string>

namespace raylift {

// Returns the specification with each path moved: those after the kind, and of the keys that name a
// file (an orthophoto, a list of names, a transform). Other keys hold patterns within a folder, or
// no paths; other forms stay as they are.
std::string MapSpecPaths(
    const std::string& spec,
    const std::function<std::filesystem::path(const std::filesystem::path&)>& move);

}  // namespace raylift
