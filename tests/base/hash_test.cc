#include "base/hash.h"

#include <set>

#include "support/matchers.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

TEST(Hash, EveryBitAndTheLengthCount) {
  Rng rng = TestRng();
  std::string bytes(77, '\0');
  for (char& byte : bytes) byte = static_cast<char>(rng.UniformIndex(256));
  std::set<uint64_t> hashes = {HashBytes64(bytes), HashBytes64(bytes, 1),
                               HashBytes64(bytes + '\0')};
  for (size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
    std::string other = bytes;
    other[bit / 8] = static_cast<char>(other[bit / 8] ^ (1 << bit % 8));
    hashes.insert(HashBytes64(other));
  }
  EXPECT_EQ(hashes.size(), 3 + 8 * bytes.size());
  EXPECT_NE(HashBytes64(""), HashBytes64(std::string(1, '\0')));
  EXPECT_EQ(HashBytes64(std::string_view()), HashBytes64(""));
}

// Files of earlier runs are recognized by it; the values are those of libxxhash.
TEST(Hash, IsTheSameOnEveryMachine) {
  EXPECT_EQ(HashBytes64(""), 0x2d06800538d394c2ull);
  EXPECT_EQ(HashBytes64("raylift"), 0x0746160c46e02169ull);
}

TEST(Hash, ThreadsDoNotChangeIt) {
  const std::string bytes(3'000'001, 'x');
  EXPECT_EQ(HashLarge(bytes, 1), HashLarge(bytes, 4));
  EXPECT_NE(HashLarge(bytes, 1), HashLarge(bytes.substr(1), 1));
}

TEST(Hash, TextIsOfOneLength) {
  EXPECT_EQ(HexText(0), "0000000000000000");
  EXPECT_EQ(HexText(0xabcull), "0000000000000abc");
}

}  // namespace
}  // namespace raylift
