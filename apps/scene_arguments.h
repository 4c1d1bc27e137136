// Options from a scene file: what `--scene FILE` adds to the command line.

#pragma once

#include <string>
#include <vector>

#include <CLI/App.hpp>

#include "raylift/io/scene_file.h"

namespace raylift {

// `--scene`, which main reads before the command runs.
void AddSceneOption(CLI::App& app);

// What the scene says for the options that `command`, already parsed, was not given, as arguments.
// Of several geometries the first is taken that the command can use.
std::vector<std::string> SceneArguments(const SceneFile& scene, const CLI::App& command);

// Lets --geometry take the names of the scene's geometries. Before the command is parsed.
void TakeGeometryNames(const SceneFile& scene, CLI::App& command);

}  // namespace raylift
