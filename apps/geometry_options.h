// The options that say where 3D points come from.

#pragma once

#include <string>
#include <vector>

#include <CLI/App.hpp>

#include "raylift/lifting/candidates.h"
#include "raylift/lifting/depth_alignment.h"
#include "raylift/lifting/lifter.h"

namespace raylift {

struct GeometryOptions {
  GeometryMode mode = GeometryMode::kFirst;
  AlignMode align = AlignMode::kAuto;
  CandidateOptions candidates;
};

struct GeometryFlags {
  std::vector<std::string> specs;  // in the order in which sources are asked
  GeometryOptions values;

  // Throws OptionError.
  GeometryOptions Resolve() const;
};
void AddGeometryOptions(CLI::App& app, GeometryFlags& flags);
// Those of them that say what is made of a keypoint's points.
void AddCandidateOptions(CLI::App& app, CandidateOptions& candidates, const std::string& group);

}  // namespace raylift
