// Lists of views: cameras with poses, one per line.

#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "raylift/scene/photographs.h"

namespace raylift {

// Lines `name qw qx qy qz tx ty tz MODEL width height params...` (a line of a pose file, world to
// camera, followed by one of COLMAP's cameras, or by EQUIRECTANGULAR width height); `#` comments
// and empty lines are skipped. Throws InputError for anything else, and for a name that stands
// twice.
std::vector<View> ReadViewList(const std::filesystem::path& path);

// "MODEL width height params..." as in the lists. Throws InputError naming `what` for anything
// else.
Camera ParseCamera(const std::string& what, const std::string& text);

// Lines `x y z`; `#` comments and empty lines are skipped.
std::vector<Eigen::Vector3d> ReadPointList(const std::filesystem::path& path);

}  // namespace raylift
