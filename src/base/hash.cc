#include "raylift/base/hash.h"

#include <vector>

#include <fmt/format.h>
#define XXH_INLINE_ALL  // used as a header alone
#include <xxhash.h>

#include "raylift/base/parallel.h"

namespace raylift {
namespace {

constexpr size_t kChunk = size_t{1} << 20;

}  // namespace

uint64_t HashBytes64(std::string_view bytes, uint64_t seed) {
  return XXH3_64bits_withSeed(bytes.data(), bytes.size(), seed);
}

uint64_t HashLarge(std::string_view bytes, int threads) {
  std::vector<uint64_t> hashes((bytes.size() + kChunk - 1) / kChunk);
  ParallelFor(hashes.size(), threads,
              [&](size_t i) { hashes[i] = HashBytes64(bytes.substr(i * kChunk, kChunk), i); });
  return HashBytes64(AsBytes(std::span<const uint64_t>(hashes)), bytes.size());
}

std::string HexText(uint64_t hash) { return fmt::format("{:016x}", hash); }

}  // namespace raylift
