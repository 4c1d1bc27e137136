// The fusion's options as fields.

#pragma once

#include <vector>

#include "base/fields.h"

#include "raylift/mapping/fusion.h"

namespace raylift {

std::vector<Field> FieldsOf(FusionOptions& options);

}  // namespace raylift
