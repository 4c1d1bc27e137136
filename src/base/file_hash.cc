#include "raylift/base/file_hash.h"

#include <cerrno>
#include <memory>
#include <new>
#include <vector>

#include <fcntl.h>
#include <unistd.h>
#define XXH_INLINE_ALL  // used as a header alone
#include <xxhash.h>

#include "raylift/base/hash.h"

namespace raylift {

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
