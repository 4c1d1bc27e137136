// The options that say how the references of a query are found.

#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include <CLI/App.hpp>

#include "raylift/localization/retrieval.h"

namespace raylift {

struct RetrievalFlags {
  std::optional<RetrievalMethod> method;
  GlobalFeatureFiles global_features;
  std::filesystem::path prior_poses;
  double max_angle_deg = 30;
  std::vector<double> view_range;

  // Any of the options is given.
  bool Any() const;
  // Whose poses queries have.
  enum class Queries { kOwn, kReferences };
  // What can be told without reading anything: all but poses, mesh and model. `geometry` are the
  // specifications of --geometry. Throws OptionError.
  RetrievalOptions Resolve(const std::vector<std::string>& geometry, Queries queries) const;
  // Reads the queries' prior poses where the method wants them.
  void ReadPriorPoses(RetrievalOptions* options) const;
};
void AddRetrievalOptions(CLI::App& app, RetrievalFlags& flags);

}  // namespace raylift
