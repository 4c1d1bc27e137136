#include "raylift/sequences/smoothing.h"

#include <cmath>
#include <numbers>
#include <vector>

#include "base/statistics.h"
#include "sequences/anchors.h"
#include "sequences/made_walk.h"
#include "sequences/odometry.h"
#include "support/matchers.h"
#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "raylift/geometry/residuals.h"

namespace raylift {
namespace {

using Eigen::Vector3d;

double MedianError(const MadeWalk& made, const SmoothedWalk& walk) {
  std::vector<double> errors;
  for (size_t i = 0; i < made.truth.size(); ++i) errors.push_back(made.Error(walk, i));
  return UpperMedianOr(errors, 0);
}

// Squared errors over their covariance, per number: 1 where right.
double MeanNees(const MadeWalk& made, const SmoothedWalk& walk) {
  double sum = 0;
  for (size_t i = 0; i < made.truth.size(); ++i) {
    const Vector6d error = StepBetween(walk.frames[i].cam_from_world, made.truth[i]);
    sum += error.dot(walk.frames[i].covariance.inverse() * error) / 6;
  }
  return sum / static_cast<double>(made.truth.size());
}

TEST(SmoothWalk, AFrameIsPredictedByTheRestOfTheWalk) {
  Rng rng = TestRng();
  const MadeWalk made = MakeWalk(rng, {.frames = 40});
  const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kKnown);
  for (const size_t i : {0U, 11U, 39U}) {
    MadeWalk without = made;
    TakeAway(without, i, i + 1);
    const SmoothedFrame rest = SmoothWalk(without.frames, OdometryScale::kKnown).frames[i];
    EXPECT_EQ(rest.predicted->covariance, rest.covariance);
    const FramePrediction& predicted = walk.frames[i].predicted.value();
    // The noise is not quite that which the frame tells as well.
    const Matrix6d both = rest.covariance + predicted.covariance;
    const Vector6d off = StepBetween(predicted.cam_from_world, rest.cam_from_world);
    EXPECT_LT(off.dot(both.inverse() * off), 0.1) << i;
    EXPECT_NEAR(predicted.covariance.trace() / rest.covariance.trace(), 1, 0.2) << i;
    EXPECT_GT(predicted.covariance.trace(), walk.frames[i].covariance.trace());
  }
}

// A pose that was looked for where the walk has the frame says nothing for the walk.
TEST(SmoothWalk, WhatWasFoundWhereItIsPredictedIsNoWitness) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {.frames = 30});
  TakeAway(made, 2, 30);
  for (WalkEvidence& frame : made.frames) {
    for (SinglePose& single : frame.singles) single.confidence = 0.6;
  }
  const SmoothedWalk before = SmoothWalk(made.frames, OdometryScale::kKnown);
  for (size_t i = 2; i < 10; ++i) {
    made.frames[i].rematched = RematchedPose{{made.truth[i], 1e-6 * Matrix6d::Identity(), 0.99},
                                             1e-2 * Matrix6d::Identity()};
  }
  const SmoothedWalk after = SmoothWalk(made.frames, OdometryScale::kKnown);
  EXPECT_LE(after.frames[0].confidence, before.frames[0].confidence);
  EXPECT_LT(made.Error(after, 9), 0.005);
  EXPECT_GT(after.frames[9].rematched_agrees, 0.9);
  EXPECT_EQ(after.frames[12].rematched_agrees, 0);
  // But the odometry was not lost up to there.
  EXPECT_GT(after.frames[9].confidence, before.frames[9].confidence);
}

// The odometry's pose of one frame is of another time; its own pose is sure.
TEST(SmoothWalk, APoseOfAnotherTimeIsNotTheFrames) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {.frames = 40});
  made.frames[20].cam_from_odometry = made.frames[18].cam_from_odometry;
  for (WalkEvidence& frame : made.frames) frame.singles[0].confidence = 0.9999;
  const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kKnown);
  EXPECT_GT(walk.frames[19].confidence, 0.99);
  EXPECT_LT(walk.frames[20].single_agrees, 0.5);
  EXPECT_LT(walk.frames[20].against_own, 0.2);
}

TEST(UsedConfidences, LeaveRoomForAPoseThatWasNotFound) {
  const auto used = [](const std::vector<double>& confidences) {
    std::vector<SinglePose> singles;
    for (const double c : confidences) singles.push_back({Rigid3(), Matrix6d::Identity(), c});
    return UsedConfidences(singles);
  };
  EXPECT_THAT(used({0.5}), ::testing::ElementsAre(0.5));
  EXPECT_THAT(used({0.4, 0.2, 0.1}), ::testing::ElementsAre(0.4, 0.2, 0.1));
  const double third = (1 - 0.1 * kLost) / 3;
  EXPECT_THAT(used({0.5, 0.5}), ::testing::Each(::testing::DoubleNear(third, 1e-12)));
}

// From a first pose that is turned by its deviation the odometry leads a meter past the second one.
TEST(FindAnchors, ATurnOfAPoseMovesWhatIsFarFromIt) {
  constexpr double kTurnDeg = 5;
  Vector6d turn = Vector6d::Zero();
  turn.y() = kRadPerDeg * kTurnDeg;
  Matrix6d exact = 1e-6 * Matrix6d::Identity(), turned = exact;
  turned.diagonal().head<3>().setConstant(std::pow(kRadPerDeg * kTurnDeg, 2));
  const Rigid3 later{Eigen::Quaterniond::Identity(), Vector3d(0, 0, 10)};
  const std::vector<WalkEvidence> frames = {{Rigid3(), {{Moved(Rigid3(), turn), turned, 0.99}}},
                                            {later, {{later, exact, 0.99}}}};
  const auto anchors = FindAnchors(frames, 1, {1e-6, 1e-6});
  ASSERT_EQ(anchors.size(), 2U);
  EXPECT_FALSE(anchors[1].lost_before);
}

TEST(SmoothWalk, IsNearerToTheTruthThanSingleFramesAndKnowsHowNear) {
  Rng rng = TestRng();
  double nees = 0;
  constexpr int kWalks = 8;
  for (int k = 0; k < kWalks; ++k) {
    const MadeWalk made = MakeWalk(rng, {});
    const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kKnown);
    ASSERT_EQ(walk.frames.size(), made.frames.size());
    // A single frame's median error is 1.54 sigma.
    EXPECT_LT(MedianError(made, walk), 0.6 * 1.54 * 0.02);
    // Within a third, as 177 numbers that are not seen directly tell it.
    EXPECT_NEAR(walk.step_sigma, 0.005, 0.002);
    EXPECT_NEAR(walk.step_rotation_sigma_deg, 0.1, 0.04);
    nees += MeanNees(made, walk) / kWalks;
  }
  EXPECT_NEAR(nees, 1, 0.2);
}

TEST(SmoothWalk, FramesWithoutAPoseGetOneWithItsUncertainty) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {});
  TakeAway(made, 10, 30);
  const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kKnown);
  ASSERT_EQ(walk.frames.size(), made.frames.size());
  for (size_t i = 10; i < 30; ++i) {
    const double sigma = std::sqrt(walk.frames[i].covariance.bottomRightCorner<3, 3>().trace());
    EXPECT_LT(made.Error(walk, i), 4 * sigma);
    EXPECT_LT(sigma, 0.1);
    EXPECT_GT(walk.frames[i].confidence, 0.99);
  }
  EXPECT_GT(walk.frames[20].covariance(4, 4), 2 * walk.frames[5].covariance(4, 4));
}

TEST(SmoothWalk, WrongPosesOfHalfTheFramesDoNotWin) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {});
  // A repeated structure: the same place, 2.5 units on.
  const Rigid3 moved_from_world{Eigen::Quaterniond::Identity(), Vector3d(2.5, 0, 0)};
  for (size_t i = 0; i < 60; ++i) {
    if (rng.Uniform() < 0.5) continue;
    Rigid3& pose = made.frames[i].singles.front().cam_from_world;
    pose = i % 3 == 0 ? LookAt(Vector3d(rng.Normal(), rng.Normal(), 0), Vector3d(9, 9, 9))
                      : pose * moved_from_world;
    made.frames[i].singles.front().confidence = 0.6;
  }
  const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kKnown);
  ASSERT_EQ(walk.frames.size(), made.frames.size());
  for (size_t i = 0; i < 60; ++i) EXPECT_LT(made.Error(walk, i), 0.1) << i;
}

// A facade whose windows repeat: a frame is at one of two places. Of most frames the wrong one
// comes first, so many in a row one window to the right or to the left that they win where the
// right ones are not known.
TEST(SmoothWalk, TellsApartWhatFramesCannot) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {});
  for (size_t i = 0; i < 60; ++i) {
    std::vector<SinglePose>& singles = made.frames[i].singles;
    const double shift = i % 20 < 15 ? 2.5 : -2.5;
    const Rigid3 moved_from_world{Eigen::Quaterniond::Identity(), Vector3d(shift, 0, 0)};
    singles.push_back(singles.front());
    singles.front().cam_from_world = singles.front().cam_from_world * moved_from_world;
    for (SinglePose& single : singles) single.confidence = 0.5;
    if (i % 10 == 0) std::swap(singles[0], singles[1]);
  }
  const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kKnown);
  ASSERT_EQ(walk.frames.size(), made.frames.size());
  for (size_t i = 0; i < 60; ++i) {
    EXPECT_LT(made.Error(walk, i), 0.1) << i;
    EXPECT_EQ(walk.frames[i].single, i % 10 == 0 ? 0U : 1U) << i;
    EXPECT_GT(walk.frames[i].single_agrees, 0.9) << i;
  }
  EXPECT_NEAR(walk.single_sigma_factor, 1, 0.2);

  for (WalkEvidence& frame : made.frames) frame.singles.resize(1);
  const SmoothedWalk without = SmoothWalk(made.frames, OdometryScale::kKnown);
  size_t wrong = 0;
  for (size_t i = 0; i < 60; ++i) wrong += made.Error(without, i) > 1 ? 1 : 0;
  EXPECT_GT(wrong, 30U);
}

// Two thirds of a walk see what repeats, and are one window off here and two there, without being
// sure of it: so many are wrong alike, rather than that the odometry was lost.
TEST(SmoothWalk, WhatRepeatsDeceivesManyFramesAlike) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {});
  for (size_t i = 10; i < 50; ++i) {
    const double shift = i < 20 || i >= 40 ? 2.5 : -5;
    const Rigid3 moved_from_world{Eigen::Quaterniond::Identity(), Vector3d(shift, 0, 0)};
    SinglePose& single = made.frames[i].singles.front();
    single = {single.cam_from_world * moved_from_world, single.covariance, 0.5};
  }
  const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kKnown);
  ASSERT_EQ(walk.frames.size(), made.frames.size());
  for (size_t i = 0; i < 60; ++i) {
    EXPECT_FALSE(walk.frames[i].lost_before) << i;
    EXPECT_LT(made.Error(walk, i), 0.2) << i;
  }
}

// Weak poses that agree are right together, and show where the odometry was lost, whatever a single
// one that is somewhat surer says.
TEST(SmoothWalk, WeakPosesThatAgreeAreRight) {
  Rng rng = TestRng();
  for (const bool is_lost : {false, true}) {
    MadeWalk made = MakeWalk(rng, {});
    for (WalkEvidence& frame : made.frames) frame.singles.front().confidence = 0.3;
    made.frames[5].singles.front() = {RandomRigid3(rng, 10),
                                      made.frames[5].singles.front().covariance, 0.32};
    const Rigid3 jump{Eigen::Quaterniond::Identity(), Vector3d(1, 0, 0)};
    for (size_t i = 30; is_lost && i < 60; ++i) {
      made.frames[i].cam_from_odometry = made.frames[i].cam_from_odometry * jump;
    }
    const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kKnown);
    ASSERT_EQ(walk.frames.size(), made.frames.size());
    for (size_t i = 0; i < 60; ++i) {
      EXPECT_LT(made.Error(walk, i), 0.1) << i;
      EXPECT_EQ(walk.frames[i].lost_before, is_lost && i == 30) << i;
    }
  }
}

// The odometry is lost where a frame hardly knows where it is: that frame does not hide it.
TEST(SmoothWalk, APoseOfNoPlaceHidesNoLoss) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {});
  SinglePose& vague = made.frames[29].singles.front();
  vague.cam_from_world.translation += Vector3d(200, 0, 0);
  vague.covariance.bottomRightCorner<3, 3>().diagonal().setConstant(1e5);
  const Rigid3 jump{Eigen::Quaterniond::Identity(), Vector3d(4, 0, 0)};
  for (size_t i = 29; i < 60; ++i) {
    made.frames[i].cam_from_odometry = made.frames[i].cam_from_odometry * jump;
  }
  const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kKnown);
  ASSERT_EQ(walk.frames.size(), made.frames.size());
  EXPECT_TRUE(walk.frames[29].lost_before || walk.frames[30].lost_before);
  EXPECT_LT(walk.step_sigma, 0.05);
}

// Two corridors that are alike all along: what speaks for the one speaks for the other.
TEST(SmoothWalk, TwoWalksThatFitAsWellAreDoubtful) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {});
  const Rigid3 moved_from_world{Eigen::Quaterniond::Identity(), Vector3d(2.5, 0, 0)};
  for (WalkEvidence& frame : made.frames) {
    frame.singles.push_back(frame.singles.front());
    frame.singles.back().cam_from_world = frame.singles.back().cam_from_world * moved_from_world;
    for (SinglePose& single : frame.singles) single.confidence = 0.5;
  }
  const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kKnown);
  ASSERT_EQ(walk.frames.size(), made.frames.size());
  for (const SmoothedFrame& frame : walk.frames) EXPECT_LT(frame.confidence, 0.6);
}

// What else frames say makes a walk doubtful where it is one other walk, or several, and hardly where
// it is elsewhere each time; also where the frames' covariances are too small.
TEST(SmoothWalk, OnlyPosesThatAgreeMakeAnotherWalk) {
  const auto confidence_of = [](int others, bool agree, double too_small) {
    Rng rng = TestRng();
    MadeWalk made = MakeWalk(rng, {});
    for (size_t i = 0; i < made.frames.size(); ++i) {
      std::vector<SinglePose>& singles = made.frames[i].singles;
      singles.front().covariance /= too_small * too_small;
      singles.front().confidence = 0.8;
      if (i % 20 == 10) continue;
      for (int k = 1; k <= others; ++k) {
        const Rigid3 moved_from_world{Eigen::Quaterniond::Identity(), Vector3d(2.5 * k, 0, 0)};
        const Rigid3 place =
            agree ? made.truth[i] * moved_from_world
                  : LookAt(Vector3d(rng.Normal(), rng.Normal(), 0), Vector3d(9, 9, 9));
        singles.push_back(singles.front());
        singles.back().cam_from_world = Moved(place, Noise(rng, 0.2, 0.02));
      }
      for (SinglePose& single : singles) single.confidence = 1.0 / (1 + others);
    }
    const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kKnown);
    double sum = 0;
    for (size_t i = 0; i < walk.frames.size(); ++i) {
      EXPECT_LT(made.Error(walk, i), 0.15) << i;
      sum += walk.frames[i].confidence / static_cast<double>(walk.frames.size());
    }
    return sum;
  };
  for (const double too_small : {1.0, 3.0}) {
    EXPECT_GT(confidence_of(1, false, too_small), 0.95) << too_small;
    EXPECT_LT(confidence_of(1, true, too_small), 0.9) << too_small;
  }
  EXPECT_LT(confidence_of(3, true, 1), confidence_of(1, true, 1) - 0.1);
}

TEST(SmoothWalk, FindsAnUnknownScale) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {.scale = 0.013, .origin = {4.6e5, 5.4e6, 300}});
  TakeAway(made, 20, 40);
  const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kUnknown);
  ASSERT_EQ(walk.frames.size(), made.frames.size());
  EXPECT_NEAR(walk.scale * 0.013, 1, 4 * walk.scale_sigma * 0.013);
  EXPECT_LT(walk.scale_sigma * 0.013, 0.02);
  for (size_t i = 0; i < 60; ++i) EXPECT_LT(made.Error(walk, i), 0.15) << i;
}

TEST(SmoothWalk, TellsNothingWhereAnUnknownScaleIsNotObservable) {
  Rng rng = TestRng();
  const auto is_unobservable = [](const MadeWalk& made) {
    const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kUnknown);
    return walk.frames.empty() && !walk.scale_is_observable;
  };
  MadeWalk few = MakeWalk(rng, {});
  TakeAway(few, 0, 20);
  TakeAway(few, 21, 50);
  TakeAway(few, 51, 60);
  EXPECT_TRUE(is_unobservable(few));
  few.frames[50].singles.clear();
  EXPECT_TRUE(is_unobservable(few));
  EXPECT_FALSE(SmoothWalk(few.frames, OdometryScale::kKnown).frames.empty());

  MadeWalk turning = MakeWalk(rng, {});
  for (WalkEvidence& frame : turning.frames) {
    frame.singles.front().cam_from_world.translation =
        0.02 * Vector3d(rng.Normal(), rng.Normal(), 0);
    frame.cam_from_odometry.translation = 0.01 * Vector3d(rng.Normal(), rng.Normal(), 0);
  }
  EXPECT_TRUE(is_unobservable(turning));
}

TEST(SmoothWalk, SaysThatAKnownScaleIsWrong) {
  Rng rng = TestRng();
  const MadeWalk made = MakeWalk(rng, {.scale = 1000});
  const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kKnown);
  ASSERT_TRUE(walk.contradicting_scale);
  EXPECT_NEAR(*walk.contradicting_scale, 1e-3, 1e-4);
}

// What FindBetterReading() makes of the odometry of a walk whose poses were written otherwise.
std::optional<BetterReading> ReadingOf(MadeWalk made, const Eigen::Matrix3d& body_from_cam,
                                       bool inverted) {
  for (WalkEvidence& frame : made.frames) {
    Rigid3& pose = frame.cam_from_odometry;
    pose = Rigid3{Eigen::Quaterniond(body_from_cam), Vector3d::Zero()} * pose;
    if (inverted) pose = pose.Inverse();
  }
  return FindBetterReading(made.frames);
}

TEST(FindBetterReading, NamesTheAxesOfTheCameraAndInvertedPoses) {
  Rng rng = TestRng();
  const MadeWalk made = MakeWalk(rng, {});
  const Eigen::Matrix3d identity = Eigen::Matrix3d::Identity();
  const Eigen::Matrix3d open_gl = Vector3d(1, -1, -1).asDiagonal();
  Eigen::Matrix3d robot;  // x forward, y left, z up
  robot << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  EXPECT_FALSE(ReadingOf(made, identity, false));
  for (const Eigen::Matrix3d& body_from_cam : {identity, open_gl, robot}) {
    for (const bool inverted : {false, true}) {
      if (body_from_cam == identity && !inverted) continue;
      const auto better = ReadingOf(made, body_from_cam, inverted);
      ASSERT_TRUE(better && better->reading);
      EXPECT_EQ(better->reading->inverted, inverted);
      EXPECT_EQ(better->reading->cam_from_body, body_from_cam.transpose());
      EXPECT_LT(better->median_deg, 10);
    }
  }
}

// Straight ahead the axes beside the way are anyone's, and a camera that stands still has no way.
TEST(FindBetterReading, NamesNoAxesThatAStraightWayDoesNotTell) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {.frames = 30});
  const Matrix6d covariance = made.frames[0].singles.front().covariance;
  for (size_t i = 0; i < made.frames.size(); ++i) {
    const Rigid3 pose{Eigen::Quaterniond::Identity(),
                      Vector3d(0, 0, -0.5 * static_cast<double>(i))};
    made.frames[i] = {pose, {{Moved(pose, Noise(rng, 0.1, 0.01)), covariance, 0.99}}};
  }
  Eigen::Matrix3d robot;
  robot << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  EXPECT_FALSE(ReadingOf(made, Eigen::Matrix3d::Identity(), false));
  const auto better = ReadingOf(made, robot, false);
  ASSERT_TRUE(better);
  EXPECT_FALSE(better->reading);
  for (WalkEvidence& frame : made.frames) frame.cam_from_odometry = {};
  EXPECT_FALSE(FindBetterReading(made.frames));
}

// Poses without noise that do not turn and go in these directions, and odometry that is their
// truth.
MadeWalk WalkAlong(const std::vector<Vector3d>& directions) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {.frames = directions.size()});
  Vector3d position = Vector3d::Zero();
  for (size_t i = 0; i < directions.size(); ++i) {
    const Rigid3 pose{Eigen::Quaterniond::Identity(), -position};
    made.frames[i].cam_from_odometry = pose;
    made.frames[i].singles.front().cam_from_world = pose;
    position += directions[i];
  }
  return made;
}

// Odometry that is rolled by 35 degrees against one reading is so by 55 against the next: where the
// way is within 10 degrees of the axis, neither fits half as well as the other, whichever is tried
// first.
TEST(FindBetterReading, NamesNoAxesWhereTwoReadingsFitNearlyAsWell) {
  std::vector<Vector3d> directions;
  for (int i = 0; i < 60; ++i) {
    const double around = 2 * std::numbers::pi * i / 60;
    directions.push_back({std::sin(10 * kRadPerDeg) * std::cos(around),
                          std::sin(10 * kRadPerDeg) * std::sin(around), std::cos(10 * kRadPerDeg)});
  }
  Eigen::Matrix3d robot;
  robot << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  for (const double roll_deg : {35, 55, 125, 145, 215, 235, 305, 325}) {
    const Eigen::Matrix3d roll =
        Eigen::AngleAxisd(roll_deg * kRadPerDeg, Vector3d::UnitZ()).toRotationMatrix();
    const auto better = ReadingOf(WalkAlong(directions), robot * roll, false);
    ASSERT_TRUE(better) << roll_deg;
    EXPECT_FALSE(better->reading) << roll_deg;
    EXPECT_NEAR(better->median_deg, 6, 0.1) << roll_deg;
  }
}

// Odometry that has nothing to do with the walk is no other reading, and neither is a walk of which
// too little is known.
TEST(FindBetterReading, NamesNothingByChance) {
  Rng rng = TestRng();
  int named = 0;
  for (int i = 0; i < 200; ++i) {
    MadeWalk made = MakeWalk(rng, {.frames = 12});
    for (WalkEvidence& frame : made.frames) frame.cam_from_odometry = RandomRigid3(rng, 2);
    named += FindBetterReading(made.frames) ? 1 : 0;
  }
  EXPECT_LE(named, 4);
  MadeWalk few = MakeWalk(rng, {});
  TakeAway(few, 4, 60);
  EXPECT_FALSE(ReadingOf(few, Vector3d(1, -1, -1).asDiagonal(), false));
}

// Also where the frames after it are few: sure ones are not wrong in the same way instead.
TEST(SmoothWalk, LostOdometryDividesTheWalk) {
  Rng rng = TestRng();
  for (const size_t lost : {31, 53}) {
    MadeWalk made = MakeWalk(rng, {});
    const Rigid3 jump = RandomRigid3(rng, 2);
    for (size_t i = lost; i < 60; ++i) {
      made.frames[i].cam_from_odometry = made.frames[i].cam_from_odometry * jump;
    }
    const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kKnown);
    ASSERT_EQ(walk.frames.size(), made.frames.size());
    for (size_t i = 0; i < 60; ++i) {
      EXPECT_LT(made.Error(walk, i), 0.08) << i;
      EXPECT_EQ(walk.frames[i].lost_before, i == lost) << i;
    }
  }
}

TEST(SmoothWalk, ASurePoseHoldsAgainstOdometryThatWasLostBeforeIt) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {});
  made.frames.back().cam_from_odometry =
      made.frames.back().cam_from_odometry * RandomRigid3(rng, 2);
  made.frames.back().singles.front().confidence = 0.9999;
  const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kKnown);
  EXPECT_LT(made.Error(walk, 59), 0.1);
  EXPECT_TRUE(walk.frames.back().lost_before);
  EXPECT_GT(walk.frames.back().confidence, 0.99);
}

TEST(SmoothWalk, WhereTheOdometryWasLostFramesWithoutAPoseStayWithout) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {});
  TakeAway(made, 28, 34);
  const Rigid3 jump = RandomRigid3(rng, 2);
  for (size_t i = 31; i < 60; ++i) {
    made.frames[i].cam_from_odometry = made.frames[i].cam_from_odometry * jump;
  }
  const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kKnown);
  ASSERT_EQ(walk.frames.size(), made.frames.size());
  for (size_t i = 0; i < 60; ++i) {
    const bool in_gap = i >= 28 && i < 34;
    EXPECT_EQ(walk.frames[i].confidence > 0.5, !in_gap) << i;
    EXPECT_LT(in_gap ? 0 : made.Error(walk, i), 0.08) << i;
  }
}

TEST(SmoothWalk, PosesThatNeverAgreeAreNoneOfAMap) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {});
  for (WalkEvidence& frame : made.frames) {
    frame.singles.front().cam_from_world = RandomRigid3(rng, 10);
    frame.singles.front().confidence = 0.2;
  }
  const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kKnown);
  for (const SmoothedFrame& frame : walk.frames) EXPECT_LT(frame.confidence, 0.05);
}

TEST(SmoothWalk, StandingStillIsOneWitness) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {.frames = 30});
  const Rigid3 wrong = RandomRigid3(rng, 5);
  for (WalkEvidence& frame : made.frames) {
    frame.cam_from_odometry = Moved(Rigid3(), Noise(rng, 0.02, 0.001));
    frame.singles.front().cam_from_world = Moved(wrong, Noise(rng, 0.2, 0.02));
    frame.singles.front().confidence = 0.3;
  }
  const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kKnown);
  ASSERT_EQ(walk.frames.size(), made.frames.size());
  for (const SmoothedFrame& frame : walk.frames) EXPECT_LT(frame.confidence, 0.35);
}

TEST(SmoothWalk, AWalkThroughATwinCorridorStaysDoubtful) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {});
  for (WalkEvidence& frame : made.frames) frame.singles.front().confidence = 0.5;
  const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kKnown);
  ASSERT_EQ(walk.frames.size(), made.frames.size());
  for (const SmoothedFrame& frame : walk.frames) EXPECT_NEAR(frame.confidence, 0.875, 1e-9);
}

TEST(SmoothWalk, IsSureOfItselfHoweverLongItIs) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {.frames = 600});
  for (size_t i = 0; i < 600; i += 3) {
    made.frames[i].singles.front().cam_from_world = RandomRigid3(rng, 10);
  }
  TakeAway(made, 598, 600);
  const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kKnown);
  ASSERT_EQ(walk.frames.size(), made.frames.size());
  for (size_t i = 0; i < 598; ++i) {
    EXPECT_GT(walk.frames[i].confidence, 0.99) << i;
    // Where a frame contradicts the walk, either may be wrong.
    EXPECT_GT(walk.frames[i].against_own, i % 3 == 0 ? 0.9 : 0.999) << i;
  }
  // Beyond the last frame that agrees it may have been lost, though it never was before.
  EXPECT_LT(walk.frames[599].confidence, 0.9995 * walk.frames[597].confidence);
}

TEST(SmoothWalk, WithoutAnyPoseThereIsNone) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {});
  TakeAway(made, 0, 60);
  EXPECT_TRUE(SmoothWalk(made.frames, OdometryScale::kUnknown).frames.empty());
}

TEST(SmoothWalk, CovariancesThatAreTooSmallAreFoundOut) {
  Rng rng = TestRng();
  MadeWalk made = MakeWalk(rng, {});
  for (WalkEvidence& frame : made.frames) frame.singles.front().covariance /= 9;
  const SmoothedWalk walk = SmoothWalk(made.frames, OdometryScale::kKnown);
  EXPECT_NEAR(walk.single_sigma_factor, 3, 0.6);
  EXPECT_NEAR(MeanNees(made, walk), 1, 0.5);
}

}  // namespace
}  // namespace raylift
