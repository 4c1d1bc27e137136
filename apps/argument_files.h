// Options that `--config FILE` and `--scene FILE` add to the command line.

#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "apps/command_line.h"

#include "raylift/io/scene_file.h"

namespace raylift {

// Returns the file's options as arguments of the command, without those that `command`, already
// parsed, was given on the command line. A key is an option's name without the dashes and stands at
// the top of the file or, then only for this command, in a table of the command's name (which
// wins); tables of other commands are passed over. Lists give repeated options, booleans set flags.
//
//   threads = 4
//   [localize]
//   model = "sfm"
//   geometry = ["mesh:scene.ply"]
//
// Throws InputError with the line for anything else.
std::vector<std::string> ConfigArguments(const std::filesystem::path& file,
                                         const CLI::App& command);

// Adds `--scene`, which main reads before the command runs.
void AddSceneOption(CLI::App& command);

// Returns as arguments what the scene file says for the options that `command`, already parsed, was
// not given. Of several geometries, takes the first that the command can use.
std::vector<std::string> SceneArguments(const SceneFile& scene, const CLI::App& command);

// Lets --geometry take the names of the scene's geometries, and converts earth-centered tiles to
// the coordinate system `crs` of the world, unless that is empty. To be called before the command
// is parsed.
void TakeGeometries(const SceneFile& scene, const std::string& crs, CLI::App& command);

}  // namespace raylift
