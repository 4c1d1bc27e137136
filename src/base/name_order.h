// Names in the order in which people count.

#pragma once

#include <map>
#include <span>
#include <string>

namespace raylift {

// Returns each name's place, from 0, in the order of the numbers in the names: img_2 is before
// img_10.
std::map<std::string, double> PlacesByNumbers(std::span<const std::string> names);

}  // namespace raylift
