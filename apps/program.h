// The program by its arguments, for main and for callers that are programs themselves.

#pragma once

#include <string>
#include <vector>

namespace raylift {

// Runs one command. Returns the exit code, errors being told on stderr:
//   0 done (queries that could not be localized are results)   1 a bug
//   2 a bad option                                             3 bad input
//   4 stopped by SIGINT or SIGTERM, or work is left            5 an output cannot be written
int RunProgram(const std::vector<std::string>& arguments);

// The same, but errors leave it as they are (Interrupted among them), and what cannot be parsed as
// an OptionError.
void RunCommand(const std::vector<std::string>& arguments);

}  // namespace raylift
