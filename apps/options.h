// The options that several commands share: the same name means the same thing everywhere.

#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "base/progress.h"
#include <CLI/App.hpp>

#include "raylift/estimation/pose_estimator.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/lifting/consistency_filter.h"

namespace raylift {

struct EstimatorFlags {
  EstimatorOptions values;

  // Throws OptionError.
  EstimatorOptions Resolve() const;
};
void AddEstimatorOptions(CLI::App& app, EstimatorFlags& flags);
// Those of them that do not say which method: thresholds, RANSAC, the seed.
void AddEstimatorNumbers(CLI::App& app, EstimatorOptions& values, const std::string& group);

struct FilterFlags {
  FilterMode mode = FilterMode::kOff;
  ConsistencyThresholds thresholds;

  // Throws OptionError.
  FilterOptions Resolve() const;
};
void AddFilterOptions(CLI::App& app, FilterFlags& flags);
void AddFilterThresholds(CLI::App& app, ConsistencyThresholds& thresholds,
                         const std::string& group);

// What the poses of --model mean.
struct ModelPosesFlags {
  PoseConvention convention = PoseConvention::kCamFromWorld;

  PoseConvention Resolve() const { return convention; }
};
void AddModelPosesOption(CLI::App& app, ModelPosesFlags& flags);

struct RunFlags {
  int threads = 0;
  bool quiet = false;

  Progress::Show Show() const { return quiet ? Progress::Show::kNever : Progress::Show::kAuto; }
  // Throws OptionError.
  void Check() const;
};
void AddRunOptions(CLI::App& app, RunFlags& flags);

// Throws OptionError.
double ParsePositive(std::string_view option, const std::string& text);

// `--config`, which main reads before the command runs (config_file.h).
void AddConfigOption(CLI::App& app);

// Makes options that are numbers take plain decimal ones only: CLI11 alone reads 010 as 8 and -1 as
// the largest unsigned number.
void CheckNumbers(CLI::App& app);

// One line on stderr.
void PrintWarning(const std::string& warning);
void PrintWarnings(const std::vector<std::string>& warnings);

// "raylift COMMAND --option value ..." of all options that were given, also by files, as a shell
// takes it.
std::string CommandLine(const CLI::App& app);

// The options of a command with the values in effect, as JSON, for `options.json`: numbers and
// booleans as such, null where an option has no value.
std::string EffectiveOptionsJson(const CLI::App& app);

}  // namespace raylift
