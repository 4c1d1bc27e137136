// The program by its arguments, for main and for callers that are programs themselves.

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
  kBadOutput = 5,    // one that cannot be written
  kNoResources = 6   // out of memory or threads
};

// Runs one command. Returns the exit code, errors being told on stderr. Throws nothing but
// std::bad_alloc.
int RunProgram(const std::vector<std::string>& arguments);

// The same, but errors leave it as they are (Interrupted among them), and what cannot be parsed as
// an OptionError.
void RunCommand(const std::vector<std::string>& arguments);

// KindsOfOptions() of each command, by its name: Python's keywords are made of it.
std::map<std::string, std::map<std::string, std::string>> KindsOfCommands();

// The error's message in the words of the command line: "min_iterations = 0: ..." says
// "--min-iterations = 0: ...".
std::string MessageInOptions(const OptionError& error);

}  // namespace raylift
