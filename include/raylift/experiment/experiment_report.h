// The page of an experiment: its tables, curves over the thinning, and what its claims come to.

#pragma once

#include <span>
#include <string>

#include "raylift/experiment/claims.h"
#include "raylift/experiment/experiment.h"
#include "raylift/experiment/pivot.h"
#include "raylift/experiment/results.h"

namespace raylift {

std::string FormatExperimentPage(const Experiment& experiment, std::span<const PivotTable> tables,
                                 std::span<const SettingResult> results,
                                 std::span<const JudgedClaim> claims);

// The figure's points as CSV: panel, line, thinning, a column per value.
std::string FormatFigureCsv(const Experiment& experiment, const FigureLayout& layout,
                            std::span<const SettingResult> results);

}  // namespace raylift
