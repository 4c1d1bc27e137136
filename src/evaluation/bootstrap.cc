#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "base/rng.h"
#include "base/statistics.h"

#include "raylift/base/error.h"
#include "raylift/evaluation/pose_errors.h"

namespace raylift {
namespace {

Interval Middle95(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const auto at = [&](double share) {
    return values[static_cast<size_t>(std::lround(share * static_cast<double>(values.size() - 1)))];
  };
  return {at(0.025), at(0.975)};
}

std::vector<double> Hits(const Comparison& comparison, const Threshold& threshold) {
  std::vector<double> hits;
  for (const QueryError& query : comparison.queries) {
    hits.push_back(query.error && threshold.Accepts(*query.error) ? 100 : 0);
  }
  return hits;
}

}  // namespace

QueryBootstrap::QueryBootstrap(size_t num_queries, uint64_t seed, int num_draws)
    : num_queries_(num_queries) {
  RAYLIFT_CHECK(num_queries > 0 && num_draws > 0);
  Rng rng(StreamSeed(seed, "", "bootstrap"));
  draws_.reserve(num_queries * static_cast<size_t>(num_draws));
  for (size_t i = 0; i < num_queries * static_cast<size_t>(num_draws); ++i) {
    draws_.push_back(rng.UniformIndex(static_cast<uint32_t>(num_queries)));
  }
}

Interval QueryBootstrap::Mean(std::span<const double> per_query) const {
  RAYLIFT_CHECK_EQ(per_query.size(), num_queries_);
  std::vector<double> means;
  for (size_t begin = 0; begin < draws_.size(); begin += num_queries_) {
    double sum = 0;
    for (size_t i = begin; i < begin + num_queries_; ++i) sum += per_query[draws_[i]];
    means.push_back(sum / static_cast<double>(num_queries_));
  }
  return Middle95(std::move(means));
}

QueryBootstrap::Difference QueryBootstrap::ToBest(
    std::span<const double> first, std::span<const std::vector<double>> others) const {
  RAYLIFT_CHECK(!others.empty());
  const auto mean = [&](std::span<const double> per_query, size_t begin) {
    RAYLIFT_CHECK_EQ(per_query.size(), num_queries_);
    double sum = 0;
    for (size_t i = begin; i < begin + num_queries_; ++i) sum += per_query[draws_[i]];
    return sum / static_cast<double>(num_queries_);
  };
  std::vector<double> to_best;
  std::vector<double> sums(others.size(), 0), squares(others.size(), 0);
  for (size_t begin = 0; begin < draws_.size(); begin += num_queries_) {
    const double of_first = mean(first, begin);
    double smallest = std::numeric_limits<double>::infinity();
    for (size_t i = 0; i < others.size(); ++i) {
      const double difference = of_first - mean(others[i], begin);
      smallest = std::min(smallest, difference);
      sums[i] += difference;
      squares[i] += difference * difference;
    }
    to_best.push_back(smallest);
  }
  // All queries agree by chance with this probability.
  const double least = std::pow(0.5, static_cast<double>(num_queries_));
  Difference result;
  result.p_better = least;
  for (size_t i = 0; i < others.size(); ++i) {
    const double count = static_cast<double>(to_best.size());
    const double average = sums[i] / count;
    const double deviation = std::sqrt(std::max(0.0, squares[i] / count - average * average));
    const double z = deviation > 1e-9 * std::abs(average) ? average / deviation
                     : average == 0
                         ? 0
                         : std::copysign(std::numeric_limits<double>::infinity(), average);
    const auto tail = [least](double x) {
      return std::max(least, 0.5 * std::erfc(x / std::numbers::sqrt2));
    };
    // Better than all of them; worse than any of so many.
    result.p_better = std::max(result.p_better, tail(z));
    result.p_worse = std::min(result.p_worse, static_cast<double>(others.size()) * tail(-z));
  }
  result.interval = Middle95(std::move(to_best));
  return result;
}

Interval QueryBootstrap::RecallPercent(const Comparison& comparison,
                                       const Threshold& threshold) const {
  return Mean(Hits(comparison, threshold));
}

Interval QueryBootstrap::RecallDifferencePercent(const Comparison& a, const Comparison& b,
                                                 const Threshold& threshold) const {
  std::vector<double> differences = Hits(a, threshold);
  const std::vector<double> subtracted = Hits(b, threshold);
  RAYLIFT_CHECK_EQ(differences.size(), subtracted.size());
  for (size_t i = 0; i < differences.size(); ++i) differences[i] -= subtracted[i];
  return Mean(differences);
}

Interval QueryBootstrap::MedianPosition(const Comparison& comparison) const {
  RAYLIFT_CHECK_EQ(comparison.queries.size(), num_queries_);
  std::vector<double> errors;
  for (const QueryError& query : comparison.queries) {
    errors.push_back(query.error ? query.error->position : std::numeric_limits<double>::infinity());
  }
  std::vector<double> medians, drawn(num_queries_);
  for (size_t begin = 0; begin < draws_.size(); begin += num_queries_) {
    for (size_t i = 0; i < num_queries_; ++i) drawn[i] = errors[draws_[begin + i]];
    medians.push_back(MidpointMedianInPlace(std::span(drawn)));
  }
  return Middle95(std::move(medians));
}

}  // namespace raylift
