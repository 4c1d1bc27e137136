// raylift experiment: a file that describes a grid in, its tables out.

#include <memory>

#include "commands.h"
#include "experiment_run.h"
#include "options.h"

namespace raylift {

Command AddExperimentCommand(CLI::App& program) {
  auto flags = std::make_shared<ExperimentFlags>();
  CLI::App* command = program.add_subcommand(
      "experiment", "Many ways to localize, from one file: a grid, its tables and its claims");
  command->add_option("file", flags->file, "The experiment, TOML (see assets/experiments)")
      ->required();
  command
      ->add_option("--datasets", flags->datasets,
                   "Folder of the data sets: ${DATASETS} in the file (default: of the environment)")
      ->group("Input");
  command
      ->add_option("--set", flags->variables,
                   "NAME=VALUE, repeated: ${NAME} in the file (default: of the environment)")
      ->allow_extra_args(false)
      ->group("Input");
  command
      ->add_flag("--own-features", flags->own_features,
                 "RootSIFT and VLAD made here instead of the file's features, matches and pairs")
      ->group("Input");
  command
      ->add_option("--out", flags->out,
                   "Folder for tables, figures, claims.md, results.csv, index.html, and for\n"
                   "cells: what is there already is not estimated again")
      ->required()
      ->group("Output");
  command
      ->add_flag("--dry-run", flags->dry_run, "Only list the grid and the inputs that are missing")
      ->group("Running");
  AddJobOptions(*command, flags->running,
                "What is there already is kept in any case; the option is for scripts",
                "Estimate all cells anew");
  AddRunOptions(*command, flags->run);
  command->footer(
      "A cell is one setting with one seed on up to 256 queries; each is kept the moment it is "
      "done.\n"
      "A signal ends the run after the queries in hand (exit code 4); the same command goes on.\n"
      "With --shard the cells are dealt in turn; the tables are written by the last shard of a\n"
      "folder, or by `raylift merge` of folders of their own, where the experiment's file and "
      "data\n"
      "must be there under the same paths.\n"
      "Examples:\n"
      "  raylift experiment assets/experiments/demo.toml --out out/experiment\n"
      "  raylift experiment assets/experiments/table1_aachen_scores.toml --datasets /data \\\n"
      "      --out out/table1");
  return {command, [flags, command] {
            flags->run.Check();
            flags->running.Check();
            if (flags->dry_run) {
              ListExperiment(*flags);
            } else {
              RunExperiment(*flags, EffectiveOptionsJson(*command));
            }
          }};
}

}  // namespace raylift
