// What `raylift --help` says: which command does the job at hand, and how it is typed.

#pragma once

#include <CLI/App.hpp>

namespace raylift {

// The description of the program, and the groups of its commands; a command that is in
// none stays under "More". Call it when all commands are there.
void AddProgramHelp(CLI::App& program);

}  // namespace raylift
