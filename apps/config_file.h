// Options from a TOML file: what `--config FILE` adds to the command line.

#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include <CLI/App.hpp>

namespace raylift {

// The file's options as arguments of the command, without those that `command`, already parsed, was
// given on the command line. A key is an option's name without the dashes and stands at the top of
// the file or, then only for this command, in a table of the command's name (which wins); tables of
// other commands are passed over. Lists give repeated options, booleans set flags.
//
//   threads = 4
//   [localize]
//   model = "sfm"
//   geometry = ["mesh:scene.ply"]
//
// InputError with the line for anything else.
std::vector<std::string> ConfigArguments(const std::filesystem::path& file,
                                         const CLI::App& command);

}  // namespace raylift
