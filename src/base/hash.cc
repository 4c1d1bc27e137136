#include "base/hash.h"

#include <cerrno>
#include <memory>
#include <new>
#include <vector>

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

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

std::optional<std::string> FileHash(const std::filesystem::path& file) {
  constexpr size_t kPiece = size_t{1} << 18;
  std::vector<char> piece(kPiece);
  const std::unique_ptr<XXH3_state_t, decltype(&XXH3_freeState)> state(XXH3_createState(),
                                                                       &XXH3_freeState);
  if (state == nullptr) throw std::bad_alloc();
  const int descriptor = open(file.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) return std::nullopt;
  XXH3_64bits_reset(state.get());
  ssize_t count = 0;
  do {
    count = read(descriptor, piece.data(), piece.size());
    if (count > 0) XXH3_64bits_update(state.get(), piece.data(), static_cast<size_t>(count));
  } while (count > 0 || (count < 0 && errno == EINTR));
  close(descriptor);
  if (count < 0) return std::nullopt;
  return HexText(XXH3_64bits_digest(state.get()));
}

}  // namespace raylift
