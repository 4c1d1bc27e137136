#include "evaluation/dcre.h"

#include <cmath>
#include <vector>

#include "base/rng.h"
#include <gtest/gtest.h>

namespace raylift {
namespace {

Camera PinholeCamera() {
  const double params[] = {500, 500, 320, 240};
  return Camera(CameraModel::kPinhole, 640, 480, params);
}

// A wall at depth 4.
std::vector<DensePoint> Wall() {
  const Camera camera = PinholeCamera();
  std::vector<DensePoint> points;
  for (double y = 20; y < 480; y += 40) {
    for (double x = 20; x < 640; x += 40) {
      const Eigen::Vector3d ray = *camera.RayInCam({x, y});
      points.push_back({{x, y}, ray * (4 / ray.z())});
    }
  }
  return points;
}

Rigid3 SomePose() { return {RotationFromVector({0.1, -0.4, 0.2}), Eigen::Vector3d(1, 2, 3)}; }

TEST(Dcre, ASidewaysShiftMovesAWallByItsDisparity) {
  Rigid3 moved = SomePose();
  moved.translation += Eigen::Vector3d(0.08, 0, 0);
  const auto dcre = ComputeDcre(PinholeCamera(), SomePose(), moved, Wall());
  const double expected = 500 * 0.08 / 4 / 800;  // 10 px of a diagonal of 800
  EXPECT_NEAR(dcre->mean, expected, 1e-9);
  EXPECT_NEAR(dcre->max, expected, 1e-9);
  EXPECT_EQ(dcre->count, Wall().size());
}

TEST(Dcre, ARotationMovesTheMiddleByItsTangent) {
  Rigid3 moved = SomePose();
  moved = Rigid3{RotationFromVector({0, 0.02, 0}), {0, 0, 0}} * moved;
  const std::vector<DensePoint> middle = {{{320, 240}, {0, 0, 3}}};
  const auto dcre = ComputeDcre(PinholeCamera(), SomePose(), moved, middle);
  EXPECT_NEAR(dcre->max, 500 * std::tan(0.02) / 800, 1e-9);
}

TEST(Dcre, MovingTheOriginOfTheWorldChangesNothing) {
  Rng rng(StreamSeed(0, "Dcre.Origin", ""));
  Rigid3 moved = SomePose();
  moved.translation += Eigen::Vector3d(0.05, -0.02, 0.1);
  const auto before = ComputeDcre(PinholeCamera(), SomePose(), moved, Wall());
  for (int i = 0; i < 10; ++i) {
    const Rigid3 old_from_new = {RotationFromVector({rng.Normal(), rng.Normal(), rng.Normal()}),
                                 1e5 * Eigen::Vector3d(rng.Normal(), rng.Normal(), rng.Normal())};
    const auto after =
        ComputeDcre(PinholeCamera(), SomePose() * old_from_new, moved * old_from_new, Wall());
    EXPECT_NEAR(after->mean, before->mean, 1e-9);
    EXPECT_NEAR(after->max, before->max, 1e-9);
  }
}

TEST(Dcre, WhatGoesBehindTheCameraCountsOneDiagonal) {
  Rigid3 turned = SomePose();
  turned = Rigid3{RotationFromVector({0, 3.1, 0}), {0, 0, 0}} * turned;
  const auto dcre = ComputeDcre(PinholeCamera(), SomePose(), turned, Wall());
  EXPECT_NEAR(dcre->mean, 1, 1e-12);
  EXPECT_EQ(dcre->max, 1);
}

TEST(Dcre, PhotographsWithoutDepthAreReportedApart) {
  const std::vector<DcreQuery> queries = {{"good", true, Dcre{0.004, 0.04, 10}},
                                          {"bad", true, Dcre{0.3, 0.5, 10}},
                                          {"lost", true, std::nullopt},
                                          {"no depth", false, std::nullopt}};
  const DcreSummary summary = SummarizeDcre("mine", queries);
  EXPECT_EQ(summary.num_queries, 3u);
  EXPECT_EQ(summary.without_depth, std::vector<std::string>{"no depth"});
  EXPECT_NEAR(summary.mean_recalls_percent[0], 100.0 / 3, 1e-9);
  EXPECT_NEAR(summary.max_recalls_percent[0], 0, 1e-9);
  EXPECT_NEAR(summary.max_recalls_percent[1], 100.0 / 3, 1e-9);
  EXPECT_EQ(summary.median_of_mean, 0.3);
  EXPECT_FALSE(ComputeDcre(PinholeCamera(), {}, {}, {}).has_value());
}

}  // namespace
}  // namespace raylift
