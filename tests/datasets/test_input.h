// Poses for tiny data sets.

#pragma once

#include "support/dataset_layouts.h"
#include "support/matchers.h"

namespace raylift {

inline LayoutInput RandomInput(size_t num_references = 6, size_t num_queries = 2) {
  Rng rng = TestRng();
  LayoutInput input;
  for (size_t i = 0; i < num_references; ++i) input.references.push_back(RandomRigid3(rng, 10));
  for (size_t i = 0; i < num_queries; ++i) input.queries.push_back(RandomRigid3(rng, 10));
  return input;
}

}  // namespace raylift
