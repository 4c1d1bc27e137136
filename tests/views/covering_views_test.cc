#include <cmath>

#include "support/matchers.h"
#include "support/meshes.h"
#include <gtest/gtest.h>

#include "raylift/surfaces/mesh_files.h"
#include "raylift/views/view_sampler.h"

namespace raylift {
namespace {

// The corner of a room, as a scan of it: two walls, no floor; nothing faces z.
RayCaster CornerOfARoom() {
  std::vector<TriangleMesh> walls;
  const double half = 2;
  walls.push_back(MakePlane({Eigen::Quaterniond::Identity(), {0, 0, half}}, half, 4));
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(EIGEN_PI / 2, Eigen::Vector3d::UnitY()));
  walls.push_back(MakePlane({turn, {half, 0, 0}}, half, 4));
  return RayCaster(std::make_shared<const TriangleMesh>(MergeMeshes(std::move(walls))));
}

const ViewSamplerOptions kOptions{
    .camera = CenteredPinhole(80, 60, 60), .count = 12, .clearance = 0.2};

TEST(SampleCovering, SeesAllWallsFromTheirFrontAndKeepsClear) {
  const RayCaster mesh = CornerOfARoom();
  const SampledViews views = SampleCovering(mesh, kOptions);
  EXPECT_TRUE(views.warnings.empty());
  ASSERT_EQ(views.cam_from_world.size(), 12u);
  int of_each_wall[2] = {0, 0};
  for (const Rigid3& pose : views.cam_from_world) {
    const Eigen::Vector3d eye = pose.OriginInSource();
    EXPECT_LT(eye.z(), 2 - 0.19);  // in front of both walls
    EXPECT_LT(eye.x(), 2 - 0.19);
    const Eigen::Vector3d forward = pose.rotation.conjugate() * Eigen::Vector3d::UnitZ();
    ++of_each_wall[forward.x() > forward.z() ? 1 : 0];
  }
  EXPECT_GE(of_each_wall[0], 3);
  EXPECT_GE(of_each_wall[1], 3);
}

TEST(SampleCovering, IsTheSameForTheSameSeed) {
  const RayCaster mesh = CornerOfARoom();
  ViewSamplerOptions options = kOptions;
  const SampledViews first = SampleCovering(mesh, options);
  options.threads = 1;
  const SampledViews again = SampleCovering(mesh, options);
  options.seed = 1;
  const SampledViews other = SampleCovering(mesh, options);
  ASSERT_EQ(first.cam_from_world.size(), again.cam_from_world.size());
  for (size_t i = 0; i < first.cam_from_world.size(); ++i) {
    EXPECT_EQ(first.cam_from_world[i].translation, again.cam_from_world[i].translation);
    EXPECT_NE(first.cam_from_world[i].translation, other.cam_from_world[i].translation);
  }
}

TEST(SampleCovering, SaysWhereThereIsNoPlace) {
  const RayCaster mesh = CornerOfARoom();
  ViewSamplerOptions options = kOptions;
  options.clearance = 100;
  EXPECT_TRUE(
      FailsWithInputError([&] { SampleCovering(mesh, options); }, {"no place for a camera"}));
}

TEST(MeshSize, IsThatOfTheSurfaceInScene) {
  // The corner's bounds are 4 x 4 x 4, without the outermost parts.
  EXPECT_NEAR(MeshSize(CornerOfARoom().mesh(), 0), 4 * std::sqrt(3.0), 0.5);
}

}  // namespace
}  // namespace raylift
