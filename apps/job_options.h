// The options of long commands that go on where they were, and share their work with other
// machines.

#pragma once

#include <filesystem>
#include <string>

#include <CLI/App.hpp>

#include "raylift/jobs/task_job.h"

namespace raylift {

struct JobFlags {
  bool resume = false;
  bool overwrite = false;
  std::string shard = "0/1";

  // Throws OptionError.
  void Check() const;
  // By the environment, where that is asked for. Throws OptionError.
  Shard Resolve() const;
  // The job that these make of a run to `out`.
  JobFolder In(const std::filesystem::path& out) const;
};

// Of commands that keep nothing to go on with: whether a finished run may be replaced.
void AddOverwriteOption(CLI::App& app, bool& overwrite);
// OptionError where `file`, which a run writes last, is there.
void RefuseFinished(const std::filesystem::path& file, bool overwrite);

// `resume` and `overwrite` are the helps of these options.
void AddJobOptions(CLI::App& app, JobFlags& flags, const std::string& resume,
                   const std::string& overwrite);

}  // namespace raylift
