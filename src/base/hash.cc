#include "raylift/base/hash.h"

#include <bit>
#include <cstring>
#include <vector>

#include <fmt/format.h>

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr size_t kChunk = size_t{1} << 20;

// Both odd, so that a multiplication loses nothing: 2^64 over the golden ratio, as in Knuth's
// multiplicative hashing, and the multiplier of degski's 64-bit mixer.
constexpr uint64_t kMultiplier = 0x9E3779B97F4A7C15ull;
constexpr uint64_t kFinisher = 0xD6E8FEB86659FD93ull;

// Multiplied before and after, so that no difference of few bits in a word is the same as one in
// the word before.
uint64_t Mix(uint64_t state, uint64_t word) {
  return std::rotl(state + word * kMultiplier, 31) * kFinisher;
}

}  // namespace

uint64_t HashBytes64(std::string_view bytes, uint64_t seed) {
  // Two states, as a multiplication takes longer than the memory does.
  uint64_t a = seed ^ bytes.size();
  uint64_t b = ~a;
  size_t i = 0;
  for (; i + 16 <= bytes.size(); i += 16) {
    uint64_t words[2];
    std::memcpy(words, bytes.data() + i, 16);
    a = Mix(a, words[0]);
    b = Mix(b, words[1]);
  }
  uint64_t rest[2] = {0, 0};
  // An empty view may have no data to point to.
  if (i < bytes.size()) std::memcpy(rest, bytes.data() + i, bytes.size() - i);
  // Each state is scrambled in its own way before they meet.
  const uint64_t last_a = Mix(a, rest[0]);
  const uint64_t last_b = Mix(b, rest[1]);
  uint64_t hash = Mix((last_a ^ (last_a >> 31)) * kFinisher, last_b);
  hash = (hash ^ (hash >> 32)) * kFinisher;
  hash = (hash ^ (hash >> 29)) * kMultiplier;
  return hash ^ (hash >> 32);
}

uint64_t HashLarge(std::string_view bytes, int threads) {
  std::vector<uint64_t> hashes((bytes.size() + kChunk - 1) / kChunk);
  ParallelFor(hashes.size(), threads,
              [&](size_t i) { hashes[i] = HashBytes64(bytes.substr(i * kChunk, kChunk), i); });
  return HashBytes64(AsBytes(std::span<const uint64_t>(hashes)), bytes.size());
}

std::string HexText(uint64_t hash) { return fmt::format("{:016x}", hash); }

}  // namespace raylift
