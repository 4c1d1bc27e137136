#include "base/index_sets.h"

#include <gtest/gtest.h>

namespace raylift {
namespace {

using Indices = std::vector<size_t>;

TEST(EvenlySpaced, KeepsAllWhereTheyAreFew) {
  EXPECT_EQ(EvenlySpaced(3, 3), (Indices{0, 1, 2}));
  EXPECT_EQ(EvenlySpaced(3, 100), (Indices{0, 1, 2}));
  EXPECT_EQ(EvenlySpaced(0, 4), Indices{});
  EXPECT_EQ(EvenlySpaced(4, 0), Indices{});
}

TEST(EvenlySpaced, BeginsWithTheFirst) {
  EXPECT_EQ(EvenlySpaced(9, 1), Indices{0});
  EXPECT_EQ(EvenlySpaced(9, 3), (Indices{0, 3, 6}));
}

TEST(EvenlySpaced, LeavesEqualGapsButForRounding) {
  for (size_t count = 1; count < 40; ++count) {
    for (size_t most = 1; most <= count; ++most) {
      Indices chosen = EvenlySpaced(count, most);
      ASSERT_EQ(chosen.size(), most);
      chosen.push_back(count);
      for (size_t i = 0; i < most; ++i) {
        const size_t gap = chosen[i + 1] - chosen[i];
        EXPECT_GE(gap, count / most);
        EXPECT_LE(gap, (count + most - 1) / most);
      }
    }
  }
}

TEST(DisjointSets, TheLargestIsTheFirstOfEquals) {
  DisjointSets sets(6);
  sets.Join(0, 3);
  sets.Join(2, 5);
  EXPECT_EQ(sets.InLargest(), std::vector<bool>({true, false, false, true, false, false}));
  sets.Join(1, 2);
  EXPECT_EQ(sets.InLargest(), std::vector<bool>({false, true, true, false, false, true}));
  EXPECT_TRUE(DisjointSets(0).InLargest().empty());
}

}  // namespace
}  // namespace raylift
