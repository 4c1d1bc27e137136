// Which references a query is to be matched with.

#pragma once

#include <vector>

namespace raylift {

struct RetrievedReference {
  int reference_index;
  double score;  // the larger, the better
  bool operator==(const RetrievedReference&) const = default;
};

// Of each query, best first, the lower index first among equals.
using RetrievedLists = std::vector<std::vector<RetrievedReference>>;

}  // namespace raylift
