#include "localization/rerender.h"

#include "localization/matching/file_matches.h"
#include "support/matchers.h"
#include "support/room_scene.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/io/image_file.h"
#include "raylift/lifting/geometry_spec.h"

namespace raylift {
namespace {

TEST(PoseSupport, TakesTheBestMatchOfEachKeypoint) {
  const double params[] = {100, 100, 50, 50};
  const Camera camera(CameraModel::kPinhole, 100, 100, params);
  const auto match = [](double x, double error_px) {
    // At depth 1 the point (x / 100, 0) is at the pixel (50 + x, 50).
    return Match2D3D{{50 + x + error_px, 50}, {x / 100, 0, 1}, std::nullopt, std::nullopt};
  };
  const std::vector<Match2D3D> matches = {
      match(0, 2),                                           // 1 - (2 / 4)^2
      {{52, 50}, {0.03, 0, 1}, std::nullopt, std::nullopt},  // the same keypoint, off by 1
      match(10, 4),                                          // at the threshold
      {{20, 20}, {0, 0, -1}, std::nullopt, std::nullopt},    // behind the camera
      match(20, 0)};
  EXPECT_NEAR(KeypointSupport(camera, Rigid3(), matches, 4), (1 - 1 / 16.0) + 1, 1e-12);
  EXPECT_EQ(KeypointSupport(camera, Rigid3(), {}, 4), 0);
}

TEST(PoseSupport, IndicesSayWhichMatchesAreOfOneKeypoint) {
  const double params[] = {100, 100, 50, 50};
  const Camera camera(CameraModel::kPinhole, 100, 100, params);
  const auto match = [](double x, double error_px, int keypoint) {
    return Match2D3D{.query_px = {50 + x + error_px, 50},
                     .point_in_world = {x / 100, 0, 1},
                     .reference = {},
                     .point_sigma = {},
                     .query_keypoint = keypoint};
  };
  const std::vector<Match2D3D> one = {match(0, 2, 7), match(1, 1, 7)};
  const std::vector<Match2D3D> two = {match(0, 2, 7), match(1, 1, 8)};
  EXPECT_NEAR(KeypointSupport(camera, Rigid3(), one, 4), 1 - 1 / 16.0, 1e-12);
  EXPECT_NEAR(KeypointSupport(camera, Rigid3(), two, 4), 2 - 1 / 16.0 - 4 / 16.0, 1e-12);
}

// The same pose for every problem.
class GivenPose final : public PoseEstimator {
 public:
  explicit GivenPose(std::optional<Rigid3> pose) : pose_(std::move(pose)) {}
  PoseEstimate Estimate(const PoseProblem& problem) const override {
    PoseEstimate estimate;
    estimate.cam_from_world = pose_;
    if (!pose_) estimate.failure = FailureReason::kNoConsistentSample;
    estimate.inliers_2d3d.assign(problem.matches_2d3d.size(), pose_.has_value());
    estimate.inliers_2d2d.assign(problem.matches_2d2d.size(), pose_.has_value());
    return estimate;
  }

 private:
  std::optional<Rigid3> pose_;
};

Rigid3 MovedBy(const Rigid3& cam_from_world, const Eigen::Vector3d& in_cam) {
  return {cam_from_world.rotation, cam_from_world.translation + in_cam};
}

class Rerender : public ::testing::Test {
 protected:
  Query query() const { return {scene_.queries[0].name, scene_.queries[0].camera}; }
  const Rigid3& truth() const { return scene_.queries[0].cam_from_world; }

  // As if the query had been localized at this pose, with hloc's matches or without any.
  QueryResult LocalizedAt(const std::optional<Rigid3>& pose, bool with_matches) const {
    QueryResult result;
    result.problem.name = result.localized.name = query().name;
    result.problem.query_camera = query().camera;
    if (with_matches) {
      const auto source = OpenHlocMatches({scene_.features(), scene_.matches(), scene_.pairs()},
                                          LoadReferences(scene_.model()).references, 2);
      QueryMatches matches = source->Match(query());
      result.problem.references = std::move(matches.references);
      result.problem.reference_clusters = {0, 0};
      result.problem.matches_2d2d = std::move(matches.matches);
      result.problem.matches_2d3d = Matches2D3D(
          LiftMatches(*mesh_.source, result.problem.references, result.problem.matches_2d2d));
    }
    result.localized.estimate = GivenPose(pose).Estimate(result.problem);
    if (!pose) result.localized.reason = ReasonNotLocalized(result.localized.estimate);
    return result;
  }

  Rerenderer Make(const RerenderOptions& options = {}) const {
    ColorOptions look;
    look.samples_per_pixel_side = 2;
    return {mesh_.mesh, look, scene_.images(), options};
  }

  RoomScene scene_ = WriteRoomScene(TestFolder(), {.matches = true, .pictures = true});
  NamedGeometry mesh_ = MakeGeometrySource("mesh:" + scene_.mesh().string());
};

TEST_F(Rerender, SharpensARoughPoseFromTheMeshAlone) {
  QueryResult result = LocalizedAt(MovedBy(truth(), {0.06, -0.04, 0.08}), false);
  Make({.rounds = 2}).Improve(query(), *MakePoseEstimator({}), result);
  EXPECT_GE(result.localized.rerender_rounds, 1);
  EXPECT_TRUE(IsNearPose(*result.localized.estimate.cam_from_world, truth(), 0.1, 0.005));
  EXPECT_GT(result.localized.counts.inliers_2d3d, 100u);
  EXPECT_EQ(result.localized.counts.points, result.problem.matches_2d3d.size());
  EXPECT_EQ(result.localized.estimate.inliers_2d3d.size(), result.problem.matches_2d3d.size());
}

TEST_F(Rerender, SharpensByPatchesWhereFeaturesAreFew) {
  QueryResult result = LocalizedAt(MovedBy(truth(), {0.02, -0.01, 0.02}), false);
  Make({.max_features = 60}).Improve(query(), *MakePoseEstimator({}), result);
  EXPECT_EQ(result.localized.rerender_rounds, 1);
  EXPECT_EQ(result.problem.references.back().name, "rerender/1/patches");
  EXPECT_GT(result.localized.counts.inliers_2d3d, 100u);
  EXPECT_TRUE(IsNearPose(*result.localized.estimate.cam_from_world, truth(), 0.1, 0.003));
}

// One pose for problems with patches, another for those without.
class ByPatches final : public PoseEstimator {
 public:
  struct Answer {
    Rigid3 cam_from_world;
    double confidence = 0;
    PoseVerdict verdict = PoseVerdict::kLocalized;
  };
  ByPatches(const Answer& without, const Answer& with) : without_(without), with_(with) {}
  PoseEstimate Estimate(const PoseProblem& problem) const override {
    const bool has_patches = problem.references.back().name.ends_with("patches");
    const Answer& answer = has_patches ? with_ : without_;
    PoseEstimate estimate = GivenPose(answer.cam_from_world).Estimate(problem);
    estimate.confidence = answer.confidence;
    estimate.verdict = answer.verdict;
    return estimate;
  }

 private:
  Answer without_;
  Answer with_;
};

TEST_F(Rerender, PatchesDoNotMakeAPoseSurer) {
  QueryResult result = LocalizedAt(MovedBy(truth(), {0.02, 0, 0}), false);
  Make().Improve(query(), ByPatches({truth(), 0.5, PoseVerdict::kDoubtful}, {truth(), 1}), result);
  ASSERT_EQ(result.localized.rerender_rounds, 1);
  EXPECT_EQ(result.problem.references.back().name, "rerender/1/patches");
  EXPECT_EQ(result.localized.estimate.confidence, 0.5);
  EXPECT_EQ(result.localized.estimate.verdict, PoseVerdict::kDoubtful);
}

TEST_F(Rerender, PatchesAreNoSurerThanThePoseThatTheyWereFoundFrom) {
  // The features' new pose is surer and worse: patches are found from the one before.
  QueryResult result = LocalizedAt(MovedBy(truth(), {0.02, 0, 0}), false);
  result.localized.estimate.confidence = 0.5;
  result.localized.estimate.verdict = PoseVerdict::kDoubtful;
  Make().Improve(
      query(),
      ByPatches({MovedBy(truth(), {0.1, 0, 0}), 0.9, PoseVerdict::kDoubtful}, {truth(), 1}),
      result);
  ASSERT_EQ(result.localized.rerender_rounds, 1);
  EXPECT_EQ(result.localized.estimate.confidence, 0.5);
  EXPECT_EQ(result.localized.estimate.verdict, PoseVerdict::kDoubtful);
}

TEST_F(Rerender, PatchesThatSupportTheirPoseLessAreLeftOut) {
  QueryResult result = LocalizedAt(MovedBy(truth(), {0.02, 0, 0}), false);
  Make().Improve(query(), ByPatches({truth(), 1}, {MovedBy(truth(), {0.01, 0, 0}), 1}), result);
  ASSERT_EQ(result.localized.rerender_rounds, 1);
  EXPECT_NE(result.problem.references.back().name, "rerender/1/patches");
  EXPECT_TRUE(IsNearPose(*result.localized.estimate.cam_from_world, truth(), 1e-9, 1e-9));
}

TEST_F(Rerender, PatchesThatMakeASurePoseDoubtfulAreLeftOut) {
  QueryResult result = LocalizedAt(MovedBy(truth(), {0.02, 0, 0}), false);
  Make().Improve(query(), ByPatches({truth(), 1}, {truth(), 0.5, PoseVerdict::kDoubtful}), result);
  ASSERT_EQ(result.localized.rerender_rounds, 1);
  EXPECT_NE(result.problem.references.back().name, "rerender/1/patches");
  EXPECT_EQ(result.localized.estimate.verdict, PoseVerdict::kLocalized);
}

TEST_F(Rerender, KeepsTheMatchesOfTheReferences) {
  QueryResult result = LocalizedAt(MovedBy(truth(), {0.05, 0, 0}), true);
  const PoseProblem before = result.problem;
  Make().Improve(query(), GivenPose(truth()), result);
  EXPECT_EQ(result.localized.rerender_rounds, 1);
  ASSERT_EQ(result.problem.references.size(), before.references.size() + 6);
  EXPECT_EQ(result.problem.references[0].name, before.references[0].name);
  EXPECT_EQ(result.problem.references[2].name, "rerender/1/0");
  EXPECT_EQ(result.problem.reference_clusters, (std::vector<int>{0, 0, 1, 1, 1, 1, 1, 2}));
  EXPECT_EQ(result.problem.matches_2d2d.size(), before.matches_2d2d.size());
  EXPECT_GT(result.problem.matches_2d3d.size(), before.matches_2d3d.size());
  for (size_t i = before.matches_2d3d.size(); i < result.problem.matches_2d3d.size(); ++i) {
    EXPECT_GE(result.problem.matches_2d3d[i].reference, 2);
  }
}

TEST_F(Rerender, GivesPairsToEstimatorsThatNeedThem) {
  QueryResult result = LocalizedAt(MovedBy(truth(), {0.05, 0, 0}), false);
  Make({.around_deg = 0, .use_pairs = true}).Improve(query(), GivenPose(truth()), result);
  EXPECT_GT(result.problem.matches_2d2d.size(), 30u);
  EXPECT_EQ(result.problem.matches_2d2d.size(), result.problem.matches_2d3d.size());
}

TEST_F(Rerender, KeypointsOfTheSamePlaceKeepTheIndexThatTheyHave) {
  QueryResult alone = LocalizedAt(MovedBy(truth(), {0.05, 0, 0}), false);
  Make({.around_deg = 0}).Improve(query(), GivenPose(truth()), alone);
  ASSERT_GT(alone.problem.matches_2d3d.size(), 30u);
  // One of the keypoints is known from features with other indices, and so is another place.
  const Eigen::Vector2d known = alone.problem.matches_2d3d[10].query_px;
  QueryResult result = LocalizedAt(MovedBy(truth(), {0.05, 0, 0}), false);
  result.problem.references = {scene_.references[0]};
  result.problem.matches_2d2d = {
      {.reference = 0, .query_px = known, .reference_px = {9, 9}, .query_keypoint = 5000},
      {.reference = 0, .query_px = {-3, -3}, .reference_px = {9, 9}, .query_keypoint = 6000}};
  Make({.around_deg = 0, .use_pairs = true}).Improve(query(), GivenPose(truth()), result);
  ASSERT_EQ(result.localized.rerender_rounds, 1);
  const auto& pairs = result.problem.matches_2d2d;
  EXPECT_EQ(pairs[0].query_keypoint, 5000);
  EXPECT_EQ(pairs[1].query_keypoint, 6000);
  size_t num_known = 0;
  for (const Match2D3D& point : result.problem.matches_2d3d) {
    ASSERT_TRUE(point.query_keypoint && point.match_2d2d);
    const bool is_known = point.query_px == known;
    num_known += is_known ? 1 : 0;
    EXPECT_EQ(*point.query_keypoint == 5000, is_known);
    EXPECT_TRUE(is_known || *point.query_keypoint > 6000);
    const Match2D2D& pair = pairs.at(*point.match_2d2d);
    EXPECT_EQ(pair.query_keypoint, point.query_keypoint);
    EXPECT_EQ(pair.query_px, point.query_px);
    EXPECT_EQ(pair.reference, point.reference);
  }
  EXPECT_GT(num_known, 0u);
}

TEST_F(Rerender, LooksForMatchesNearWhereThePoseSaysOnly) {
  // Off by far more than the radius: nothing is found, and the pose stays.
  QueryResult result = LocalizedAt(MovedBy(truth(), {0.1, 0, 0}), false);
  Make({.around_deg = 0, .search_radius = 0.001}).Improve(query(), GivenPose(truth()), result);
  EXPECT_EQ(result.localized.rerender_rounds, 0);
}

TEST_F(Rerender, KeepsThePoseUnlessMatchesSupportTheNewOneBetter) {
  for (const std::optional<Rigid3>& other : {std::optional(MovedBy(truth(), {0.1, 0, 0})),
                                             std::optional(truth()), std::optional<Rigid3>()}) {
    QueryResult result = LocalizedAt(truth(), true);
    const size_t references = result.problem.references.size();
    Make({.rounds = 3, .around_deg = 0}).Improve(query(), GivenPose(other), result);
    EXPECT_EQ(result.localized.rerender_rounds, 0);
    EXPECT_TRUE(IsNearPose(*result.localized.estimate.cam_from_world, truth(), 1e-9, 1e-9));
    EXPECT_EQ(result.problem.references.size(), references);
  }
}

TEST_F(Rerender, LeavesAQueryThatIsNotLocalized) {
  QueryResult result = LocalizedAt(std::nullopt, false);
  Make().Improve({"no photograph.png", query().camera}, GivenPose(truth()), result);
  EXPECT_FALSE(result.localized.localized());
  EXPECT_EQ(result.localized.rerender_rounds, 0);
}

TEST_F(Rerender, SaysWhereThePhotographIsNotItsCameras) {
  QueryResult result = LocalizedAt(truth(), false);
  const Query other{query().name, query().camera.Scaled(160, 120)};
  EXPECT_TRUE(FailsWithInputError([&] { Make().Improve(other, GivenPose(truth()), result); },
                                  {query().name, "320 x 240", "160 x 120"}));
}

}  // namespace
}  // namespace raylift
