// Manual pages from the same source as --help.

#pragma once

#include <filesystem>

#include <CLI/App.hpp>

namespace raylift {

// One of the program, raylift.1, and one of each command, raylift-COMMAND.1, into `folder`, which is
// made. OutputError where they cannot be written.
void WriteManPages(const CLI::App& program, const std::filesystem::path& folder);

}  // namespace raylift
