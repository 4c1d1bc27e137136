// The perturbations of depth and odometry as fields.

#pragma once

#include <vector>

#include "base/fields.h"

#include "raylift/evaluation/perturbation.h"

namespace raylift {

std::vector<Field> FieldsOf(DepthPerturbation& values);
std::vector<Field> FieldsOf(OdometryPerturbation& values);

}  // namespace raylift
