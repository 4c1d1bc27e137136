#include "service/tokens.h"

#include "service/problem.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"

namespace raylift {
namespace {

int StatusOf(Tokens& tokens, std::string_view authorization, double second) {
  try {
    tokens.Admit(authorization, Tokens::Time(std::chrono::duration_cast<Tokens::Time::duration>(
                                    std::chrono::duration<double>(1000 + second))));
    return 200;
  } catch (const Problem& problem) {
    return problem.status();
  }
}

TEST(Tokens, OnlyKnownOnesAreAdmitted) {
  const auto file = TestFolder() / "tokens.txt";
  WriteFile(file, "# who\nabc\nabcdef\n");
  Tokens tokens(file);
  EXPECT_EQ(StatusOf(tokens, "Bearer abc", 0), 200);
  EXPECT_EQ(StatusOf(tokens, "bearer abcdef", 0), 200);
  for (const char* wrong : {"", "abc", "Bearer", "Bearer ", "Bearer ab", "Bearer abcabc",
                            "Bearer abcdeF", "Basic abc", "Bearer abc abc"}) {
    EXPECT_EQ(StatusOf(tokens, wrong, 0), 401) << wrong;
  }
}

TEST(Tokens, EachHasItsRequestsPerMinute) {
  const auto file = TestFolder() / "tokens.txt";
  WriteFile(file, "abc 2\n");
  Tokens tokens(file);
  EXPECT_EQ(StatusOf(tokens, "Bearer abc", 0), 200);
  EXPECT_EQ(StatusOf(tokens, "Bearer abc", 1), 200);
  EXPECT_EQ(StatusOf(tokens, "Bearer abc", 2), 429);
  EXPECT_EQ(StatusOf(tokens, "Bearer abc", 31), 200);
  EXPECT_EQ(StatusOf(tokens, "Bearer abc", 31), 429);
}

TEST(Tokens, MalformedFilesAreNamed) {
  const auto file = TestFolder() / "tokens.txt";
  for (const char* text : {"", "a x\n", "a 0\n", "a nan\n", "a 1 2\n"}) {
    WriteFile(file, text);
    EXPECT_TRUE(FailsWithInputError([&] { Tokens tokens(file); }, {"tokens.txt"})) << text;
  }
}

}  // namespace
}  // namespace raylift
