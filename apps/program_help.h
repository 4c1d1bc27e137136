// What the program says of itself: --help, and manual pages from the same source.

#pragma once

#include <filesystem>

#include "apps/command_line.h"

namespace raylift {

// The description of the program, and the groups of its commands; a command that is in
// none stays under "More". Call it when all commands are there.
void AddProgramHelp(CLI::App& program);

// One of the program, raylift.1, and one of each command, raylift-COMMAND.1, into `folder`, which is
// made. OutputError where they cannot be written.
void WriteManPages(const CLI::App& program, const std::filesystem::path& folder);

}  // namespace raylift
