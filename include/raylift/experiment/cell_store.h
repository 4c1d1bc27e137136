// What came out of cells, kept in files.

#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/estimation/pose_estimator.h"
#include "raylift/experiment/cells.h"
#include "raylift/geometry/rigid3.h"

namespace raylift {

// What came out for one query.
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
  // None where the cell was not estimated, or its file is no good.
  std::optional<std::vector<QueryOutcome>> Read(const Cell& cell) const;
  void Write(const Cell& cell, std::span<const QueryOutcome> outcomes) const;

 private:
  std::filesystem::path FileOf(const Cell& cell) const;

  std::filesystem::path folder_;
};

}  // namespace raylift
