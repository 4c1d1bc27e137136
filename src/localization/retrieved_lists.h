// What all ways to retrieve share.

#pragma once

#include <algorithm>
#include <span>
#include <string>

#include "raylift/scene/features.h"

namespace raylift {

inline bool IsBetter(const RetrievedReference& a, const RetrievedReference& b) {
  return a.score != b.score ? a.score > b.score : a.reference_index < b.reference_index;
}

// The best k of a list, sorted.
inline void KeepBest(std::vector<RetrievedReference>* list, int k) {
  const auto count = std::min(static_cast<size_t>(std::max(0, k)), list->size());
  std::partial_sort(list->begin(), list->begin() + static_cast<std::ptrdiff_t>(count), list->end(),
                    IsBetter);
  list->resize(count);
}

// From lists of k + 1: without the query itself, k at most.
inline void DropOwn(std::span<const std::string> queries, std::span<const std::string> references,
                    int k, RetrievedLists* lists) {
  for (size_t i = 0; i < lists->size(); ++i) {
    auto& list = (*lists)[i];
    std::erase_if(list, [&](const RetrievedReference& r) {
      return references[static_cast<size_t>(r.reference_index)] == queries[i];
    });
    list.resize(std::min(list.size(), static_cast<size_t>(std::max(0, k))));
  }
}

}  // namespace raylift
