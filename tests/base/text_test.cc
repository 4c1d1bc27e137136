#include "raylift/base/text.h"

#include <cmath>
#include <vector>

#include "support/matchers.h"
#include <gtest/gtest.h>

#include "raylift/base/error.h"

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

TEST(LineReader, AByteOrderMarkIsNoPartOfTheText) {
  LineReader reader("list.txt", "\xEF\xBB\xBF# head\na 1\n");
  EXPECT_EQ(reader.NextContent(), "a 1");
  EXPECT_EQ(reader.line_number(), 2);
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

namespace {

TEST(EditDistance, CountsChangedAddedLostAndSwappedLetters) {
  EXPECT_EQ(EditDistance("", ""), 0u);
  EXPECT_EQ(EditDistance("", "abc"), 3u);
  EXPECT_EQ(EditDistance("render", "render"), 0u);
  EXPECT_EQ(EditDistance("rendr", "render"), 1u);
  EXPECT_EQ(EditDistance("localise", "localize"), 1u);
  EXPECT_EQ(EditDistance("modle", "model"), 1u);
  EXPECT_EQ(EditDistance("ab", "ba"), 1u);
  EXPECT_EQ(EditDistance("kitten", "sitting"), 3u);
}

TEST(EditDistance, IsTheSameBothWays) {
  const std::vector<std::string> words = {"depth", "dpeth", "deep", "", "incidence", "indices"};
  for (const std::string& a : words) {
    for (const std::string& b : words) EXPECT_EQ(EditDistance(a, b), EditDistance(b, a));
  }
}

TEST(ClosestName, IsLikelyOrNone) {
  const std::vector<std::string> names = {"depth", "distance", "color", "mask"};
  EXPECT_EQ(ClosestName("colour", names), "color");
  EXPECT_EQ(ClosestName("dpeth", names), "depth");
  EXPECT_EQ(ClosestName("moon", names), std::nullopt);
  EXPECT_EQ(ClosestName("", names), std::nullopt);
  EXPECT_EQ(DidYouMean("colour", names), "; did you mean color?");
  EXPECT_EQ(DidYouMean("moon", names), "");
}

TEST(Base64, StandsForItsBytes) {
  EXPECT_EQ(DecodeBase64(""), "");
  EXPECT_EQ(DecodeBase64("YQ=="), "a");
  EXPECT_EQ(DecodeBase64("YWI="), "ab");
  const std::string bytes("abc\xFB\xFF\0", 6);
  EXPECT_EQ(DecodeBase64("YWJj+/8A"), bytes);
  for (size_t size = 0; size <= bytes.size(); ++size) {
    EXPECT_EQ(DecodeBase64(EncodeBase64(bytes.substr(0, size))), bytes.substr(0, size));
  }
  EXPECT_THROW(DecodeBase64("YQ=a"), InputError);
  EXPECT_THROW(DecodeBase64("YWJjZ"), InputError);
  EXPECT_THROW(DecodeBase64("YW Jj"), InputError);
}

}  // namespace

}  // namespace raylift
