// Match files against h5py, and pairs lists.
#include "io/h5py.h"
#include "support/match_file.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gmock/gmock.h>

#include "raylift/base/file.h"
#include "raylift/io/hloc_files.h"

namespace raylift {
namespace {

using Matches = std::vector<FeatureMatch>;

class HlocMatches : public testing::Test {
 protected:
  void SetUp() override {
    if (!HasProgram("/usr/bin/python3")) GTEST_SKIP() << "python3 is not installed";
    path_ = TestFolder() / "matches.h5";
  }
  std::filesystem::path path_;
};

TEST_F(HlocMatches, PairsAreFoundEitherWayRoundInBothNamings) {
  RunH5py(path_, "w", R"(
def pair(name, matches, dtype, scores=None):
    g = f.create_group(name)
    g.create_dataset('matches0', data=np.array(matches, dtype))
    if scores is not None:
        g.create_dataset('matching_scores0', data=np.array(scores, np.float16))
pair('q-a.jpg/r-b.jpg', [2, -1, 0], np.int16, [0.5, 0, 0.25])
pair('q-c.jpg_r-d.jpg', [-1, 7], np.int32)
)");
  const MatchFile file(path_);
  EXPECT_EQ(file.Read("q/a.jpg", "r/b.jpg"), (Matches{{0, 2, 0.5f}, {2, 0, 0.25f}}));
  EXPECT_EQ(file.Read("r/b.jpg", "q/a.jpg"), (Matches{{2, 0, 0.5f}, {0, 2, 0.25f}}));
  EXPECT_EQ(file.Read("q/c.jpg", "r/d.jpg"), (Matches{{1, 7, 1.0f}}));
  EXPECT_EQ(file.Read("r/d.jpg", "q/c.jpg"), (Matches{{7, 1, 1.0f}}));
  EXPECT_FALSE(file.Read("q/a.jpg", "r/d.jpg"));
}

TEST_F(HlocMatches, TheNewNamingAndTheAskedDirectionWin) {
  RunH5py(path_, "w", R"(
for i, name in enumerate(['b_a', 'a_b', 'b/a', 'a/b']):
    f.create_dataset(name + '/matches0', data=np.array([i]))
)");
  const MatchFile file(path_);
  EXPECT_EQ(file.Read("a", "b"), (Matches{{0, 3, 1}}));
  EXPECT_EQ(file.Read("b", "a"), (Matches{{0, 2, 1}}));
}

TEST_F(HlocMatches, SemiDenseFilesMayHoldNoMatches) {
  RunH5py(path_, "w", R"(
g = f.create_group('a/b')
g.create_dataset('matches0', data=np.zeros(0, np.int32))
g.create_dataset('matching_scores0', data=np.zeros(0, np.float16))
g.create_dataset('keypoints0', data=np.zeros((0, 2)))
)");
  EXPECT_EQ(MatchFile(path_).Read("a", "b"), Matches{});
}

TEST_F(HlocMatches, WrongContentsAreNamed) {
  RunH5py(path_, "w", R"(
f.create_dataset('a/b/matches0', data=np.array([0, -7], np.int16))
f.create_dataset('a/c/matches0', data=np.array([0.5]))
f.create_dataset('a/d/matches0', data=np.zeros((2, 2), int))
f.create_dataset('a/e/matches0', data=np.zeros(2, int))
f.create_dataset('a/e/matching_scores0', data=np.zeros(3, np.float16))
f.create_dataset('a/f/matches0', data=np.zeros(1, int))
f.create_dataset('a/f/matching_scores0', data=np.full(1, np.nan, np.float16))
f.create_dataset('a/g/matches0', data=np.array([1 << 40]))
f.create_group('a/h')
)");
  const MatchFile file(path_);
  const auto expect_failure = [&](const std::string& reference,
                                  const std::vector<std::string>& parts) {
    EXPECT_TRUE(FailsWithInputError([&] { file.Read("a", reference); }, parts)) << reference;
  };
  expect_failure("b", {"matches.h5: a/b/matches0: expected an index or -1, found -7"});
  expect_failure("c", {"a/c/matches0: expected integers"});
  expect_failure("d", {"a/d/matches0: expected a vector, found 2 dimensions"});
  expect_failure("e", {"a/e/matching_scores0: expected 2 numbers as in matches0, found 3"});
  expect_failure("f", {"a/f/matching_scores0: expected finite numbers, found nan"});
  expect_failure("g", {"a/g/matches0: expected an index or -1, found 1099511627776"});
  expect_failure("h", {"a/h/matches0: is not in the file"});
}

TEST_F(HlocMatches, WrittenFilesReadBackAndHaveHlocsLayout) {
  const std::vector<MatchedPair> pairs = {
      {"q/a.jpg", "r/b.jpg", 4, {{3, 32767, 0.5f}, {1, 0, 0.25f}}},
      {"q/a.jpg", "r/c.jpg", 2, {{0, 32768, 1.0f}}},
      {"q/d.jpg", "r/b.jpg", 0, {}},
  };
  WriteMatchFile(path_, pairs);
  const MatchFile file(path_);
  EXPECT_EQ(file.Read("q/a.jpg", "r/b.jpg"), (Matches{{1, 0, 0.25f}, {3, 32767, 0.5f}}));
  EXPECT_EQ(file.Read("r/c.jpg", "q/a.jpg"), (Matches{{32768, 0, 1.0f}}));
  EXPECT_EQ(file.Read("q/d.jpg", "r/b.jpg"), Matches{});
  EXPECT_EQ(RunH5py(path_, "r", R"(
g = f['q-a.jpg']['r-b.jpg']
for name in sorted(g): print(name, g[name].dtype, g[name][:].tolist())
print(f['q-a.jpg/r-c.jpg/matches0'].dtype)
)"),
            "matches0 int16 [-1, 0, -1, 32767]\n"
            "matching_scores0 float16 [0.0, 0.25, 0.0, 0.5]\n"
            "int32\n");
}

TEST_F(HlocMatches, RealFilesAreRead) {
  const auto data = FindTestData("rgbd_small");
  if (!data) GTEST_SKIP() << "rgbd_small is not on this machine";
  const MatchFile file(*data / "matches.h5");
  const FeatureFile features(*data / "features.h5");
  size_t num_pairs = 0;
  for (const auto& [query, references] : ReadPairs(*data / "pairs.txt")) {
    const int num_query = static_cast<int>(features.Read(query).keypoints_px.size());
    for (const std::string& reference : references) {
      const auto matches = file.Read(query, reference);
      ASSERT_TRUE(matches) << query << " " << reference;
      for (const FeatureMatch& match : *matches) {
        ASSERT_LT(match.query_index, num_query);
      }
      ++num_pairs;
    }
  }
  EXPECT_GT(num_pairs, 50u);
}

TEST(HlocPairs, AllFormsOfTheFieldAreRead) {
  const auto path = TestFolder() / "pairs.txt";
  WriteFile(path,
            "# comment\n\nq/a.jpg r/b.jpg\r\nq/a.jpg   r/c.jpg  \n"
            "q/e.jpg, r/b.jpg, 0.75\nq/e.jpg,r/c.jpg\nwith blank.jpg, other.jpg\n"
            "a,b.jpg c.jpg\nq/a.jpg r/a.jpg 0.5\nq/a.jpg r/b.jpg");
  EXPECT_THAT(ReadPairs(path),
              testing::ElementsAre(
                  testing::Pair("a,b.jpg", testing::ElementsAre("c.jpg")),
                  testing::Pair("q/a.jpg", testing::ElementsAre("r/b.jpg", "r/c.jpg", "r/a.jpg")),
                  testing::Pair("q/e.jpg", testing::ElementsAre("r/b.jpg", "r/c.jpg")),
                  testing::Pair("with blank.jpg", testing::ElementsAre("other.jpg"))));
}

TEST(HlocPairs, WrongLinesAreNamed) {
  const auto path = TestFolder() / "pairs.txt";
  const auto expect_failure = [&](const std::string& text, const std::vector<std::string>& parts) {
    WriteFile(path, text);
    EXPECT_TRUE(FailsWithInputError([&] { ReadPairs(path); }, parts)) << text;
  };
  expect_failure("a b\nc\n", {"pairs.txt: line 2: expected \"query reference\"", "found \"c\""});
  expect_failure("a, \n", {"pairs.txt: line 1: expected"});
  expect_failure("a, b, x\n", {"pairs.txt: line 1: score: expected a number, found \"x\""});
  expect_failure("a b nan\n", {"pairs.txt: line 1: score: expected a finite number"});
  expect_failure("a b 1 2\n", {"pairs.txt: line 1: expected"});
}

TEST(HlocPairs, WrittenListsReadBack) {
  const auto path = TestFolder() / "pairs.txt";
  const std::vector<std::pair<std::string, std::string>> pairs = {
      {"q", "c"}, {"q", "a"}, {"p", "b"}};
  WritePairs(path, pairs);
  EXPECT_EQ(ReadFile(path), "q c\nq a\np b\n");
  EXPECT_THAT(ReadPairs(path).at("q"), testing::ElementsAre("c", "a"));
  const std::vector<std::pair<std::string, std::string>> blank = {{"q q", "c"}};
  WritePairs(path, blank);
  EXPECT_THAT(ReadPairs(path).at("q q"), testing::ElementsAre("c"));
  const std::vector<std::pair<std::string, std::string>> comma = {{"q, q", "c"}};
  EXPECT_TRUE(FailsWithInputError([&] { WritePairs(path, comma); },
                                  {"pairs.txt: the file cannot hold the name \"q, q\""}));
}

}  // namespace
}  // namespace raylift
