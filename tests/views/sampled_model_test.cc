#include "support/matchers.h"
#include "support/meshes.h"
#include "support/test_data.h"
#include <gtest/gtest.h>

#include "raylift/views/rendered_references.h"
#include "raylift/views/view_sampler.h"

namespace raylift {
namespace {

TEST(SampledModel, HoldsThePosesInBothForms) {
  Rng rng = TestRng();
  const std::vector<Rigid3> poses = {RandomRigid3(rng, 5), RandomRigid3(rng, 5)};
  const auto folder = TestFolder();
  for (const ColmapForm form : {ColmapForm::kText, ColmapForm::kBinary}) {
    WriteColmapModel(folder, MakeSampledModel(CenteredPinhole(64, 48, 50), poses, 1), form);
    const ColmapModel read = ReadColmapModel(folder, form);
    EXPECT_TRUE(read.warnings.empty());
    EXPECT_TRUE(read.frames.empty());
    const auto images = read.PosedImages();
    ASSERT_EQ(images.size(), 2u);
    EXPECT_EQ(images[1].name, "0001.jpg");
    EXPECT_TRUE(IsNearPose(images[1].cam_from_world, poses[1], 1e-10, 1e-12));
  }
}

TEST(SampledModel, RigsLookAllAroundFromOnePlaceAndAgreeWithTheirFrames) {
  const Eigen::Vector3d center(3, -2, 1.6);
  const Rigid3 ahead = LookAlong(center, {1, 0, 0}, {0, 0, 1});
  const auto folder = TestFolder();
  for (const ColmapForm form : {ColmapForm::kText, ColmapForm::kBinary}) {
    WriteColmapModel(folder, MakeSampledModel(CenteredPinhole(64, 48, 50), std::vector{ahead}, 4),
                     form);
    const ColmapModel read = ReadColmapModel(folder, form);
    EXPECT_TRUE(read.warnings.empty());  // the poses of images and of frames are the same
    EXPECT_EQ(read.rigs.size(), 1u);
    EXPECT_EQ(read.frames.size(), 1u);
    const auto images = read.PosedImages();
    ASSERT_EQ(images.size(), 4u);
    // To the right of x, seen from above (z), is -y.
    const std::vector<Eigen::Vector3d> forward = {{1, 0, 0}, {0, -1, 0}, {-1, 0, 0}, {0, 1, 0}};
    for (size_t k = 0; k < 4; ++k) {
      const Rigid3& pose = images[k].cam_from_world;
      EXPECT_LT((pose.OriginInSource() - center).norm(), 1e-12) << images[k].name;
      EXPECT_LT((pose.rotation.conjugate() * Eigen::Vector3d::UnitZ() - forward[k]).norm(), 1e-12)
          << images[k].name;
      EXPECT_LT(
          (pose.rotation.conjugate() * Eigen::Vector3d(0, -1, 0) - Eigen::Vector3d::UnitZ()).norm(),
          1e-12);
    }
  }
}

}  // namespace
}  // namespace raylift
