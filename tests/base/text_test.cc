#include "raylift/base/text.h"

#include <cmath>

#include "support/matchers.h"

namespace raylift {
namespace {

TEST(Text, SplitsOnAnyBlank) {
  EXPECT_EQ(SplitTokens("  a\tbc  d "), (std::vector<std::string_view>{"a", "bc", "d"}));
  EXPECT_EQ(SplitBy("a, b,,c", ','), (std::vector<std::string_view>{"a", "b", "", "c"}));
}

TEST(Text, ParsesWholeTokensOnly) {
  EXPECT_EQ(ParseDouble("-1.5e3"), -1500.0);
  EXPECT_EQ(ParseDouble("+2"), 2.0);
  EXPECT_FALSE(ParseDouble("1.5x"));
  EXPECT_FALSE(ParseDouble(""));
  EXPECT_FALSE(ParseDouble("+-2"));
  EXPECT_FALSE(ParseInt("1.0"));
  EXPECT_FALSE(ParseUint("-1"));
  EXPECT_FALSE(ParseUint("99999999999999999999"));
}

TEST(Text, DoublesReadBackExactly) {
  Rng rng = TestRng();
  for (int i = 0; i < 1000; ++i) {
    const double value = rng.Normal() * std::pow(10.0, rng.Uniform(-30, 30));
    EXPECT_EQ(ParseDouble(FormatDouble(value)), value);
  }
}

TEST(LineReader, KnowsItsLineAndSkipsComments) {
  LineReader reader("list.txt", "# head\r\n\r\na 1\r\nb");
  EXPECT_EQ(reader.NextContent(), "a 1");
  EXPECT_EQ(reader.line_number(), 3);
  EXPECT_EQ(reader.NextContent(), "b");
  EXPECT_FALSE(reader.NextContent());
  EXPECT_TRUE(FailsWithInputError([&] { reader.Double("x1", "focal length"); },
                                  {"list.txt: line 4", "focal length", "\"x1\""}));
  EXPECT_TRUE(FailsWithInputError([&] { reader.Double("nan", "tx"); }, {"finite"}));
}

}  // namespace
}  // namespace raylift
