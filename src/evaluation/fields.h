// The perturbations of depth as fields.

#pragma once

#include <vector>

#include "base/fields.h"

#include "raylift/evaluation/depth_perturbation.h"

namespace raylift {

std::vector<Field> FieldsOf(DepthPerturbation& values);

}  // namespace raylift
