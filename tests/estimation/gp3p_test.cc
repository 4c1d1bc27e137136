#include <algorithm>
#include <limits>

#include "estimation/solvers/minimal_solvers.h"
#include "support/matchers.h"

namespace raylift {
namespace {

using Eigen::Vector3d;
using Poses = std::array<CamFromLocal, kMaxGeneralizedP3pSolutions>;

Vector3d RandomVector(Rng& rng, double extent) {
  const double x = rng.Uniform(-extent, extent);
  const double y = rng.Uniform(-extent, extent);
  return {x, y, rng.Uniform(-extent, extent)};
}

// Three points before three cameras of a rig, whose centers lie within `baseline`.
struct Seen {
  Rigid3 rig_from_world;
  std::array<Vector3d, 3> centers, rays, points;

  Seen(Rng& rng, double baseline) : rig_from_world(RandomRigid3(rng, 10)) {
    for (size_t i = 0; i < 3; ++i) {
      const Vector3d in_rig = Vector3d(0, 0, 6) + RandomVector(rng, 5);
      centers[i] = RandomVector(rng, baseline);
      rays[i] = (in_rig - centers[i]).normalized();
      points[i] = rig_from_world.Inverse() * in_rig;
    }
  }

  double Distance(const CamFromLocal& pose) const {
    return std::max((pose.rotation - rig_from_world.rotation.toRotationMatrix()).norm(),
                    (pose.translation - rig_from_world.translation).norm());
  }
  double NearestOf(std::span<const CamFromLocal> poses) const {
    double nearest = std::numeric_limits<double>::infinity();
    for (const CamFromLocal& pose : poses) nearest = std::min(nearest, Distance(pose));
    return nearest;
  }
};

TEST(GeneralizedP3p, FindsTheTruePoseOfExactPoints) {
  Rng rng = TestRng();
  for (const double baseline : {0.05, 0.5, 5.0}) {
    int found = 0, exact = 0;
    for (int i = 0; i < 2000; ++i) {
      const Seen seen(rng, baseline);
      Poses poses;
      const int count = SolveGeneralizedP3p(seen.centers, seen.rays, seen.points, poses);
      const double distance = seen.NearestOf(std::span(poses).first(static_cast<size_t>(count)));
      found += distance < 1e-4 ? 1 : 0;
      exact += distance < 1e-9 ? 1 : 0;
    }
    // Where two solutions all but coincide the roots are less sure, or missed.
    EXPECT_GE(found, 1990) << baseline;
    EXPECT_GE(exact, 1940) << baseline;
  }
}

TEST(GeneralizedP3p, EachSolutionPutsThePointsOntoTheirRays) {
  Rng rng = TestRng();
  for (int i = 0; i < 2000; ++i) {
    const Seen seen(rng, 3);
    Poses poses;
    const int count = SolveGeneralizedP3p(seen.centers, seen.rays, seen.points, poses);
    for (int s = 0; s < count; ++s) {
      const CamFromLocal& pose = poses[static_cast<size_t>(s)];
      EXPECT_NEAR(pose.rotation.determinant(), 1, 1e-12);
      for (size_t k = 0; k < 3; ++k) {
        const Vector3d ray = pose.rotation * seen.points[k] + pose.translation - seen.centers[k];
        EXPECT_LT((ray.normalized() - seen.rays[k]).norm(), 1e-7);
      }
    }
  }
}

// With all centers at one place it is P3P; its solutions are then those.
TEST(GeneralizedP3p, OfOneCenterIsP3p) {
  Rng rng = TestRng();
  int agree = 0;
  constexpr int kSamples = 1000;
  for (int i = 0; i < kSamples; ++i) {
    const Seen seen(rng, 0);
    std::array<CamFromLocal, 4> of_p3p;
    Poses poses;
    const int count_p3p = SolveP3p(seen.rays, seen.points, of_p3p);
    const int count = SolveGeneralizedP3p(seen.centers, seen.rays, seen.points, poses);
    bool same = count == count_p3p;
    for (int s = 0; s < count_p3p; ++s) {
      const CamFromLocal& pose = of_p3p[static_cast<size_t>(s)];
      same = same && std::any_of(poses.begin(), poses.begin() + count, [&](const CamFromLocal& p) {
               return (p.rotation - pose.rotation).norm() < 1e-5;
             });
    }
    agree += same ? 1 : 0;
  }
  EXPECT_GE(agree, 0.98 * kSamples);  // double roots are found by one of them alone
}

TEST(GeneralizedP3p, CollinearPointsGiveNone) {
  const std::array<Vector3d, 3> centers{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}};
  const std::array<Vector3d, 3> rays{{{0, 0, 1}, {0, 0, 1}, {0, 0, 1}}};
  Poses poses;
  EXPECT_EQ(SolveGeneralizedP3p(centers, rays, {{{0, 0, 5}, {1, 0, 5}, {2, 0, 5}}}, poses), 0);
  EXPECT_EQ(SolveGeneralizedP3p(centers, rays, {{{0, 0, 5}, {0, 0, 5}, {0, 0, 5}}}, poses), 0);
}

}  // namespace
}  // namespace raylift
