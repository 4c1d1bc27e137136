#include "diagnosis/match_agreement.h"

#include "lifting/room.h"
#include "support/matchers.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

using enum PoseConvention;

constexpr double kExact = 1e-9;

// Two cameras that look along z, the second one to the right of the first: the epipolar line of a
// pixel is its row, from the pixel itself (infinitely far) to the left.
class StereoPair : public ::testing::Test {
 protected:
  MatchAgreement Agree(const std::vector<ReferenceMatch>& matches) const {
    return Agreement(references_, matches, kCamFromWorld, kCamFromWorld, 1);
  }
  static ReferenceMatch Match(const Eigen::Vector2d& left_px, const Eigen::Vector2d& right_px) {
    return {0, 1, left_px, right_px};
  }
  static std::vector<PosedImage> MakeReferences() {
    const double f_cx_cy[] = {500, 320, 240};
    const Camera camera(CameraModel::kSimplePinhole, 640, 480, f_cx_cy);
    return {{"left", camera, {}},
            {"right", camera, {Eigen::Quaterniond::Identity(), Eigen::Vector3d(-1, 0, 0)}}};
  }

  const std::vector<PosedImage> references_ = MakeReferences();
};

TEST_F(StereoPair, ThresholdGrowsWithTheImage) {
  EXPECT_NEAR(EpipolarThresholdPx(references_[0].camera), 0.004 * 800, kExact);
  EXPECT_EQ(EpipolarThresholdPx(references_[0].camera.Scaled(64, 48)), 3);
}

TEST_F(StereoPair, MatchesAgreeNearTheirEpipolarLines) {
  const MatchAgreement agreement =
      Agree({Match({400, 100}, {350, 100}), Match({400, 100}, {350, 102}),
             Match({400, 100}, {350, 104})});
  EXPECT_EQ(agreement.agrees, (std::vector<bool>{true, true, false}));
  EXPECT_EQ(agreement.num_agreeing, 2u);
  // Of 0 and 2 the upper one; the nearest point of the sight line projects within a little of the
  // nearest pixel.
  EXPECT_NEAR(agreement.median_px, 2, 0.05);
}

TEST_F(StereoPair, ExactMatchesHaveNoDistance) {
  EXPECT_NEAR(Agree({Match({400, 100}, {350, 100})}).median_px, 0, kExact);
}

TEST_F(StereoPair, WhatIsSeenBehindTheCamerasDoesNotAgree) {
  EXPECT_EQ(Agree({Match({400, 100}, {450, 100})}).num_agreeing, 0u);
  // But for noise of what is far away.
  const MatchAgreement far = Agree({Match({400, 100}, {401, 100})});
  EXPECT_EQ(far.num_agreeing, 1u);
  EXPECT_NEAR(far.median_px, 1, kExact);
}

// Each match is dealt the right pixel of the one that is half of them further on. Of two of the six
// that lies in their row.
std::vector<ReferenceMatch> SixMatches() {
  const double rows[] = {50, 100, 150, 50, 250, 350};
  std::vector<ReferenceMatch> matches;
  for (int i = 0; i < 6; ++i) {
    matches.push_back({0, 1, {400, rows[i]}, {300.0 - 10 * i, rows[i]}});
  }
  return matches;
}

TEST_F(StereoPair, ChanceIsTheShareOfOtherKeypointsThatAgree) {
  std::vector<ReferenceMatch> matches = SixMatches();
  const MatchAgreement right = Agree(matches);
  EXPECT_EQ(right.num_random, 6u);
  EXPECT_NEAR(right.chance, 1.0 / 3, kExact);
  EXPECT_NEAR(right.Skill(), 1, kExact);
  EXPECT_NEAR(right.Purity(), 1, kExact);
  matches[1].b_px.y() += 10;
  const MatchAgreement one_wrong = Agree(matches);
  EXPECT_NEAR(one_wrong.chance, 1.0 / 3, kExact);
  EXPECT_NEAR(one_wrong.Skill(), (5.0 / 6 - 1.0 / 3) / (1 - 1.0 / 3), kExact);
  EXPECT_NEAR(one_wrong.Purity(), one_wrong.Skill() * 6 / 5, kExact);
}

TEST_F(StereoPair, WhereAllFitByChanceNothingIsSkill) {
  std::vector<ReferenceMatch> matches = SixMatches();
  for (ReferenceMatch& match : matches) match.a_px.y() = match.b_px.y() = 100;
  const MatchAgreement agreement = Agree(matches);
  EXPECT_EQ(agreement.num_agreeing, 6u);
  EXPECT_EQ(agreement.chance, 1);
  EXPECT_EQ(agreement.Skill(), 0);
  EXPECT_EQ(agreement.Purity(), 0);
}

TEST_F(StereoPair, AMatchWithoutOthersTellsNothingOfChance) {
  const MatchAgreement agreement = Agree({Match({400, 100}, {350, 100})});
  EXPECT_EQ(agreement.num_random, 0u);
  EXPECT_EQ(agreement.chance, 0);
  EXPECT_EQ(Agree({}).Skill(), 0);
}

TEST_F(StereoPair, MatchesOfFewPairsAreDealtKeypointsOfOtherPairs) {
  std::vector<PosedImage> references = references_;
  references.push_back(
      {"low", references_[0].camera, {Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, -1, 0)}});
  // From the low camera the epipolar line of a pixel in the right image is a diagonal.
  const std::vector<ReferenceMatch> matches = {{0, 1, {400, 100}, {350, 100}},
                                               {2, 1, {400, 100}, {350, 150}}};
  const MatchAgreement agreement = Agreement(references, matches, kCamFromWorld, kCamFromWorld, 1);
  EXPECT_EQ(agreement.num_agreeing, 2u);
  EXPECT_EQ(agreement.num_random, 2u);
  EXPECT_EQ(agreement.chance, 0);
}

TEST(MatchAgreement, PosesAreReadByAnotherConvention) {
  Rng rng(1);
  const Room room(2, rng);
  const PosedImage& image = room.references[1];
  const Rigid3 inverse = ReadAs(image, kCamFromWorld, kWorldFromCam).cam_from_world;
  EXPECT_TRUE(IsNearPose(inverse, image.cam_from_world.Inverse(), 1e-9, kExact));
  EXPECT_TRUE(IsNearPose(ReadAs(image, kOpenGlCamFromWorld, kOpenGlCamFromWorld).cam_from_world,
                         image.cam_from_world, 1e-9, kExact));
}

TEST(MatchAgreement, OnlyTheConventionOfTheFileAgrees) {
  Rng rng(2);
  const Room room(6, rng);
  const std::vector<ReferenceMatch> matches = room.MatchAll(20, 0.5, rng);
  for (const PoseConvention stored : AllValues<PoseConvention>()) {
    std::vector<PosedImage> as_read = room.references;
    for (PosedImage& image : as_read)
      image.cam_from_world = StoredPose(image.cam_from_world, stored);
    for (const PoseConvention poses : AllValues<PoseConvention>()) {
      const MatchAgreement agreement = Agreement(as_read, matches, kCamFromWorld, poses, 2);
      EXPECT_EQ(agreement.poses, poses);
      if (poses == stored) {
        EXPECT_EQ(agreement.num_agreeing, matches.size());
        EXPECT_LT(agreement.median_px, 0.6);
      } else {
        EXPECT_LT(agreement.Skill(), 0.3) << ToString(stored) << " " << ToString(poses);
      }
    }
  }
}

}  // namespace
}  // namespace raylift
