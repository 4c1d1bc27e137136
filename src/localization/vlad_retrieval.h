// Retrieval by VLAD from features that are in memory.

#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>

#include "raylift/features/dot_product_search.h"
#include "raylift/scene/features.h"

namespace raylift {

// The vocabulary is learned from the references alone, so that a query's references do not depend
// on the other queries. All images must be in `features`; no query is its own reference.
RetrievedLists RetrieveByVlad(std::span<const std::string> queries,
                              std::span<const std::string> references,
                              const std::map<std::string, Features>& features, int top_k,
                              uint64_t seed, int threads);

}  // namespace raylift
