// Which libraries the program runs with.

#pragma once

#include <string>
#include <vector>

namespace raylift {

// The files of the shared libraries that were loaded and do the work, with their versions as their
// names have them ("libembree3.so.3.13.5"), sorted; what they need in turn is left out.
std::vector<std::string> LoadedLibraries();

}  // namespace raylift
