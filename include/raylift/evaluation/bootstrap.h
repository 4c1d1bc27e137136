// Says whether a difference between two methods is more than luck with the queries: the bootstrap
// (Efron 1979). Queries are drawn with replacement, all methods are rated on the same draws, and
// the middle 95 % of what comes out is the interval.

#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "raylift/evaluation/pose_errors.h"

namespace raylift {

struct Interval {
  double low = 0;
  double high = 0;
  bool Contains(double value) const { return low <= value && value <= high; }
};

class QueryBootstrap {
 public:
  // Draws depend on the seed and the numbers alone. num_queries > 0.
  QueryBootstrap(size_t num_queries, uint64_t seed, int num_draws = 2000);

  // Returns the interval of the recall in percent. The comparison must have `num_queries` queries.
  Interval RecallPercent(const Comparison& comparison, const Threshold& threshold) const;

  // Returns that of recall(a) - recall(b) in percent. Where it contains 0, the difference is noise.
  Interval RecallDifferencePercent(const Comparison& a, const Comparison& b,
                                   const Threshold& threshold) const;

  // Returns that of the mean of one value per query.
  Interval Mean(std::span<const double> per_query) const;

  // The mean of `first` minus the largest mean of `others`, which is looked for anew in each
  // draw: the one that is best on all queries is partly so by luck. `others` is not empty.
  struct Difference {
    Interval interval;
    // Probabilities that `first` is not better than one of them, or not worse than any, one-sided,
    // by the normal approximation of each difference; not below what that many queries can show.
    double p_better = 1, p_worse = 1;
  };
  Difference ToBest(std::span<const double> first,
                    std::span<const std::vector<double>> others) const;

  // Returns that of the median position error; infinite where half of a draw has no pose.
  Interval MedianPosition(const Comparison& comparison) const;

 private:
  size_t num_queries_;
  std::vector<uint32_t> draws_;  // num_queries_ indices per draw
};

}  // namespace raylift
