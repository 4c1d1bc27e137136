// The parts of an experiment's file that speak of its grid: selections of settings, and the tables,
// figures and claims that are made of them.

#pragma once

#include "io/text/toml_file.h"

#include "raylift/experiment/experiment.h"

namespace raylift {

// Every axis that the table names. Throws InputError where an axis cannot have a value: the
// experiment's scenes and filters must be known.
Selection ReadSelection(TomlTable& table, const Experiment& experiment);

// Adds [[table]], [[figure]] and [[claim]] of the whole file to the experiment.
void ReadLayouts(TomlTable& top, Experiment& experiment);

}  // namespace raylift
