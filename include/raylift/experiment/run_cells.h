// Estimates the cells of an experiment that are not there yet. References, matches and lifted
// points are made once for all cells that share them.

#pragma once

#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "raylift/experiment/cell_store.h"
#include "raylift/experiment/cells.h"
#include "raylift/experiment/experiment.h"
#include "raylift/localization/scene.h"

namespace raylift {

struct RunCellsOptions {
  // Features that are made here and perturbed depth are kept here.
  std::filesystem::path cache;
  int threads = 0;
  std::function<void()> on_estimate = {};              // of one query of one cell; from any thread
  std::function<void(const Cell& cell)> on_cell = {};  // it is in the store; from any thread
  WrapSource wrap_source = {};
};

// `cells` as ListCells() orders them. Each is written to the store the moment it is complete, and
// stays there where a watch of the call (base/parallel.h) ends the others.
// Returns what the user should be told. Results do not depend on the number of threads.
std::vector<std::string> RunCells(const Experiment& experiment, std::span<const Cell> cells,
                                  const CellStore& store, const RunCellsOptions& options);

}  // namespace raylift
