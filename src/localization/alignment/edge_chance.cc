#include "localization/alignment/edge_chance.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace raylift {

double ChanceOf(const CellScores& scores) {
  const double squares = scores.square().sum();
  if (!(squares > 0)) return 0.5;
  return 0.5 * std::erfc(scores.sum() / std::sqrt(2 * squares));
}

double LeastScore(const CellScores& cells) {
  return cells.sum() - 2 * std::sqrt(cells.square().sum());
}

double ChanceOfScore(double score, std::span<const double> by_chance, double times) {
  // As many of the best tell how fast better ones become rarer.
  constexpr size_t kMost = 10;
  if (by_chance.size() < 3) return 1;
  const size_t num_above = std::min(kMost, by_chance.size() - 1);
  const auto count = static_cast<double>(num_above);
  const double threshold = by_chance[num_above];
  double mean = 0;
  for (const double above : by_chance.first(num_above)) mean += (above - threshold) / count;
  if (!(mean > 0) || score < threshold) return 1;
  const auto is_as_good = [score](double other) { return other >= score; };
  const auto as_good =
      static_cast<double>(std::count_if(by_chance.begin(), by_chance.end(), is_as_good));
  const double expected = count * std::pow(1 + (score - threshold) / (count * mean), -count);
  return -std::expm1(-times * std::max(as_good, expected));
}

double LeastProbabilityOfChance(double p) {
  if (!(p < 1 / std::numbers::e)) return 1;
  if (!(p > 0)) return 0;
  const double odds = -std::numbers::e * p * std::log(p);
  return odds / (1 + odds);
}

}  // namespace raylift
