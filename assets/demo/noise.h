// Smooth random patterns that depend on nothing but coordinates and a seed: stains, grain, leaves.

#pragma once

#include <cstdint>

namespace raylift::demo {

// A number in [0, 1) for a lattice point.
double Hash(int x, int y, uint32_t seed);

// Value noise: random at the integer lattice, smooth between; in [0, 1).
double Noise(double x, double y, uint32_t seed);

// Octaves of noise, each twice as fine and half as strong; in [0, 1).
double FractalNoise(double x, double y, int octaves, uint32_t seed);

// The irregular cells around one random point per lattice square (Worley noise).
struct Cell {
  double edge_distance;  // second nearest minus nearest point's distance; 0 at the cell's border
  double id;             // the cell's own random number in [0, 1)
};
Cell CellNoise(double x, double y, uint32_t seed);

}  // namespace raylift::demo
