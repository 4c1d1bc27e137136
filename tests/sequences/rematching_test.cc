#include <algorithm>
#include <cmath>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "sequences/made_walk.h"
#include "support/matchers.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "raylift/base/error.h"
#include "raylift/lifting/geometry_source.h"
#include "raylift/sequences/smooth_queries.h"

namespace raylift {
namespace {

// The inside of a sphere around the origin.
class Sphere final : public GeometrySource {
 public:
  std::string Description() const override { return "a sphere"; }
  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage& reference, std::span<const Eigen::Vector2d> pixels) const override {
    constexpr double kRadius = 6;
    const Eigen::Vector3d center = reference.cam_from_world.OriginInSource();
    std::vector<std::optional<SurfacePoint>> points;
    for (const Eigen::Vector2d& pixel : pixels) {
      const Eigen::Vector3d ray = reference.cam_from_world.rotation.conjugate() *
                                  reference.camera.RayInCam(pixel).value().normalized();
      const double along = center.dot(ray);
      const double t = -along + std::sqrt(along * along - center.squaredNorm() + kRadius * kRadius);
      points.emplace_back().emplace().point_in_world = center + t * ray;
    }
    return points;
  }
};

// Ten frames of a walk have no pose by themselves.
class SmoothQueriesWithRematching : public ::testing::Test {
 protected:
  SmoothQueriesWithRematching() {
    Rng rng = TestRng();
    made_ = MakeWalk(rng, {.frames = 40, .step_deg = 1, .step_position = 0.05});
    const MadeWalk all = made_;
    TakeAway(made_, 10, 20);
    for (size_t i = 0; i < 40; ++i) {
      const std::string name = std::to_string(i);
      photographs_.push_back({name, kCamera});
      alone_.push_back(ResultOf(made_.frames[i], name));
      walks_[0].frames.push_back({i, static_cast<double>(i), made_.frames[i].cam_from_odometry});
    }
    for (size_t i = 0; i < 30; i += 3) {
      scene_.references.images.push_back({std::to_string(i) + ".ref", kCamera, made_.truth[i]});
    }
    scene_.AddGeometry(std::make_shared<Sphere>());
    options_.open_localizer = [this] {
      ++opened_;
      return [this](const Query& query, std::span<const size_t> references, const Rigid3& predicted,
                    const Matrix6d& covariance) {
        return Localize(query, references, predicted, covariance);
      };
    };
  }

  LocalizedQuery Localize(const Query& query, std::span<const size_t> references,
                          const Rigid3& predicted, const Matrix6d& covariance) {
    const auto frame = static_cast<size_t>(std::stoi(query.name));
    const std::lock_guard lock(mutex_);
    asked_.push_back(frame);
    EXPECT_TRUE(IsNearPose(predicted, made_.truth[frame], 10, 0.5));
    EXPECT_GT(covariance.trace(), 1e-5);
    // The reference that is next to it is the best.
    const double off = static_cast<double>(references[0]) - static_cast<double>(frame) / 3;
    EXPECT_LE(std::abs(off), 1) << frame;
    if (error_) throw InputError("a map is broken");
    LocalizedQuery found =
        ResultOf({Rigid3(), {{answer_ * made_.truth[frame], exact_, confidence_}}}, query.name);
    if (frame == nothing_) found.reason = "too few matches";
    return found;
  }

  WalkedQueries Smooth() {
    return SmoothQueries(alone_, photographs_, walks_, SceneDistances(scene_), options_);
  }

  const Camera kCamera{CameraModel::kPinhole, 64, 48, std::vector<double>{50, 50, 32, 24}};
  const Matrix6d exact_ = 1e-6 * Matrix6d::Identity();
  MadeWalk made_;
  std::vector<Query> photographs_;
  std::vector<LocalizedQuery> alone_;
  std::vector<Walk> walks_ = std::vector<Walk>(1);
  Scene scene_;
  SmoothingOptions options_;
  Rigid3 answer_;
  double confidence_ = 0.99;
  size_t nothing_ = 15;
  bool error_ = false;
  int opened_ = 0;
  std::mutex mutex_;
  std::vector<size_t> asked_;
};

TEST_F(SmoothQueriesWithRematching, PhotographsThatAreNotSureAreAskedAgain) {
  const WalkedQueries walked = Smooth();
  std::sort(asked_.begin(), asked_.end());
  // The one that gave nothing was asked again when it was known better where it is.
  const std::vector<size_t> expected = {10, 11, 12, 13, 14, 15, 15, 16, 17, 18, 19};
  EXPECT_EQ(asked_, expected);
  EXPECT_EQ(opened_, 1);
  EXPECT_EQ(walked.Count(WalkRole::kRescued), 10U);
  for (size_t i = 0; i < 40; ++i) {
    const WalkedQuery& query = walked.queries[i];
    EXPECT_EQ(query.rematched, i >= 10 && i < 20 && i != 15) << i;
    if (!query.rematched) continue;
    EXPECT_TRUE(IsNearPose(*query.localized.estimate.cam_from_world, made_.truth[i], 0.2, 0.01));
    EXPECT_THAT(FormatQueryDiagnostics(query), ::testing::HasSubstr("\"rematched\":true"));
  }
}

TEST_F(SmoothQueriesWithRematching, WhatContradictsThePredictionIsNotTaken) {
  answer_.translation.x() = 2;
  const WalkedQueries walked = Smooth();
  for (size_t i = 10; i < 20; ++i) {
    EXPECT_FALSE(walked.queries[i].rematched) << i;
    EXPECT_TRUE(
        IsNearPose(*walked.queries[i].localized.estimate.cam_from_world, made_.truth[i], 6, 0.4))
        << i;
  }
}

TEST_F(SmoothQueriesWithRematching, WhatIsMoreLikelyWrongIsNotTaken) {
  confidence_ = 0.4;
  for (const WalkedQuery& query : Smooth().queries) EXPECT_FALSE(query.rematched);
}

TEST_F(SmoothQueriesWithRematching, BrokenFilesLeaveTheWalkAsItWas) {
  error_ = true;
  const WalkedQueries walked = Smooth();
  EXPECT_THAT(walked.warnings, ::testing::ElementsAre(::testing::HasSubstr("a map is broken")));
  EXPECT_EQ(walked.Count(WalkRole::kRescued), 10U);
}

TEST_F(SmoothQueriesWithRematching, WhoKnowsItsPlaceIsNotAsked) {
  photographs_[12].priors.position = PositionPrior{{0, 0, 0}};
  photographs_[13].priors.focal_range = 2;
  Smooth();
  EXPECT_EQ(std::ranges::count(asked_, 12U) + std::ranges::count(asked_, 13U), 0);
}

TEST_F(SmoothQueriesWithRematching, OnlineOnlyThePastIsThere) {
  options_.online = true;
  Smooth();
  EXPECT_EQ(opened_, 0);
}

}  // namespace
}  // namespace raylift
