#include "raylift/lifting/consistency_filter.h"

#include <cmath>

#include "lifting/reference_matches.h"
#include "support/enum_names.h"
#include "support/matchers.h"
#include "support/meshes.h"
#include <gtest/gtest.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

// Five cameras side by side look along z; a point at depth 10 moves by 10 px per unit of
// depth_error and meter of baseline, give or take the change of depth.
struct Scene {
  std::vector<PosedImage> references;
  std::vector<Match2D2D> matches;
  std::vector<Match2D3D> points;

  Scene() {
    const double params[] = {1000, 1000, 320, 240};
    const Camera camera(CameraModel::kPinhole, 640, 480, params);
    for (int i = 0; i < 5; ++i) {
      const Rigid3 pose{Eigen::Quaterniond::Identity(), Eigen::Vector3d(-i, 0, 0)};
      references.push_back({"r" + std::to_string(i), camera, pose});
    }
  }

  Eigen::Vector2d Project(int reference, const Eigen::Vector3d& point) const {
    const PosedImage& image = references[static_cast<size_t>(reference)];
    return image.camera.ImgFromCam(image.cam_from_world * point).value();
  }

  void Match(int reference, const Eigen::Vector2d& query_px, const Eigen::Vector2d& reference_px) {
    matches.push_back({reference, query_px, reference_px});
  }

  // Observed where it is in these references, each off by `error_px` along x.
  void Observe(const Eigen::Vector2d& query_px, const Eigen::Vector3d& point,
               const std::vector<std::pair<int, double>>& error_px) {
    for (const auto& [reference, error] : error_px) {
      Match(reference, query_px, Project(reference, point) + Eigen::Vector2d(error, 0));
    }
  }

  void Lift(const Eigen::Vector2d& query_px, const Eigen::Vector3d& point, int reference) {
    points.push_back({query_px, point, reference, std::nullopt});
  }

  FilterResult Filter(const ConsistencyThresholds& thresholds) const {
    return FilterPoints(references, matches, points,
                        {.mode = FilterMode::kFixed, .thresholds = thresholds});
  }
};

using Kept = std::vector<bool>;

TEST(FixedFilter, CountsTheViewsInWhichAPointLandsClose) {
  Scene scene;
  const Eigen::Vector2d query_px(7.5, 9.25);
  const Eigen::Vector3d point(2, 0.5, 10);
  scene.Observe(query_px, point, {{0, 0}, {1, 3.9}, {2, 4.1}, {3, -3.9}, {4, 50}});
  scene.Lift(query_px, point, 0);
  EXPECT_EQ(scene.Filter({4, 3, 0}).keep, Kept{true});
  EXPECT_EQ(scene.Filter({4, 4, 0}).keep, Kept{false});
  EXPECT_EQ(scene.Filter({4.2, 4, 0}).keep, Kept{true});
  EXPECT_EQ(scene.Filter({4.2, 5, 0}).keep, Kept{false});
  EXPECT_EQ(scene.Filter({50.1, 5, 0}).keep, Kept{true});
}

TEST(FixedFilter, TheRatioIsOfTheReferencesThatObserveTheKeypoint) {
  Scene scene;
  const Eigen::Vector3d point(2, 0.5, 10);
  const Eigen::Vector2d seen_by_five(1, 1), seen_by_four(2, 2);
  scene.Observe(seen_by_five, point, {{0, 0}, {1, 1}, {2, 1}, {3, 1}, {4, 9}});
  scene.Observe(seen_by_four, point, {{0, 0}, {1, 1}, {2, 1}, {3, 9}});
  scene.Lift(seen_by_five, point, 0);
  scene.Lift(seen_by_four, point, 0);
  const FilterResult exactly_four_of_five = scene.Filter({4, 3, 0.8});
  EXPECT_EQ(exactly_four_of_five.keep, (Kept{true, false}));
  EXPECT_EQ(exactly_four_of_five.counts.consistent, 1u);
  EXPECT_EQ(exactly_four_of_five.counts.dropped_by_views, 0u);
  EXPECT_EQ(exactly_four_of_five.counts.dropped_by_ratio, 1u);
  EXPECT_EQ(scene.Filter({4, 3, 0.75}).keep, (Kept{true, true}));
  EXPECT_EQ(scene.Filter({4, 3, 0.81}).keep, (Kept{false, false}));
  const FilterResult four_views = scene.Filter({4, 4, 0.81});
  EXPECT_EQ(four_views.counts.dropped_by_views, 1u) << "too few views is said first";
  EXPECT_EQ(four_views.counts.dropped_by_ratio, 1u);
}

TEST(FixedFilter, ThePointsOwnReferenceCounts) {
  Scene scene;
  const Eigen::Vector3d point(0, 0, 10);
  scene.Observe({1, 1}, point, {{2, 0}});
  scene.Lift({1, 1}, point, 2);
  EXPECT_EQ(scene.Filter({4, 1, 1}).keep, Kept{true});
  EXPECT_EQ(scene.Filter({4, 2, 0}).keep, Kept{false});
}

TEST(FixedFilter, AWrongDepthIsSeenByTheOtherReferencesAlone) {
  // Lifted at depth 11 from the first camera: in the one b meters away the point lands
  // 1000 b (1/10 - 1/11) = 9.1 b px beside the keypoint.
  Scene scene;
  const Eigen::Vector3d point(1, 0, 10);
  scene.Observe({1, 1}, point, {{0, 0}, {1, 0}, {2, 0}, {3, 0}});
  scene.Lift({1, 1}, 1.1 * point, 0);
  const MultiViewErrors errors(scene.references, scene.matches, scene.points);
  ASSERT_EQ(errors.num_points(), 1u);
  ASSERT_EQ(errors.ViewsOf(0).size(), 4u);
  for (const ViewError& view : errors.ViewsOf(0)) {
    EXPECT_EQ(view.own, view.reference == 0);
    ASSERT_TRUE(view.error_px);
    EXPECT_NEAR(view.error_px->x(), 1000.0 * view.reference * (1 / 10.0 - 1 / 11.0), 1e-9);
    EXPECT_NEAR(view.error_px->y(), 0, 1e-9);
  }
  EXPECT_EQ(scene.Filter({9, 2, 0}).keep, Kept{false});
  EXPECT_EQ(scene.Filter({9.2, 2, 0}).keep, Kept{true});
  EXPECT_EQ(scene.Filter({18.2, 4, 0}).keep, Kept{false});
  EXPECT_EQ(scene.Filter({27.3, 4, 0}).keep, Kept{true});
}

TEST(FixedFilter, SeveralFeaturesAtOnePlaceCountOnceAndTheNearestDecides) {
  Scene scene;
  const Eigen::Vector3d point(1, 0, 10);
  // Two features at the query's place, matched with two keypoints of reference 1.
  scene.Observe({1, 1}, point, {{0, 0}, {1, 30}, {1, 2}});
  scene.Lift({1, 1}, point, 0);
  const MultiViewErrors errors(scene.references, scene.matches, scene.points);
  ASSERT_EQ(errors.ViewsOf(0).size(), 2u);
  EXPECT_NEAR(errors.ViewsOf(0)[1].error_px->x(), -2, 1e-9);
  EXPECT_EQ(errors.ViewsOf(0)[1].reference_px, scene.Project(1, point) + Eigen::Vector2d(2, 0));
  EXPECT_EQ(scene.Filter({4, 2, 1}).keep, Kept{true});
  EXPECT_EQ(scene.Filter({4, 3, 0}).keep, Kept{false});
}

TEST(FixedFilter, IndicesSayWhichMatchesAreOfAPointsKeypoint) {
  Scene scene;
  const Eigen::Vector3d point(1, 0, 10);
  scene.Observe({1, 1}, point, {{0, 0}, {1, 30}});
  scene.Observe({std::nextafter(1, 2), 1}, point, {{2, 1}, {3, 2}});
  scene.Lift({1, 1}, point, 0);
  const int keypoints[] = {6, 5, 6, 6};
  for (size_t i = 0; i < 4; ++i) scene.matches[i].query_keypoint = keypoints[i];
  scene.points[0].query_keypoint = 6;
  const MultiViewErrors errors(scene.references, scene.matches, scene.points);
  ASSERT_EQ(errors.ViewsOf(0).size(), 3u);
  EXPECT_EQ(errors.ViewsOf(0)[1].reference, 2);
  EXPECT_EQ(scene.Filter({4, 3, 1}).keep, Kept{true});
}

TEST(FixedFilter, AKeypointBehindAReferenceDoesNotAgree) {
  Scene scene;
  scene.Match(0, {1, 1}, {320, 240});
  scene.Match(1, {1, 1}, {320, 240});
  scene.Lift({1, 1}, {0, 0, -10}, 0);
  const FilterResult result = scene.Filter({1e9, 1, 0});
  EXPECT_EQ(result.keep, Kept{false});
  EXPECT_EQ(result.counts.dropped_by_views, 1u);
}

TEST(FilterPoints, OffKeepsAll) {
  Scene scene;
  scene.Lift({1, 1}, {0, 0, 10}, 0);
  const FilterResult result = FilterPoints(scene.references, scene.matches, scene.points, {});
  EXPECT_EQ(result.keep, Kept{true});
  EXPECT_EQ(result.counts.consistent, 1u);
}

TEST(ConsistencyThresholds, OutOfRangeIsAnOptionError) {
  EXPECT_THROW((ConsistencyThresholds{0, 3, 0.8}.Validate()), OptionError);
  EXPECT_THROW((ConsistencyThresholds{4, 0, 0.8}.Validate()), OptionError);
  EXPECT_THROW((ConsistencyThresholds{4, 3, 1.1}.Validate()), OptionError);
  EXPECT_NO_THROW(ConsistencyThresholds{}.Validate());
}

TEST(ConsistencyFilter, ModesHaveNames) { EXPECT_TRUE(NamesEveryValue<FilterMode>()); }

}  // namespace
}  // namespace raylift
