// The same queries localized in many ways, for comparisons: what ways have in common, their matches
// above all, is made once, so that what differs in the results is what differs in the ways.

#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "raylift/localization/localizer.h"

namespace raylift {

class GridLocalizer {
 public:
  // All have the same source of matches and the same references. At least one.
  explicit GridLocalizer(std::vector<Localizer> ways);

  size_t size() const { return ways_.size(); }
  const Localizer& way(size_t index) const { return ways_[index]; }

  // Hands each way's result to `take`, whose calls may come in any order and, for different ways,
  // from several threads. Results do not depend on the number of threads.
  using Take = std::function<void(size_t way, const QueryResult& result)>;
  void Localize(const Query& query, int threads, const Take& take) const;
  // The same from what Localizer::Match() of any of the ways has made.
  void Localize(const QueryResult& matched, int threads, const Take& take) const;

  // What Localizer::Match() has made, by query, as far as it was needed.
  using Matched = std::vector<std::optional<QueryResult>>;
  // The same ways, which know what the matches of the scene's queries have in common, as each way
  // finds it (CommonNoise()): learned from NoiseSample(), which is matched where it is not yet.
  // Ways that do not use it, or localize fewer than three of these queries, stay as they are.
  GridLocalizer WithSceneNoise(std::span<const Query> queries, Matched& matched, int threads) const;

 private:
  // Ways that filter alike, among those that lift alike.
  struct Filtered {
    std::vector<size_t> ways;
  };
  struct Lifted {
    std::vector<Filtered> filtered;
  };

  std::vector<Localizer> ways_;
  std::vector<Lifted> tree_;
};

// The queries that a scene's noise is learned from: some 30, the same ones whatever their order.
std::vector<size_t> NoiseSample(std::span<const Query> queries);

}  // namespace raylift
