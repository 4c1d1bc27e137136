// Runs a program as a user does and looks at what comes out of it.

#pragma once

#include <string>
#include <vector>

namespace raylift {

struct CommandResult {
  int exit_code;  // 128 + the signal's number where one ended it
  std::string out;
  std::string err;
};

// arguments[0] is the program; no shell is involved.
CommandResult RunProcess(const std::vector<std::string>& arguments);

}  // namespace raylift
