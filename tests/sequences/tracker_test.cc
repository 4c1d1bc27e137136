#include "raylift/sequences/tracker.h"

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "sequences/made_walk.h"
#include "sequences/walked_query.h"
#include "support/matchers.h"
#include "support/test_data.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "raylift/base/file.h"
#include "raylift/base/text.h"

namespace raylift {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

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

TEST(WalkFilter, KnowsTheWayOfFramesThatItForgets) {
  Rng rng = TestRng();
  // What is forgotten is a whole round, which ends where it began.
  MadeWalk made = MakeWalk(rng, {.frames = 80});
  TakeAway(made, 20, 80);
  WalkFilter filter(OdometryScale::kKnown);
  SmoothedWalk walk;
  for (const WalkEvidence& frame : made.frames) walk = filter.Add(frame);
  const SmoothedWalk whole = SmoothWalk(made.frames, OdometryScale::kKnown);
  const auto sigma = [](const SmoothedWalk& of) {
    return std::sqrt(of.frames.back().covariance.bottomRightCorner<3, 3>().trace());
  };
  // Without its way it would be 0.7.
  EXPECT_NEAR(sigma(walk) / sigma(whole), 1, 0.2);
}

struct Inputs {
  std::vector<Query> photographs = {};
  std::vector<LocalizedQuery> alone = {};
  std::vector<Walk> walks = {Walk()};
};

Inputs InputsOf(const MadeWalk& made) {
  Inputs inputs;
  for (size_t i = 0; i < made.frames.size(); ++i) {
    const std::string name = std::to_string(i);
    inputs.photographs.push_back(
        {name, Camera(CameraModel::kPinhole, 64, 48, std::vector<double>{50, 50, 32, 24})});
    inputs.alone.push_back(ResultOf(made.frames[i], name));
    inputs.walks[0].frames.push_back({i, static_cast<double>(i), made.frames[i].cam_from_odometry});
  }
  return inputs;
}

TEST(SmoothQueries, OneWeakPoseOfAWalkDoesNotSpeakForTheOthers) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {.frames = 20});
  TakeAway(made, 0, 12);
  TakeAway(made, 13, 20);
  made.frames[12].singles.front().confidence = 0.08;
  const Inputs inputs = InputsOf(made);
  const WalkedQueries walked =
      SmoothQueries(inputs.alone, inputs.photographs, inputs.walks, SceneDistances(Scene()), {});
  EXPECT_EQ(walked.Count(WalkRole::kRescued), 0U);
  EXPECT_EQ(walked.Count(WalkRole::kSmoothed), 1U);
}

TEST(SmoothQueries, APoseWithoutAUsableCovarianceNeitherSpeaksNorIsDropped) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {.frames = 20});
  Inputs inputs = InputsOf(made);
  inputs.alone[4].estimate.covariance->setZero();
  inputs.alone[5].estimate.covariance->setConstant(NAN);
  inputs.alone[6].estimate.covariance.reset();
  inputs.alone[6].estimate.inlier_keypoints = 40;
  const auto smooth = [&] {
    return SmoothQueries(inputs.alone, inputs.photographs, inputs.walks, SceneDistances(Scene()),
                         {});
  };
  const WalkedQueries walked = smooth();
  EXPECT_EQ(walked.Count(WalkRole::kSmoothed), 17U);
  EXPECT_EQ(walked.Count(WalkRole::kReplaced), 3U);
  EXPECT_EQ(walked.queries[6].localized.estimate.inlier_keypoints, 0);

  // Where the walk is not sure, such a pose stays.
  for (size_t i = 0; i < 20; ++i) {
    if (i == 4) continue;
    inputs.alone[i].estimate.confidence = 0.04;
    if (i < 4 || i > 6) inputs.alone[i].reason = "too few matches";
  }
  inputs.alone[6].estimate.covariance = made.frames[6].singles.front().covariance;
  EXPECT_EQ(smooth().queries[4].role, WalkRole::kAlone);
  EXPECT_TRUE(smooth().queries[4].localized.localized());

  inputs.alone[6].estimate.covariance.reset();
  EXPECT_EQ(smooth().Count(WalkRole::kAlone), 20U);
  EXPECT_THAT(smooth().warnings, ElementsAre(HasSubstr("no photograph of it has a pose")));
}

TEST(SmoothQueries, AWalkThatKnowsNoDirectionIsNoSurePose) {
  const Inputs inputs = InputsOf({.truth = {}, .frames = {{.cam_from_odometry = {}}}});
  const auto confidence = [&](double turn_sigma) {
    SmoothedFrame frame;
    frame.confidence = 1;
    frame.covariance = 1e-6 * Matrix6d::Identity();
    frame.covariance.diagonal().head<3>().setConstant(turn_sigma * turn_sigma);
    WalkedQuery rescued{inputs.alone[0]};
    TakeFromWalk(frame, inputs.photographs[0], SceneDistances(Scene()), 0, rescued);
    return rescued.localized.confidence();
  };
  // How far away the scene is, is not known.
  EXPECT_NEAR(confidence(1e-3), 0.5, 1e-6);
  EXPECT_LT(confidence(0.3), 0.4);
}

// A walk that was found again at a place that is right with .6 is no surer there than that, or than
// by what it was predicted.
TEST(SmoothQueries, WhatWasFoundAgainIsNoSurerThanItIs) {
  const Inputs inputs = InputsOf({.truth = {}, .frames = {{.cam_from_odometry = {}}}});
  const auto confidence = [&](double predicted_sigma) {
    SmoothedFrame frame;
    frame.confidence = 1;
    frame.covariance = 1e-8 * Matrix6d::Identity();
    frame.rematched_agrees = 0.6;
    frame.predicted = FramePrediction{Rigid3(), 1e-8 * Matrix6d::Identity()};
    frame.predicted->covariance.diagonal().head<3>().setConstant(predicted_sigma * predicted_sigma);
    WalkedQuery rescued{inputs.alone[0]};
    TakeFromWalk(frame, inputs.photographs[0], SceneDistances(Scene()), 0, rescued);
    EXPECT_TRUE(rescued.rematched);
    return rescued.localized.confidence();
  };
  EXPECT_LE(confidence(0.1), 0.6);
  EXPECT_LE(confidence(1e-4), 0.6);  // how far away the scene is, is not known
}

TEST(WriteWalk, CovariancesAreTheirUpperTriangleByRows) {
  Rng rng = TestRng();
  const MadeWalk made = MakeWalk(rng, {.frames = 20});
  const Inputs inputs = InputsOf(made);
  const WalkedQueries walked =
      SmoothQueries(inputs.alone, inputs.photographs, inputs.walks, SceneDistances(Scene()), {});
  const auto folder = TestFolder();
  WriteWalk(folder, walked);
  const std::string text = ReadFile(folder / "trajectory_covariance.txt");
  const Matrix6d& covariance = *walked.queries[7].localized.estimate.covariance;
  std::string expected = "\n7";
  for (Eigen::Index i = 0; i < 6; ++i) {
    for (Eigen::Index k = i; k < 6; ++k) expected += ' ' + FormatDouble(covariance(i, k));
  }
  EXPECT_THAT(text, HasSubstr(expected + '\n'));
}

TEST(SmoothQueries, WithoutAnObservableScaleResultsStayAsTheyAre) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {.frames = 20, .scale = 7});
  TakeAway(made, 1, 20);
  const Inputs inputs = InputsOf(made);
  for (const bool online : {false, true}) {
    const WalkedQueries walked =
        SmoothQueries(inputs.alone, inputs.photographs, inputs.walks, SceneDistances(Scene()),
                      {.scale = OdometryScale::kUnknown, .online = online});
    EXPECT_EQ(walked.Count(WalkRole::kAlone), 20U);
    EXPECT_TRUE(walked.queries[0].localized.localized());
    EXPECT_FALSE(walked.walks[0].odometry);
    EXPECT_THAT(walked.warnings, ElementsAre(HasSubstr("scale is not observable")));
  }
}

TEST(SmoothQueries, WalksOfAListAreSmoothedApart) {
  Rng rng = TestRng();
  std::vector<Inputs> apart;
  for (const double scale : {0.2, 7.0}) {
    MadeWalk made = MakeWalk(rng, {.frames = 20, .scale = scale});
    TakeAway(made, 5, 8);
    apart.push_back(InputsOf(made));
  }
  // One of each, in turn.
  Inputs all{.walks = {{.folder = "a/"}, {.folder = "b/"}}};
  for (size_t i = 0; i < 40; ++i) {
    const Inputs& one = apart[i % 2];
    all.photographs.push_back(one.photographs[i / 2]);
    all.alone.push_back(one.alone[i / 2]);
    all.alone.back().name = (i % 2 == 0 ? "a/" : "b/") + all.alone.back().name;
    all.walks[i % 2].frames.push_back(one.walks[0].frames[i / 2]);
    all.walks[i % 2].frames.back().query = i;
  }
  const SmoothingOptions options{.scale = OdometryScale::kUnknown};
  const auto smooth = [&](const Inputs& inputs) {
    return SmoothQueries(inputs.alone, inputs.photographs, inputs.walks, SceneDistances(Scene()),
                         options);
  };
  const WalkedQueries walked = smooth(all);
  const auto folder = TestFolder();
  const auto write = [&](const char* name, const WalkedQueries& what) {
    std::filesystem::create_directories(folder / name);
    WriteWalk(folder / name, what);
    return nlohmann::json::parse(ReadFile(folder / name / "walk.json"));
  };
  const auto json = write("all", walked);
  EXPECT_EQ(json.at("photographs").at("rescued"), 6);
  for (size_t k = 0; k < 2; ++k) {
    const WalkedQueries by_itself = smooth(apart[k]);
    for (size_t i = 0; i < 20; ++i) {
      WalkedQuery query = walked.queries[2 * i + k];
      query.localized.name = by_itself.queries[i].localized.name;
      EXPECT_EQ(FormatQueryDiagnostics(query), FormatQueryDiagnostics(by_itself.queries[i]));
    }
    const auto alone = write("alone", by_itself);
    const auto& part = json.at("walks").at(k);
    EXPECT_EQ(part.at("folder"), k == 0 ? "a/" : "b/");
    EXPECT_EQ(part.at("photographs"), alone.at("photographs"));
    EXPECT_EQ(part.at("odometry"), alone.at("odometry"));
    for (const std::string name : {"trajectory", "trajectory_covariance"}) {
      EXPECT_EQ(ReadFile(folder / "all" / (name + "_" + std::to_string(k + 1) + ".txt")),
                ReadFile(folder / "alone" / (name + ".txt")));
    }
  }

  // What is said of one of them says so.
  for (LocalizedQuery& query : all.alone) {
    if (query.name.starts_with("b/") && query.name != "b/0") query.reason = "too few matches";
  }
  const WalkedQueries less = smooth(all);
  EXPECT_THAT(less.warnings, ElementsAre(HasSubstr("b/: the odometry's unknown scale")));
  write("all", {.queries = less.queries, .walks = {less.walks[0]}, .warnings = {}});
  EXPECT_TRUE(std::filesystem::exists(folder / "all/trajectory_1.txt"));
  EXPECT_FALSE(std::filesystem::exists(folder / "all/trajectory_covariance_2.txt"));
  WriteFile(folder / "all/trajectory_7.txt", "somebody's");
  RemoveWalk(folder / "all");
  EXPECT_FALSE(std::filesystem::exists(folder / "all/trajectory_1.txt"));
  EXPECT_FALSE(std::filesystem::exists(folder / "all/walk.json"));
  EXPECT_TRUE(std::filesystem::exists(folder / "all/trajectory_7.txt"));
}

TEST(Tracker, EqualsTheWholeWalkOnline) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {.frames = 70, .scale = 0.2});
  TakeAway(made, 0, 4);
  TakeAway(made, 20, 30);
  Inputs inputs = InputsOf(made);
  inputs.alone[10].estimate.covariance.reset();
  inputs.alone[12].estimate.covariance->setZero();
  const auto scene = std::make_shared<const Scene>();
  const SmoothingOptions options{.scale = OdometryScale::kUnknown, .online = true};
  const WalkedQueries walked = SmoothQueries(inputs.alone, inputs.photographs, inputs.walks,
                                             SceneDistances(*scene), options);
  EXPECT_EQ(walked.Count(WalkRole::kRescued), 10U);
  Tracker tracker(Localizer(scene, nullptr, {}), options);
  for (size_t i = 0; i < 70; ++i) {
    const TrackedPose tracked =
        tracker.Add(inputs.photographs[i], inputs.alone[i], made.frames[i].cam_from_odometry,
                    static_cast<double>(i));
    EXPECT_EQ(FormatQueryDiagnostics(tracked.query), FormatQueryDiagnostics(walked.queries[i]));
    // The third photograph with a pose tells the scale.
    EXPECT_EQ(tracked.world_from_odometry.has_value(), i >= 6) << i;
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
