// A small portable random number generator, so that a seed gives the same numbers on every machine
// and with every standard library (whose distributions differ).

#pragma once

#include <array>
#include <cstdint>
#include <string_view>

namespace raylift {

// The generator xoshiro256** by Blackman and Vigna (2018), seeded by splitmix64.
class Rng {
 public:
  explicit Rng(uint64_t seed);

  uint64_t NextBits() {
    const uint64_t result = RotateLeft(state_[1] * 5, 7) * 9;
    const uint64_t t = state_[1] << 17;
    state_[2] ^= state_[0];
    state_[3] ^= state_[1];
    state_[1] ^= state_[2];
    state_[0] ^= state_[3];
    state_[2] ^= t;
    state_[3] = RotateLeft(state_[3], 45);
    return result;
  }

  // Returns a uniform integer in [0, n); n > 0. By multiplication (Lemire 2019); its bias of n /
  // 2^32 is far below what any sampling here could show.
  uint32_t UniformIndex(uint32_t n) {
    return static_cast<uint32_t>(((NextBits() >> 32) * uint64_t{n}) >> 32);
  }

  // Returns a uniform number in [0, 1), of 53 bits.
  double Uniform() { return static_cast<double>(NextBits() >> 11) * 0x1.0p-53; }

  double Uniform(double low, double high) { return low + (high - low) * Uniform(); }

  // Returns a standard normal number, by the polar method of Marsaglia.
  double Normal();

 private:
  static uint64_t RotateLeft(uint64_t x, int k) { return (x << k) | (x >> (64 - k)); }

  std::array<uint64_t, 4> state_;
};

// Returns the seed of an independent stream: the same for the same (seed, name, purpose) in any
// thread and order.
uint64_t StreamSeed(uint64_t seed, std::string_view name, std::string_view purpose);

}  // namespace raylift
