// The commands of the program.

#pragma once

#include <filesystem>
#include <functional>
#include <vector>

#include "apps/command_line.h"

namespace raylift {

struct Command {
  CLI::App* app;  // owned by the program; parses into flags that `run` keeps alive
  std::function<void()> run;
};

// Each function adds its command to the program.
Command AddLocalizeCommand(CLI::App& program);
Command AddDoctorCommand(CLI::App& program);
Command AddEstimateCommand(CLI::App& program);
Command AddEvaluateCommand(CLI::App& program);
Command AddPairsCommand(CLI::App& program);
Command AddExperimentCommand(CLI::App& program);
Command AddPerturbCommand(CLI::App& program);
Command AddRenderCommand(CLI::App& program);
Command AddCompareCommand(CLI::App& program);
Command AddViewsCommand(CLI::App& program);
Command AddImportCommand(CLI::App& program);
Command AddStatusCommand(CLI::App& program);
Command AddMergeCommand(CLI::App& program);
Command AddVerifyCommand(CLI::App& program);
Command AddExportCommand(CLI::App& program);
Command AddColorCommand(CLI::App& program);
Command AddFuseCommand(CLI::App& program);
Command AddCalibrateCommand(CLI::App& program);
Command AddLocateCommand(CLI::App& program);
Command AddMapCommand(CLI::App& program);
Command AddQueriesCommand(CLI::App& program);
Command AddPrepareCommand(CLI::App& program);
Command AddServeCommand(CLI::App& program);

// Writes the results of an experiment whose shards had folders of their own; `parts` are their
// manifests. Throws Interrupted where cells are missing.
void MergeExperiment(const std::filesystem::path& out,
                     const std::vector<std::filesystem::path>& parts);

}  // namespace raylift
