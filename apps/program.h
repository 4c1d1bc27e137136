// Runs the program by its arguments, for main and for callers that are programs themselves.

#pragma once

#include <map>
#include <string>
#include <vector>

#include "raylift/base/error.h"

namespace raylift {

enum ExitCode {
  kDone = 0,  // queries that could not be localized are results
  kBug = 1,
  kBadOption = 2,
  kBadInput = 3,
  kInterrupted = 4,  // stopped by SIGINT or SIGTERM, or work is left
  kBadOutput = 5,    // an output cannot be written
  kNoResources = 6   // out of memory or threads
};

// Runs one command and returns the exit code; errors are printed on stderr. Throws nothing but
// std::bad_alloc.
int RunProgram(const std::vector<std::string>& arguments);

// Runs one command and throws its errors as they are (Interrupted among them); what cannot be
// parsed is an OptionError.
void RunCommand(const std::vector<std::string>& arguments);

// Returns KindsOfOptions() of each command by its name, of which Python's keywords are made.
std::map<std::string, std::map<std::string, std::string>> KindsOfCommands();

// Returns the error's message in the words of the command line: "min_iterations = 0: ..." becomes
// "--min-iterations = 0: ...".
std::string MessageInOptions(const OptionError& error);

}  // namespace raylift
