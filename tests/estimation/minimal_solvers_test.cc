// The public minimal solvers find the pose from which a sample was made.

#include <algorithm>
#include <array>
#include <functional>
#include <vector>

#include "base/rng.h"
#include "support/matchers.h"

#include "raylift/estimation/solvers.h"

namespace raylift {
namespace {

using Eigen::Vector3d;

constexpr int kInstances = 50;

Vector3d DrawVector(Rng& rng, double sigma) {
  return sigma * Vector3d(rng.Normal(), rng.Normal(), rng.Normal());
}

// A camera that stands somewhere near the origin and looks about along z.
Rigid3 DrawPose(Rng& rng) { return {RotationFromVector(DrawVector(rng, 0.2)), DrawVector(rng, 1)}; }

// Points in front of all such cameras.
template <size_t kCount>
std::array<Vector3d, kCount> DrawPoints(Rng& rng) {
  std::array<Vector3d, kCount> points;
  for (Vector3d& point : points) point = Vector3d(0, 0, 12) + DrawVector(rng, 2);
  return points;
}

// Rays of any length towards the points.
template <size_t kCount>
std::array<Vector3d, kCount> RaysTo(const Rigid3& cam_from_world,
                                    const std::array<Vector3d, kCount>& points) {
  std::array<Vector3d, kCount> rays;
  for (size_t i = 0; i < kCount; ++i) rays[i] = 0.3 * (cam_from_world * points[i]);
  return rays;
}

// Rounding is amplified by samples that are nearly degenerate, which are rare.
::testing::AssertionResult FindsTruth(
    int max_solutions, const std::function<std::vector<Rigid3>(Rng& rng, Rigid3& truth)>& solve) {
  Rng rng = TestRng();
  int found = 0;
  for (int trial = 0; trial < kInstances; ++trial) {
    Rigid3 truth = DrawPose(rng);
    const std::vector<Rigid3> poses = solve(rng, truth);
    if (static_cast<int>(poses.size()) > max_solutions) {
      return ::testing::AssertionFailure() << poses.size() << " solutions";
    }
    found += std::any_of(poses.begin(), poses.end(), [&](const Rigid3& pose) {
      return static_cast<bool>(IsNearPose(pose, truth, 1e-4, 1e-5));
    });
  }
  if (found >= kInstances - 1) return ::testing::AssertionSuccess();
  return ::testing::AssertionFailure() << "the truth in " << found << " of " << kInstances;
}

TEST(MinimalSolvers, P3pFindsTheCamera) {
  EXPECT_TRUE(FindsTruth(4, [](Rng& rng, const Rigid3& truth) {
    const auto points = DrawPoints<3>(rng);
    return SolveP3p(RaysTo(truth, points), points);
  }));
}

TEST(MinimalSolvers, GeneralizedP3pFindsTheRig) {
  EXPECT_TRUE(FindsTruth(8, [](Rng& rng, const Rigid3& truth) {
    const auto points = DrawPoints<3>(rng);
    std::array<Vector3d, 3> centers, rays;
    for (size_t i = 0; i < 3; ++i) {
      centers[i] = DrawVector(rng, 0.3);
      rays[i] = 0.5 * (truth * points[i] - centers[i]);
    }
    return SolveGeneralizedP3p(centers, rays, points);
  }));
}

TEST(MinimalSolvers, E5p1FindsTheCamera) {
  EXPECT_TRUE(FindsTruth(10, [](Rng& rng, const Rigid3& truth) {
    const Rigid3 first = DrawPose(rng);
    const Rigid3 second = DrawPose(rng);
    const auto points = DrawPoints<6>(rng);
    auto reference_rays = RaysTo(first, points);
    reference_rays[5] = second * points[5];
    return SolveE5p1(RaysTo(truth, points), reference_rays, first, second);
  }));
}

TEST(MinimalSolvers, D3p1FindsTheCameraWhateverTheScaleOfDepth) {
  EXPECT_TRUE(FindsTruth(4, [](Rng& rng, const Rigid3& truth) {
    const Rigid3 first = DrawPose(rng);
    const Rigid3 second = DrawPose(rng);
    const auto points = DrawPoints<4>(rng);
    const double factor = rng.Uniform(0.2, 5);
    const std::array<Vector3d, 3> lifted = {
        factor * (first * points[0]), factor * (first * points[1]), factor * (first * points[2])};
    return SolveD3p1(RaysTo(truth, points), lifted, second * points[3], first, second);
  }));
}

TEST(MinimalSolvers, Up2pFindsTheCameraByGravity) {
  EXPECT_TRUE(FindsTruth(2, [](Rng& rng, const Rigid3& truth) {
    const auto points = DrawPoints<2>(rng);
    const Vector3d down_in_world = DrawVector(rng, 9.8);
    return SolveUp2p(RaysTo(truth, points), points, truth.rotation * down_in_world, down_in_world);
  }));
}

TEST(MinimalSolvers, AKnownCenterLeavesOnePose) {
  EXPECT_TRUE(FindsTruth(1, [](Rng& rng, const Rigid3& truth) {
    const auto points = DrawPoints<2>(rng);
    return SolveKnownCenter(RaysTo(truth, points), points, truth.OriginInSource());
  }));
}

TEST(MinimalSolvers, DegenerateSamplesHaveNoPose) {
  const std::array<Vector3d, 3> on_a_line = {Vector3d(0, 0, 5), Vector3d(1, 0, 5),
                                             Vector3d(2, 0, 5)};
  EXPECT_TRUE(SolveP3p(on_a_line, on_a_line).empty());
  Rng rng = TestRng();
  const Rigid3 truth = DrawPose(rng);
  const Rigid3 reference = DrawPose(rng);
  const auto points = DrawPoints<6>(rng);
  // The length of the translation cannot be told by a second reference with the same center.
  const auto rays = RaysTo(reference, points);
  EXPECT_TRUE(SolveE5p1(RaysTo(truth, points), rays, reference, reference).empty());
}

}  // namespace
}  // namespace raylift
