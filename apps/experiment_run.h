// The work of `raylift experiment`.

#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "job_options.h"
#include "options.h"

namespace raylift {

struct ExperimentFlags {
  std::filesystem::path file, out;
  std::string datasets;
  std::vector<std::string> variables;  // NAME=VALUE
  bool own_features = false;
  bool dry_run = false;
  RunFlags run;
  JobFlags running;
};

// As the options.json of a run has them, but for --out and how the work was shared. InputError where
// it is no such file.
ExperimentFlags ReadExperimentFlags(const std::filesystem::path& options_json);

// Prints what would be done, and what is missing for it.
void ListExperiment(const ExperimentFlags& flags);

// Estimates the cells of its shard that are not there yet, and writes the results where all are.
// `options_json` holds the effective options. Throws Interrupted.
void RunExperiment(const ExperimentFlags& flags, const std::string& options_json);

// The results from the cells of shards that had folders of their own; `parts` are their manifests.
// Throws Interrupted where cells are missing.
void MergeExperiment(const std::filesystem::path& out,
                     const std::vector<std::filesystem::path>& parts);

}  // namespace raylift
