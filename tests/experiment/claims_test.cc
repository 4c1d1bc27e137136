#include "experiment/results.h"
#include "experiment/test_experiments.h"
#include "support/enum_names.h"
#include <gmock/gmock.h>

namespace raylift {
namespace {

// The first `within` of 40 queries are exact, the others have no pose.
SettingResult Result(const Setting& setting, int within) {
  SettingResult result;
  result.setting = setting;
  result.thresholds = {{0.1, 1}};
  Comparison& comparison = result.comparisons.emplace_back();
  for (int q = 0; q < 40; ++q) {
    comparison.queries.push_back({std::to_string(q), std::nullopt});
    if (q < within) comparison.queries.back().error = PoseError{0, 0};
  }
  return result;
}

std::vector<JudgedClaim> Judged(const std::string& claim,
                                const std::vector<SettingResult>& results) {
  const Experiment experiment =
      ReadText(kTwoScenes + "[[grid]]\nscene = \"room\"\n[[claim]]\ntext = \"t\"\n" + claim);
  return JudgeClaims(experiment, results);
}

const std::vector<SettingResult> kResults = {
    Result(RoomSetting(1, "mesh", Method::kP3p), 38),
    Result(RoomSetting(1, "noisy", Method::kP3p), 10),
    Result(RoomSetting(5, "mesh", Method::kP3p), 15),
    Result(RoomSetting(1, "", Method::kE5p1), 24),
    Result(RoomSetting(5, "", Method::kE5p1), 20),
    Result(RoomSetting(1, "mesh", Method::kAdaptive, ScoreCombination::kSumMsac), 38)};

TEST(Claims, ADifferenceOfManyQueriesIsShown) {
  const auto judged = Judged(
      "first = {method = \"p3p\"}\nsecond = {method = \"e5p1\"}\nwhere = {every = 1}\n", kResults);
  ASSERT_EQ(judged.size(), 1u);
  // Recall and AUC in two places: by the mesh and by noisy depth.
  ASSERT_EQ(judged[0].lines.size(), 4u);
  const ClaimLine& mesh = judged[0].lines[0];
  EXPECT_EQ(mesh.place, "The room, 1/1, mesh");
  EXPECT_EQ(mesh.first, "P3P");
  EXPECT_EQ(mesh.second, "E5+1");
  EXPECT_EQ(mesh.first_percent, 95);
  EXPECT_EQ(mesh.second_percent, 60);
  EXPECT_EQ(mesh.verdict, ClaimVerdict::kShown);
  EXPECT_EQ(judged[0].lines[2].verdict, ClaimVerdict::kContradicted);
}

TEST(Claims, TheBetterOfSeveralIsTaken) {
  const auto judged = Judged(
      "first = {method = \"adaptive\"}\nsecond = {method = [\"p3p\", \"e5p1\"]}\n"
      "where = {every = 1, geometry = \"mesh\"}\nrelation = \"not_worse\"\n",
      kResults);
  ASSERT_EQ(judged[0].lines.size(), 2u);
  EXPECT_EQ(judged[0].lines[0].second, "P3P");
  EXPECT_EQ(judged[0].lines[0].verdict, ClaimVerdict::kHolds);
}

TEST(Claims, NotWorseHoldsOnlyWhereTheQueriesCouldTell) {
  // One query of 40 is lost: two and a half points, with an interval that reaches far below.
  const auto judged = Judged(
      "first = {method = \"adaptive\"}\nsecond = {method = \"p3p\"}\n"
      "where = {every = 1, geometry = \"mesh\"}\nrelation = \"not_worse\"\n",
      {kResults[0],
       Result(RoomSetting(1, "mesh", Method::kAdaptive, ScoreCombination::kSumMsac), 37)});
  ASSERT_EQ(judged[0].lines.size(), 2u);
  EXPECT_EQ(judged[0].lines[0].verdict, ClaimVerdict::kNoise);
}

TEST(Claims, OneDifferenceAmongManyLinesIsNoise) {
  // Five queries of 40 more: p = 0.02 by itself, but not among 40 lines.
  const SettingResult first = Result(RoomSetting(1, "mesh", Method::kP3p), 20);
  const SettingResult second = Result(RoomSetting(1, "", Method::kE5p1), 15);
  const std::string claim =
      "first = {method = \"p3p\"}\nsecond = {method = \"e5p1\"}\nwhere = {every = 1}\n";
  EXPECT_EQ(Judged(claim, {first, second})[0].lines[0].verdict, ClaimVerdict::kShown);
  std::string many = claim;
  for (int i = 0; i < 19; ++i) many += "[[claim]]\ntext = \"t\"\n" + claim;
  EXPECT_EQ(Judged(many, {first, second})[0].lines[0].verdict, ClaimVerdict::kNoise);
}

TEST(Claims, ChangesAreCompared) {
  const auto judged = Judged(
      "first = {method = \"e5p1\"}\nsecond = {method = \"p3p\"}\n"
      "where = {geometry = \"mesh\"}\nfrom = {every = 1}\nto = {every = 5}\n",
      kResults);
  ASSERT_EQ(judged[0].lines.size(), 2u);
  EXPECT_NEAR(judged[0].lines[0].first_percent, -10, 1e-9);
  EXPECT_NEAR(judged[0].lines[0].second_percent, -57.5, 1e-9);
  EXPECT_EQ(judged[0].lines[0].verdict, ClaimVerdict::kShown);
}

TEST(Claims, FormsNameTheVerdict) {
  const auto judged = Judged(
      "first = {method = \"p3p\"}\nsecond = {method = \"e5p1\"}\nwhere = {every = 1}\n", kResults);
  EXPECT_THAT(FormatClaimsText(judged), ::testing::HasSubstr("shown 2, contradicted 2"));
  EXPECT_THAT(FormatClaimsCsv(judged),
              ::testing::HasSubstr("1,\"The room, 1/1, mesh\",P3P,E5+1,\"recall (0.1, 1deg)\",95.0,"
                                   "60.0,+35.0,"));
  EXPECT_THAT(FormatClaimsMarkdown(judged), ::testing::HasSubstr("**1. t** shown 2"));
  std::vector<JudgedClaim> hostile = judged;
  hostile.front().text = "t**\n# <b>";
  EXPECT_THAT(FormatClaimsMarkdown(hostile),
              ::testing::HasSubstr(R"(**1. t\*\* \# \<b\>** shown 2)"));
}

TEST(Claims, TheirValuesHaveNames) {
  EXPECT_TRUE(NamesEveryValue<ClaimVerdict>());
  EXPECT_TRUE(NamesEveryValue<Claim::Relation>());
}

}  // namespace
}  // namespace raylift
