#include "raylift/localization/hloc_matches.h"

#include "support/matchers.h"
#include "support/room_scene.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/io/hloc.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/references.h"

namespace raylift {
namespace {

class HlocSource : public ::testing::Test {
 protected:
  std::unique_ptr<MatchSource> Open(int top_k, int every = 1) const {
    return OpenHlocMatches({scene_.features(), scene_.matches(), scene_.pairs()},
                           LoadReferences(scene_.model(), every).references, top_k);
  }
  Query QueryA() const { return {scene_.queries[0].name, scene_.queries[0].camera}; }

  RoomScene scene_ = WriteRoomScene(TestFolder());
};

TEST_F(HlocSource, TakesTheBestReferencesInTheirOrder) {
  WritePairs(scene_.pairs(),
             std::vector<std::pair<std::string, std::string>>{{"query/a.png", "ref/03.png"},
                                                              {"query/a.png", "ref/01.png"},
                                                              {"query/b.png", "ref/00.png"},
                                                              {"query/a.png", "ref/02.png"}});
  const QueryMatches two = Open(2)->Match(QueryA());
  ASSERT_EQ(two.references.size(), 2u);
  EXPECT_EQ(two.references[0].name, "ref/03.png");
  EXPECT_EQ(two.references[1].name, "ref/01.png");
  EXPECT_EQ(Open(10)->Match(QueryA()).references.size(), 3u);
}

TEST_F(HlocSource, ThinnedOutReferencesMakeRoomForTheNext) {
  const QueryMatches matches = Open(2, 2)->Match(QueryA());
  ASSERT_EQ(matches.references.size(), 2u);
  EXPECT_EQ(matches.references[0].name, "ref/00.png");
  EXPECT_EQ(matches.references[1].name, "ref/02.png");
}

TEST_F(HlocSource, MatchesAreOfTheSamePoints) {
  const MatchFile file(scene_.matches());
  const QueryMatches all = Open(10)->Match(QueryA());
  size_t expected = 0;
  for (const PosedImage& reference : scene_.references) {
    expected += file.Read("query/a.png", reference.name)->size();
  }
  EXPECT_EQ(all.matches.size(), expected);
  EXPECT_GT(expected, 300u);
  for (const Match2D2D& match : all.matches) {
    const PosedImage& reference = all.references.at(static_cast<size_t>(match.reference));
    EXPECT_TRUE(scene_.queries[0].camera.Contains(match.query_px));
    EXPECT_TRUE(reference.camera.Contains(match.reference_px));
  }
}

TEST_F(HlocSource, AQueryThatIsNotInThePairsHasNothing) {
  const QueryMatches matches = Open(10)->Match({"query/other.png", scene_.queries[0].camera});
  EXPECT_TRUE(matches.references.empty());
  EXPECT_TRUE(matches.matches.empty());
}

TEST_F(HlocSource, APairWithoutMatchesIsAWarningAndKeepsItsReference) {
  WriteMatchFile(scene_.matches(), std::vector<PairMatches>{
                                       {"query/a.png", "ref/01.png", 5, {{0, 2, 1}, {3, 1, 1}}}});
  const auto source = Open(2);
  const QueryMatches matches = source->Match(QueryA());
  EXPECT_EQ(matches.references.size(), 2u);
  ASSERT_EQ(matches.matches.size(), 2u);
  EXPECT_EQ(matches.matches[0].reference, 1);
  ASSERT_EQ(source->Warnings().size(), 1u);
  EXPECT_NE(source->Warnings()[0].find("query/a.png with ref/00.png"), std::string::npos);
}

TEST_F(HlocSource, AKeypointOutOfRangeNamesThePair) {
  WriteMatchFile(scene_.matches(),
                 std::vector<PairMatches>{{"query/a.png", "ref/00.png", 5, {{0, 30000, 1}}}});
  EXPECT_TRUE(
      FailsWithInputError([&] { Open(1)->Match(QueryA()); },
                          {scene_.matches().string(), "query/a.png", "ref/00.png", "30000"}));
}

TEST_F(HlocSource, ARetrievedReferenceWithoutAPoseNamesThePairsFile) {
  WriteFile(scene_.pairs(), "query/a.png ref/99.png\n");
  EXPECT_TRUE(FailsWithInputError([&] { Open(1); }, {scene_.pairs().string(), "query/a.png",
                                                     "ref/99.png", scene_.model().string()}));
}

TEST_F(HlocSource, FeaturesOfAnotherImageSizeAreAWarning) {
  const auto source = Open(1);
  source->Match({"query/a.png", scene_.queries[0].camera.Scaled(640, 480)});
  ASSERT_EQ(source->Warnings().size(), 1u);
  EXPECT_NE(source->Warnings()[0].find("query/a.png was 320 x 240"), std::string::npos);
}

}  // namespace
}  // namespace raylift
