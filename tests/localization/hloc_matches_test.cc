#include "localization/matching/file_matches.h"
#include "support/match_file.h"
#include "support/matchers.h"
#include "support/room_scene.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/base/file.h"
#include "raylift/estimation/options.h"
#include "raylift/estimation/pose_estimator.h"
#include "raylift/io/hloc_files.h"
#include "raylift/io/pose_problem_json.h"
#include "raylift/lifting/consistency_filter.h"
#include "raylift/lifting/geometry_spec.h"
#include "raylift/lifting/lifter.h"
#include "raylift/localization/match_source.h"
#include "raylift/localization/scene.h"

namespace raylift {
namespace {

class HlocSource : public ::testing::Test {
 protected:
  std::unique_ptr<MatchSource> Open(int top_k, int every = 1) const {
    return OpenHlocMatches({scene_.features(), scene_.matches(), scene_.pairs()},
                           LoadReferences(scene_.model(), {.every = every}).references, top_k);
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

TEST_F(HlocSource, KeypointsAreTheFilesAndSeveralAtOnePlaceAreTheFirst) {
  const auto features = [](std::vector<Eigen::Vector2d> pixels) {
    Features f;
    f.image_width_px = 320;
    f.image_height_px = 240;
    f.keypoints_px = std::move(pixels);
    return f;
  };
  // As SIFT gives a keypoint once for each of its orientations.
  WriteFeatureFile(scene_.features(),
                   {{"query/a.png", features({{9.5, 8.5}, {20.5, 30.5}, {20.5, 30.5}, {4.5, 4.5}})},
                    {"ref/00.png", features({{7.5, 7.5}, {6.5, 6.5}, {7.5, 7.5}})},
                    {"ref/01.png", features({{7.5, 7.5}})}},
                   false);
  WriteMatchFile(scene_.matches(), std::vector<MatchedPair>{
                                       {"query/a.png", "ref/00.png", 4, {{1, 2, 1}, {2, 1, 1}}},
                                       {"query/a.png", "ref/01.png", 4, {{2, 0, 1}, {3, 0, 1}}}});
  const auto matches = Open(2)->Match(QueryA()).matches;
  ASSERT_EQ(matches.size(), 4u);
  const int query_keypoints[] = {1, 1, 1, 3};
  const int reference_keypoints[] = {0, 1, 0, 0};
  for (size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(matches[i].query_keypoint, query_keypoints[i]) << i;
    EXPECT_EQ(matches[i].reference_keypoint, reference_keypoints[i]) << i;
  }
}

TEST_F(HlocSource, KeypointsSurviveLiftingFilteringEstimatingAndWriting) {
  const Features features = FeatureFile(scene_.features()).Read("query/a.png");
  QueryMatches matches = Open(10)->Match(QueryA());
  PoseProblem problem;
  problem.query_camera = QueryA().camera;
  problem.references = std::move(matches.references);
  problem.matches_2d2d = std::move(matches.matches);
  // Matches that the geometry knows nothing of leave gaps among the lifted ones.
  for (size_t i = 0; i < problem.matches_2d2d.size(); i += 3) {
    problem.matches_2d2d[i].reference_px = {-1e4, -1e4};
  }
  const NamedGeometry mesh = MakeGeometrySource("mesh:" + scene_.mesh().string());
  problem.matches_2d3d =
      Matches2D3D(LiftMatches(*mesh.source, problem.references, problem.matches_2d2d));
  FilterProblem({.mode = FilterMode::kFixed, .thresholds = {.min_views = 2, .min_ratio = 0}},
                problem);
  const PoseEstimate estimate = MakePoseEstimator({.method = Method::kHloc})->Estimate(problem);
  ASSERT_TRUE(estimate.cam_from_world);
  EXPECT_TRUE(IsNearPose(*estimate.cam_from_world, scene_.queries[0].cam_from_world, 1e-3, 1e-4));
  EXPECT_LT(problem.matches_2d3d.size(), problem.matches_2d2d.size());
  ASSERT_GT(problem.matches_2d3d.size(), 100u);

  const PoseProblem read =
      ParsePoseProblem(FormatPoseProblem({problem, std::nullopt}), "p.json").problem;
  ASSERT_EQ(read.matches_2d3d.size(), problem.matches_2d3d.size());
  for (const Match2D2D& match : read.matches_2d2d) {
    EXPECT_EQ(features.keypoints_px.at(static_cast<size_t>(*match.query_keypoint)), match.query_px);
  }
  for (const Match2D3D& point : read.matches_2d3d) {
    const Match2D2D& match = read.matches_2d2d.at(point.match_2d2d.value());
    EXPECT_EQ(point.query_keypoint, match.query_keypoint);
    EXPECT_EQ(point.query_px, match.query_px);
    EXPECT_EQ(point.reference, match.reference);
  }
}

TEST_F(HlocSource, AQueryThatIsNotInThePairsHasNothing) {
  const QueryMatches matches = Open(10)->Match({"query/other.png", scene_.queries[0].camera});
  EXPECT_TRUE(matches.references.empty());
  EXPECT_TRUE(matches.matches.empty());
}

TEST_F(HlocSource, APairWithoutMatchesIsAWarningAndKeepsItsReference) {
  WriteMatchFile(scene_.matches(), std::vector<MatchedPair>{
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
                 std::vector<MatchedPair>{{"query/a.png", "ref/00.png", 5, {{0, 30000, 1}}}});
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
