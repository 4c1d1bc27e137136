// From the blocks of an experiment's file to its settings.

#pragma once

#include <vector>

#include "raylift/experiment/experiment.h"
#include "raylift/experiment/setting.h"

namespace raylift {

// Every setting of the grid once, in the order of the file. InputError naming the file where a
// block names what is not there.
std::vector<Setting> ExpandGrid(const Experiment& experiment);

// Whether the results of a setting are chosen from those of P3P and E5+1, without estimating: the
// oracle's always, Select's unless the filter is automatic, which treats P3P alone differently, or
// localization is continuous.
bool IsChosen(const Setting& setting, const Experiment& experiment);

// The settings that must be estimated for these, each once.
std::vector<Setting> SettingsToEstimate(const std::vector<Setting>& settings,
                                        const Experiment& experiment);
// The P3P and E5+1 settings that a chosen one is chosen from.
Setting P3pOf(const Setting& setting);
Setting E5p1Of(const Setting& setting);

}  // namespace raylift
