// The options' names for the fields of the library's options.

#pragma once

#include <string>

#include "raylift/base/error.h"

namespace raylift {

// The error's message in the words of the command line: "min_iterations = 0: ..." says
// "--min-iterations = 0: ...".
std::string MessageInOptions(const OptionError& error);

}  // namespace raylift
