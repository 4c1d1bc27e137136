// Runs the cells of an experiment. A cell is one setting with one seed on a block of a scene's
// queries; its results are kept in a file that is named by the hash of all its inputs, so that a
// cell is estimated once and a changed input is noticed.

#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/estimation/pose_estimator.h"
#include "raylift/experiment/experiment.h"
#include "raylift/geometry/rigid3.h"
#include "raylift/localization/scene.h"
#include "raylift/scene/photographs.h"

namespace raylift {

struct Cell {
  Setting setting;
  uint64_t seed = 0;
  size_t offset = 0;          // of the first reference that is taken
  size_t begin = 0, end = 0;  // of the scene's queries
  std::string inputs;         // all that went in, as JSON

  std::string Key() const;  // the hash of the inputs
};

// Says whether a file or folder is still the same: by its contents, or, where it is large, by sizes
// and times of modification. Remembers what it looked at. Throws InputError where there is nothing.
class InputIdentity {
 public:
  const std::string& Of(const std::filesystem::path& path);

 private:
  std::map<std::filesystem::path, std::string> known_;
};

// Returns a path with the subsampling in place of "{every}".
std::filesystem::path ForSubsampling(const std::filesystem::path& path, size_t every);

// Returns the queries of a scene, or those of its group. Throws InputError where there are none.
std::vector<Query> QueriesOf(const ExperimentScene& scene);

// Returns the input files of the settings' scenes that are missing.
std::vector<std::filesystem::path> MissingInputs(const Experiment& experiment,
                                                 std::span<const Setting> settings);

// Returns the number of offsets with which the subsampling is run.
size_t NumOffsets(const Experiment& experiment, const Setting& setting);

// Returns the cells of the settings, ordered by scene, subsampling, block of queries and geometry.
// Throws InputError where an input is missing.
std::vector<Cell> ListCells(const Experiment& experiment, std::span<const Setting> settings);

// The result of one query.
struct QueryOutcome {
  std::string name;
  std::optional<Rigid3> cam_from_world;
  bool position_observable = true;
  std::string reason;  // why it counts as not localized; empty: localized
  int inliers_2d3d = 0, inliers_2d2d = 0;
  int matches_2d3d = 0, matches_2d2d = 0;
  Solver solver = Solver::kP3p;

  bool operator==(const QueryOutcome&) const;
};

// A folder of cells' files.
class CellStore {
 public:
  explicit CellStore(std::filesystem::path folder);

  bool Has(const Cell& cell) const { return Read(cell).has_value(); }
  // Returns nullopt if the cell was not estimated, or its file is damaged.
  std::optional<std::vector<QueryOutcome>> Read(const Cell& cell) const;
  void Write(const Cell& cell, std::span<const QueryOutcome> outcomes) const;
  std::filesystem::path FileOf(const Cell& cell) const;

 private:
  std::filesystem::path folder_;
};

struct RunCellsOptions {
  // Folder of the features that are made here and of perturbed depth.
  std::filesystem::path cache;
  int threads = 0;
  std::function<void()> on_estimate = {};              // of one query of one cell; from any thread
  std::function<void(const Cell& cell)> on_cell = {};  // it is in the store; from any thread
  WrapSource wrap_source = {};
};

// Estimates the cells that are not there yet; references, matches and lifted points are made once
// for all cells that share them. `cells` is ordered as by ListCells(). Each is written to the store
// the moment it is complete, and stays there where a watch of the call (base/call_watch.h) ends the
// others. Returns warnings for the user. Results do not depend on the number of threads.
std::vector<std::string> RunCells(const Experiment& experiment, std::span<const Cell> cells,
                                  const CellStore& store, const RunCellsOptions& options);

}  // namespace raylift
