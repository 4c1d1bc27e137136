// City models of the town: its houses as blocks (LoD1) and with roofs (LoD2), and the ground.

#pragma once

#include <string>

#include "town_plan.h"

namespace raylift::demo {

// In kTownCrs, heights in meters, to the millimeter.
std::string CityJsonOf(const Town& town);  // 2.0
std::string CityGmlOf(const Town& town);   // 2.0

}  // namespace raylift::demo
