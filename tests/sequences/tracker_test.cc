#include "raylift/sequences/tracker.h"

#include <memory>
#include <string>
#include <vector>

#include "sequences/made_walk.h"
#include "support/matchers.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

TEST(WalkFilter, IsTheWalkSoFar) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {.frames = 25});
  TakeAway(made, 0, 3);
  TakeAway(made, 12, 18);
  WalkFilter filter(OdometryScale::kKnown);
  for (size_t i = 0; i < 25; ++i) {
    const SmoothedWalk so_far = filter.Add(made.frames[i]);
    ASSERT_EQ(so_far.frames.empty(), i < 3);
    if (i < 4) continue;
    const SmoothedWalk walk =
        SmoothWalk(std::span(made.frames).first(i + 1), OdometryScale::kKnown);
    EXPECT_EQ(so_far.frames.back().covariance, walk.frames.back().covariance);
    EXPECT_LT(made.Error(walk, i), 0.15);
  }
}

TEST(WalkFilter, KeepsNoMoreThanItNeedsOfALongWalk) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {.frames = 200});
  TakeAway(made, 90, 160);
  WalkFilter filter(OdometryScale::kKnown);
  for (size_t i = 0; i < 200; ++i) {
    const SmoothedWalk walk = filter.Add(made.frames[i]);
    ASSERT_LE(walk.frames.size(), 61U);
    // After 70 steps by odometry alone its drift is known, and the way back is found at once.
    const SmoothedFrame& newest = walk.frames.back();
    const double error =
        (newest.cam_from_world.OriginInSource() - made.truth[i].OriginInSource()).norm();
    const double sigma = std::sqrt(newest.covariance.bottomRightCorner<3, 3>().trace());
    EXPECT_LT(error, 5 * sigma) << i;
    EXPECT_LT(sigma, i >= 90 && i < 160 ? 1 : 0.06) << i;
  }
}

LocalizedQuery ResultOf(const WalkEvidence& frame, const std::string& name) {
  LocalizedQuery query;
  query.name = name;
  query.reason = frame.single ? "" : "too few matches";
  if (!frame.single) return query;
  query.estimate.cam_from_world = frame.single->cam_from_world;
  query.estimate.covariance = frame.single->covariance;
  query.estimate.confidence = frame.single->confidence;
  query.estimate.verdict = PoseVerdict::kLocalized;
  return query;
}

struct Inputs {
  std::vector<Query> photographs;
  std::vector<LocalizedQuery> alone;
  Walk walk;
};

Inputs InputsOf(const MadeWalk& made) {
  Inputs inputs;
  for (size_t i = 0; i < made.frames.size(); ++i) {
    const std::string name = std::to_string(i);
    inputs.photographs.push_back(
        {name, Camera(CameraModel::kPinhole, 64, 48, std::vector<double>{50, 50, 32, 24})});
    inputs.alone.push_back(ResultOf(made.frames[i], name));
    inputs.walk.frames.push_back({i, static_cast<double>(i), made.frames[i].cam_from_odometry});
  }
  return inputs;
}

TEST(SmoothQueries, OneWeakPoseOfAWalkDoesNotSpeakForTheOthers) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {.frames = 20});
  TakeAway(made, 0, 12);
  TakeAway(made, 13, 20);
  made.frames[12].single->confidence = 0.08;
  const Inputs inputs = InputsOf(made);
  const WalkedQueries walked =
      SmoothQueries(inputs.alone, inputs.photographs, inputs.walk, SceneDistances(Scene()), {});
  EXPECT_EQ(walked.Count(WalkRole::kRescued), 0U);
  EXPECT_EQ(walked.Count(WalkRole::kSmoothed), 1U);
}

TEST(Tracker, EqualsTheWholeWalkOnline) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {.frames = 70, .scale = 0.2});
  TakeAway(made, 0, 4);
  TakeAway(made, 20, 30);
  const Inputs inputs = InputsOf(made);
  const auto scene = std::make_shared<const Scene>();
  const SmoothingOptions options{.scale = OdometryScale::kUnknown, .online = true};
  const WalkedQueries walked =
      SmoothQueries(inputs.alone, inputs.photographs, inputs.walk, SceneDistances(*scene), options);
  EXPECT_EQ(walked.Count(WalkRole::kRescued), 10U);
  Tracker tracker(Localizer(scene, nullptr, {}), options);
  for (size_t i = 0; i < 70; ++i) {
    const TrackedPose tracked =
        tracker.Add(inputs.photographs[i], inputs.alone[i], made.frames[i].cam_from_odometry,
                    static_cast<double>(i));
    EXPECT_EQ(FormatQueryDiagnostics(tracked.query), FormatQueryDiagnostics(walked.queries[i]));
    EXPECT_EQ(tracked.world_from_odometry.has_value(), i >= 4);
    if (!tracked.world_from_odometry) continue;
    Rigid3 odometry = made.frames[i].cam_from_odometry;
    odometry.translation *= tracked.scale;
    EXPECT_TRUE(IsNearPose(odometry * tracked.world_from_odometry->Inverse(),
                           *tracked.query.localized.estimate.cam_from_world, 1e-9, 1e-9));
  }
  EXPECT_TRUE(
      FailsWithInputError([&] { tracker.Add(inputs.photographs[0], inputs.alone[0], {}, 69); },
                          {"0: expected a time after 69 s, found 69 s"}));
}

}  // namespace
}  // namespace raylift
