#include <atomic>
#include <memory>
#include <vector>

#include "service/walks.h"
#include <gtest/gtest.h>

#include "raylift/base/error.h"

namespace raylift {
namespace {

// A wall at z = 3.
class CountingWall final : public GeometrySource {
 public:
  std::string Description() const override { return "wall"; }
  std::vector<std::optional<SurfacePoint>> Lift(
      const PosedImage&, std::span<const Eigen::Vector2d> pixels) const override {
    ++calls;
    return std::vector<std::optional<SurfacePoint>>(
        pixels.size(), SurfacePoint{.point_in_world = {0, 0, 3},
                                    .normal_in_world = -Eigen::Vector3d::UnitZ(),
                                    .depth_z = 3,
                                    .incidence_deg = 0,
                                    .back_face = false});
  }
  mutable std::atomic<int> calls = 0;
};

class UnreadableMap final : public GeometrySource {
 public:
  std::string Description() const override { return "map"; }
  std::vector<std::optional<SurfacePoint>> Lift(const PosedImage&,
                                                std::span<const Eigen::Vector2d>) const override {
    throw InputError("map.png: is truncated");
  }
};

TEST(SceneWalks, AMapThatCannotBeReadIsNoReasonToOpenNothing) {
  Scene scene;
  const Camera camera(CameraModel::kPinhole, 64, 48, std::vector{50., 50., 32., 24.});
  scene.references.images = {{"r", camera, Rigid3()}};
  scene.AddGeometry(std::make_shared<UnreadableMap>());
  EXPECT_EQ(SceneDistances(scene, 1).At(camera, Rigid3()), std::nullopt);
}

TEST(SceneWalks, NoPhotographWaitsForTheScenesDistances) {
  const auto wall = std::make_shared<CountingWall>();
  const Camera camera(CameraModel::kPinhole, 64, 48, std::vector{50., 50., 32., 24.});
  Scene scene;
  scene.references.images = {{"r", camera, Rigid3()}};
  scene.AddGeometry(wall);
  const WalkTokens tokens({});
  const SceneWalks walks(tokens,
                         {.name = "wall",
                          .localizer = std::make_shared<const Localizer>(
                              std::make_shared<const Scene>(scene), nullptr, LocalizerOptions())},
                         1);
  const int measured = wall->calls;
  EXPECT_GT(measured, 0);
  const Query query{.name = "q", .camera = camera};
  LocalizedQuery alone;
  alone.name = query.name;
  WalkStep step;
  step.time_s = 1;
  walks.GoOn(walks.Before(step), {query, alone, step.cam_from_odometry, step.time_s});
  EXPECT_EQ(wall->calls, measured);
}

}  // namespace
}  // namespace raylift
