// The commands of the program: each adds its subcommand with what runs it.

#pragma once

#include <CLI/CLI.hpp>

namespace raylift {

void AddLocalizeCommand(CLI::App& program);
void AddEstimateCommand(CLI::App& program);
void AddEvaluateCommand(CLI::App& program);

}  // namespace raylift
