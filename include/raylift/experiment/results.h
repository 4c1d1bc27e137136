// What the cells of an experiment say: pose errors against the ground truth, pooled over runs: the
// seeds, times the offsets of the thinning.

#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raylift/evaluation/pose_errors.h"
#include "raylift/evaluation/recall.h"
#include "raylift/experiment/cell_store.h"
#include "raylift/experiment/cells.h"
#include "raylift/experiment/experiment.h"

namespace raylift {

// Values per query are means over the runs.
struct SettingResult {
  Setting setting;
  bool uses_ground_truth = false;       // an oracle's
  std::vector<Threshold> thresholds;    // of its scene
  std::vector<Comparison> comparisons;  // one per run; none: no ground truth is known

  size_t NumQueries() const;
  double RecallPercent(size_t threshold) const;
  double AucPercent(size_t threshold) const;
  double LocalizedPercent() const;
  double MedianPosition() const;  // over all queries and runs; infinite for no pose
  double MedianRotationDeg() const;

  // Share of the runs in which the query was within the threshold, in percent.
  std::vector<double> RecallPerQuery(size_t threshold) const;
  // The area under the recall curve up to the threshold: 100 for no error at all, 0 beyond it.
  std::vector<double> AucPerQuery(size_t threshold) const;
};

// One per setting, in order. InputError where a scene's ground truth is no good.
std::vector<SettingResult> CollectResults(const Experiment& experiment,
                                          std::span<const Setting> settings,
                                          std::span<const Cell> cells, const CellStore& store);

// One line per setting and threshold, for all who make their own tables and figures.
std::string FormatResultsCsv(std::span<const SettingResult> results);

// Poses of the scenes without ground truth, SCENE/SETTING-SEED.txt, as a benchmark's server takes
// them. Returns how many.
size_t WriteSubmissions(const std::filesystem::path& folder, const Experiment& experiment,
                        std::span<const Setting> settings, std::span<const Cell> cells,
                        const CellStore& store);

}  // namespace raylift
