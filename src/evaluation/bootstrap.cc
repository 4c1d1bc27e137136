#include "raylift/evaluation/bootstrap.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "raylift/base/error.h"
#include "raylift/base/median.h"
#include "raylift/base/rng.h"

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
  std::vector<double> differences;
  double sum = 0;
  for (size_t begin = 0; begin < draws_.size(); begin += num_queries_) {
    double best = -std::numeric_limits<double>::infinity();
    for (const std::vector<double>& other : others) best = std::max(best, mean(other, begin));
    differences.push_back(mean(first, begin) - best);
    sum += differences.back();
  }
  const double average = sum / static_cast<double>(differences.size());
  double squares = 0;
  for (const double d : differences) squares += (d - average) * (d - average);
  const double deviation = std::sqrt(squares / static_cast<double>(differences.size()));
  double p_value = average == 0 ? 1 : 0;
  if (deviation > 0) p_value = std::erfc(std::abs(average) / deviation / std::numbers::sqrt2);
  return {Middle95(std::move(differences)), p_value};
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
