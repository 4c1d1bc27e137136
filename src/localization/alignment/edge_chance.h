// How often chance shows a scene's edges in a photograph as well as a mode does.

#pragma once

#include <span>

#include "localization/alignment/edge_score.h"

namespace raylift {

// The probability that independent cells of no sign have as large a sum.
double ChanceOf(const CellScores& scores);

// What the cells of a score, taken for independent, say it is at the least: all but once in 44.
double LeastScore(const CellScores& cells);

// The probability that a search finds a mode as good as this by chance, of which the best ones of a
// search from so many times fewer positions are given, best first. The largest of many exceed a
// threshold as often as a Poisson process says, by amounts that are distributed exponentially. As
// their mean is known from so many of them alone, the exponential becomes a power. 1 where fewer
// than three are given.
double ChanceOfScore(double score, std::span<const double> by_chance, double times);

// The least probability that it was chance, if it was so or not with equal odds before and a search
// gives so good a mode with the probability p by chance: the odds are at least -e p log p (Sellke,
// Bayarri, Berger 2001).
double LeastProbabilityOfChance(double p);

}  // namespace raylift
