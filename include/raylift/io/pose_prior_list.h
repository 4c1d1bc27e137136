// What is known of queries' poses beforehand, as a text file:
//
//   # of a query: the camera's center in the world and its standard deviation, one or per axis
//   day/001.jpg position 465203.1 5428113.9 248.0 5
//   day/002.jpg position 465210.6 5428115.2 247.1 3 3 10
//   # of a query: down in the camera's frame (x right, y down, z forward), standard deviation, deg
//   day/001.jpg gravity 0.02 0.998 0.05 1
//   # of a query's camera: its focal length is the given one up to this factor either way
//   day/002.jpg focal_range 1.5
//   # down in the world; 0 0 -1 where no line says it
//   * world_down 0 0 -1

#pragma once

#include <filesystem>
#include <map>
#include <span>
#include <string>

#include "raylift/scene/photographs.h"

namespace raylift {

// By the query's name. `#` comments and empty lines are skipped; InputError for anything else, and
// for what is said twice.
std::map<std::string, PosePriors> ReadPosePriors(const std::filesystem::path& file);

// Gives each query what the file knows of it; a focal length that was guessed stays unknown where the
// file says nothing of it. InputError where that is nothing of any.
void TakePosePriors(const std::filesystem::path& file, std::span<Query> queries);

}  // namespace raylift
