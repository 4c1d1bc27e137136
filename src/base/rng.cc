#include "base/rng.h"

#include <cmath>

namespace raylift {
namespace {

uint64_t SplitMix64(uint64_t& state) {
  state += 0x9E3779B97F4A7C15ull;
  uint64_t z = state;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBull;
  return z ^ (z >> 31);
}

// Returns the FNV-1a hash, continued from `hash`.
uint64_t HashBytes(uint64_t hash, std::string_view bytes) {
  for (const char c : bytes) {
    hash ^= static_cast<unsigned char>(c);
    hash *= 0x100000001B3ull;
  }
  return hash;
}

}  // namespace

Rng::Rng(uint64_t seed) {
  for (uint64_t& word : state_) word = SplitMix64(seed);
}

double Rng::Normal() {
  while (true) {
    const double x = Uniform(-1, 1);
    const double y = Uniform(-1, 1);
    const double s = x * x + y * y;
    if (s > 0 && s < 1) return x * std::sqrt(-2 * std::log(s) / s);
  }
}

uint64_t StreamSeed(uint64_t seed, std::string_view name, std::string_view purpose) {
  uint64_t hash = 0xCBF29CE484222325ull;
  hash = HashBytes(hash, name);
  hash = HashBytes(hash, std::string_view("\0", 1));
  hash = HashBytes(hash, purpose);
  uint64_t state = hash ^ (seed * 0x9E3779B97F4A7C15ull);
  return SplitMix64(state);
}

}  // namespace raylift
