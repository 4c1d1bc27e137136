// Poses by the names of their images.

#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "raylift/geometry/rigid3.h"

namespace raylift {

// Reads a pose file (ReadPoseFile()). Throws InputError where a name stands twice.
std::map<std::string, Rigid3> ReadNamedPoses(const std::filesystem::path& file);

// The same from a COLMAP model's folder or a pose file.
std::map<std::string, Rigid3> ReadModelOrPoses(const std::filesystem::path& model_or_file);

}  // namespace raylift
