#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "estimation/solvers/minimal_solvers.h"
#include "support/matchers.h"

namespace raylift {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

#ifdef __SANITIZE_ADDRESS__
constexpr int kTrials = 5000;
#else
constexpr int kTrials = 100000;
#endif

constexpr double kFound = 1e-6;  // radians

// For small angles; the error beyond is larger still.
double AngleBetween(const Matrix3d& a, const Matrix3d& b) { return (a - b).norm() / std::sqrt(2); }

// A ray of a camera with a field of view of 60 by 45 degrees.
Vector3d RandomRay(Rng& rng) {
  return Vector3d{rng.Uniform(-0.55, 0.55), rng.Uniform(-0.41, 0.41), 1}.normalized();
}
Vector3d RandomPoint(Rng& rng, double near, double far) {
  const double depth = rng.Uniform(near, far);
  return RandomRay(rng) * depth;
}
Vector3d RandomDirection(Rng& rng) {
  return Vector3d{rng.Normal(), rng.Normal(), rng.Normal()}.normalized();
}

struct P3pInstance {
  CamFromLocal truth;
  std::array<Vector3d, 3> rays;
  std::array<Vector3d, 3> points;
};
P3pInstance MakeP3pInstance(Rng& rng) {
  const Rigid3 pose = RandomRigid3(rng, 5);
  P3pInstance instance;
  instance.truth = {pose.rotation.toRotationMatrix(), pose.translation};
  for (int i = 0; i < 3; ++i) {
    const Vector3d point_in_cam = RandomPoint(rng, 1, 10);
    instance.rays[i] = point_in_cam.normalized();
    instance.points[i] = pose.Inverse() * point_in_cam;
  }
  return instance;
}

// Six matches: five to a first reference, one to a second.
struct E5p1Instance {
  CamFromLocal truth;  // query_from_world
  Vector3d center;
  std::array<Vector3d, 5> query_rays;
  std::array<Vector3d, 5> reference_rays;  // in world axes
  RayPair sixth;
  Vector3d sixth_center;
};
E5p1Instance MakeE5p1Instance(Rng& rng, double baseline) {
  const Rigid3 pose = RandomRigid3(rng, 5);
  const Rigid3 world_from_query = pose.Inverse();
  E5p1Instance instance;
  instance.truth = {pose.rotation.toRotationMatrix(), pose.translation};
  instance.center = world_from_query * Vector3d(baseline * RandomDirection(rng));
  instance.sixth_center = world_from_query * Vector3d(baseline * RandomDirection(rng));
  for (int i = 0; i < 6; ++i) {
    const Vector3d point_in_query = RandomPoint(rng, 3, 10);
    const Vector3d point = world_from_query * point_in_query;
    const Vector3d& center = i < 5 ? instance.center : instance.sixth_center;
    (i < 5 ? instance.query_rays[i] : instance.sixth.query_ray) = point_in_query.normalized();
    (i < 5 ? instance.reference_rays[i] : instance.sixth.reference_ray) =
        (point - center).normalized();
  }
  return instance;
}

double NearestRotation(const E5p1Instance& instance) {
  std::array<RelativePose, kMaxFivePointSolutions> poses;
  const int count = SolveRelativePose(instance.query_rays, instance.reference_rays, poses);
  double nearest = 10;
  for (int i = 0; i < count; ++i) {
    nearest = std::min(nearest, AngleBetween(poses[i].rotation, instance.truth.rotation));
  }
  return nearest;
}

template <typename NearestFunction>
double ShareFound(Rng& rng, const NearestFunction& nearest) {
  int found = 0;
  for (int i = 0; i < kTrials; ++i) {
    found += nearest(rng) < kFound ? 1 : 0;
  }
  return static_cast<double>(found) / kTrials;
}

TEST(P3p, FindsTheTruePoseOfCleanPoints) {
  Rng rng = TestRng();
  EXPECT_GE(ShareFound(rng,
                       [](Rng& r) {
                         const P3pInstance instance = MakeP3pInstance(r);
                         std::array<CamFromLocal, 4> poses;
                         const int count = SolveP3p(instance.rays, instance.points, poses);
                         double nearest = 10;
                         for (int i = 0; i < count; ++i) {
                           nearest = std::min(
                               nearest, AngleBetween(poses[i].rotation, instance.truth.rotation));
                         }
                         return nearest;
                       }),
            0.999);
}

TEST(P3p, EverySolutionMapsThePointsOntoTheirRays) {
  Rng rng = TestRng();
  int solutions = 0;
  int exact = 0;
  for (int trial = 0; trial < kTrials / 10; ++trial) {
    const P3pInstance instance = MakeP3pInstance(rng);
    std::array<CamFromLocal, 4> poses;
    const int count = SolveP3p(instance.rays, instance.points, poses);
    for (int i = 0; i < count; ++i) {
      ASSERT_TRUE(poses[i].rotation.allFinite() && poses[i].translation.allFinite());
      double largest = 0;
      for (int k = 0; k < 3; ++k) {
        const Vector3d p = poses[i].rotation * instance.points[k] + poses[i].translation;
        largest = std::max(largest, (p.normalized() - instance.rays[k]).norm());
      }
      ++solutions;
      exact += largest < 1e-8 ? 1 : 0;
    }
  }
  // The rest are nearly double solutions of nearly collinear points.
  EXPECT_GE(exact, 0.999 * solutions);
}

TEST(P3p, CollinearPointsHaveNoSolution) {
  Rng rng = TestRng();
  for (int i = 0; i < 1000; ++i) {
    P3pInstance instance = MakeP3pInstance(rng);
    const double along = rng.Uniform(-2, 2);
    instance.points[2] = instance.points[0] + along * (instance.points[1] - instance.points[0]);
    std::array<CamFromLocal, 4> poses;
    EXPECT_EQ(SolveP3p(instance.rays, instance.points, poses), 0);
  }
}

TEST(P3p, CoincidingPointsHaveNoSolution) {
  Rng rng = TestRng();
  for (int i = 0; i < 1000; ++i) {
    P3pInstance instance = MakeP3pInstance(rng);
    instance.points[2] = instance.points[1];
    std::array<CamFromLocal, 4> poses;
    EXPECT_EQ(SolveP3p(instance.rays, instance.points, poses), 0);
    instance.points[0] = instance.points[1];
    EXPECT_EQ(SolveP3p(instance.rays, instance.points, poses), 0);
  }
}

TEST(P3p, EqualRaysGiveNoNan) {
  Rng rng = TestRng();
  for (int i = 0; i < 1000; ++i) {
    P3pInstance instance = MakeP3pInstance(rng);
    instance.rays[1] = instance.rays[0];
    if (i % 2 == 0) instance.rays[2] = instance.rays[0];
    std::array<CamFromLocal, 4> poses;
    const int count = SolveP3p(instance.rays, instance.points, poses);
    for (int k = 0; k < count; ++k) {
      EXPECT_TRUE(poses[k].rotation.allFinite() && poses[k].translation.allFinite());
    }
  }
}

TEST(FivePoint, FindsTheTrueRotationOfCleanMatches) {
  Rng rng = TestRng();
  EXPECT_GE(ShareFound(rng, [](Rng& r) { return NearestRotation(MakeE5p1Instance(r, 2)); }), 0.99);
}

TEST(FivePoint, FindsTheTrueRotationAtAShortBaseline) {
  // A baseline of 0.1 at depths of 3 to 10: the epipolar constraint is nearly blind to the
  // direction, and rounding alone moves the solution by more than the bound in some cases.
  Rng rng = TestRng();
  EXPECT_GE(ShareFound(rng, [](Rng& r) { return NearestRotation(MakeE5p1Instance(r, 0.1)); }),
            0.985);
}

TEST(FivePoint, EssentialMatricesMeetTheEpipolarConstraints) {
  Rng rng = TestRng();
  int solutions = 0;
  int exact = 0;
  for (int trial = 0; trial < kTrials / 20; ++trial) {
    const E5p1Instance instance = MakeE5p1Instance(rng, 2);
    std::array<Matrix3d, kMaxFivePointSolutions> essentials;
    const int count = SolveEssential(instance.query_rays, instance.reference_rays, essentials);
    for (int i = 0; i < count; ++i) {
      const Matrix3d& e = essentials[i];
      ASSERT_TRUE(e.allFinite());
      double largest = std::abs(e.determinant());
      largest =
          std::max(largest, (2 * e * e.transpose() * e - (e * e.transpose()).trace() * e).norm());
      for (int k = 0; k < 5; ++k) {
        largest =
            std::max(largest, std::abs(instance.query_rays[k].dot(e * instance.reference_rays[k])));
      }
      ++solutions;
      exact += largest < 1e-6 ? 1 : 0;
    }
  }
  EXPECT_GE(exact, 0.98 * solutions);
}

TEST(FivePoint, EveryPoseSeesAllPointsInFront) {
  Rng rng = TestRng();
  for (int trial = 0; trial < 2000; ++trial) {
    const E5p1Instance instance = MakeE5p1Instance(rng, 2);
    std::array<RelativePose, kMaxFivePointSolutions> poses;
    const int count = SolveRelativePose(instance.query_rays, instance.reference_rays, poses);
    for (int i = 0; i < count; ++i) {
      const RelativePose& pose = poses[i];
      EXPECT_LT((pose.rotation * pose.rotation.transpose() - Matrix3d::Identity()).norm(), 1e-10);
      EXPECT_NEAR(pose.direction.norm(), 1, 1e-12);
      for (int k = 0; k < 5; ++k) {
        // Depths along both rays by least squares: s q = direction + r g.
        Eigen::Matrix<double, 3, 2> rays;
        rays << instance.query_rays[k], -(pose.rotation * instance.reference_rays[k]);
        const Eigen::Vector2d depths =
            (rays.transpose() * rays).inverse() * (rays.transpose() * pose.direction);
        EXPECT_GT(depths.minCoeff(), 0);
      }
    }
  }
}

TEST(FivePoint, EqualMatchesGiveNoNan) {
  Rng rng = TestRng();
  for (int trial = 0; trial < 1000; ++trial) {
    E5p1Instance instance = MakeE5p1Instance(rng, 2);
    const int equal = 2 + trial % 4;
    for (int k = 1; k < equal; ++k) {
      instance.query_rays[k] = instance.query_rays[0];
      instance.reference_rays[k] = instance.reference_rays[0];
    }
    std::array<RelativePose, kMaxFivePointSolutions> poses;
    const int count = SolveRelativePose(instance.query_rays, instance.reference_rays, poses);
    for (int i = 0; i < count; ++i) {
      EXPECT_TRUE(poses[i].rotation.allFinite() && poses[i].direction.allFinite());
    }
  }
}

// Nearest of the full poses, by rotation and by position over the baseline.
double NearestPose(const E5p1Instance& instance, double baseline) {
  std::array<RelativePose, kMaxFivePointSolutions> relative;
  const int count = SolveRelativePose(instance.query_rays, instance.reference_rays, relative);
  double nearest = 10;
  for (int i = 0; i < count; ++i) {
    const auto length =
        TranslationLength(relative[i], instance.center, instance.sixth, instance.sixth_center);
    if (!length) continue;
    const CamFromLocal pose = QueryPose(relative[i], instance.center, *length);
    const double position = (pose.rotation.transpose() * pose.translation -
                             instance.truth.rotation.transpose() * instance.truth.translation)
                                .norm();
    nearest = std::min(nearest, std::max(AngleBetween(pose.rotation, instance.truth.rotation),
                                         1e-2 * position / baseline));
  }
  return nearest;
}

// A solver that checks the sixth match with the first reference's center finds 63 %.
TEST(E5p1, ChecksTheSixthMatchInItsOwnReference) {
  Rng rng = TestRng();
  EXPECT_GE(ShareFound(rng, [](Rng& r) { return NearestPose(MakeE5p1Instance(r, 2), 2); }), 0.99);
}

TEST(E5p1, SixthMatchBehindItsReferenceIsRejected) {
  Rng rng = TestRng();
  for (int trial = 0; trial < 1000; ++trial) {
    E5p1Instance instance = MakeE5p1Instance(rng, 2);
    const RelativePose truth = {
        instance.truth.rotation,
        (instance.truth.translation + instance.truth.rotation * instance.center).normalized()};
    EXPECT_TRUE(TranslationLength(truth, instance.center, instance.sixth, instance.sixth_center));
    instance.sixth.reference_ray *= -1;
    EXPECT_FALSE(TranslationLength(truth, instance.center, instance.sixth, instance.sixth_center));
  }
}

// Three matches to a reference whose depths have one unknown factor, and one to another reference.
struct D3p1Instance {
  CamFromLocal truth;  // query_from_world
  Vector3d center;
  std::array<Vector3d, 3> query_rays;
  std::array<Vector3d, 3> points_from_center;  // times the factor
  RayPair fourth;
  Vector3d fourth_center;

  RelativePose TrueRelativePose() const {
    return {truth.rotation, (truth.translation + truth.rotation * center).normalized()};
  }
};
D3p1Instance MakeD3p1Instance(Rng& rng) {
  const Rigid3 pose = RandomRigid3(rng, 5);
  const Rigid3 world_from_query = pose.Inverse();
  D3p1Instance instance;
  instance.truth = {pose.rotation.toRotationMatrix(), pose.translation};
  instance.center = world_from_query * Vector3d(2 * RandomDirection(rng));
  instance.fourth_center = world_from_query * Vector3d(2 * RandomDirection(rng));
  const double factor = std::exp(rng.Uniform(-3, 3));
  for (int i = 0; i < 3; ++i) {
    const Vector3d point_in_query = RandomPoint(rng, 3, 10);
    instance.query_rays[i] = point_in_query.normalized();
    instance.points_from_center[i] = factor * (world_from_query * point_in_query - instance.center);
  }
  const Vector3d point_in_query = RandomPoint(rng, 3, 10);
  instance.fourth = {point_in_query.normalized(),
                     (world_from_query * point_in_query - instance.fourth_center).normalized()};
  return instance;
}

std::vector<CamFromLocal> SolveD3p1(const D3p1Instance& instance) {
  std::array<RelativePose, 4> relative;
  const int count =
      SolveRelativePoseByDepth(instance.query_rays, instance.points_from_center, relative);
  std::vector<CamFromLocal> poses;
  for (int i = 0; i < count; ++i) {
    EXPECT_TRUE(relative[i].rotation.allFinite() && relative[i].direction.allFinite());
    const auto length =
        TranslationLength(relative[i], instance.center, instance.fourth, instance.fourth_center);
    if (length) poses.push_back(QueryPose(relative[i], instance.center, *length));
  }
  return poses;
}

TEST(D3p1, FindsTheTruePoseWhateverTheFactorOfTheDepths) {
  Rng rng = TestRng();
  int found = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    const D3p1Instance instance = MakeD3p1Instance(rng);
    double nearest = 10;
    for (const CamFromLocal& pose : SolveD3p1(instance)) {
      nearest = std::min(nearest, (pose.rotation - instance.truth.rotation).norm() +
                                      (pose.translation - instance.truth.translation).norm());
    }
    found += nearest < 1e-9 ? 1 : 0;
  }
  // The rest are nearly double solutions of P3P, and fourth matches nearly in one plane with the
  // first translation.
  EXPECT_GE(found, 0.995 * kTrials);
}

// By elementary geometry: a factor of the depths that puts all three points on their query rays,
// and a fourth ray of the query that meets that of its reference.
TEST(D3p1, EverySolutionMeetsItsFourMatches) {
  Rng rng = TestRng();
  int solutions = 0;
  int exact = 0;
  for (int trial = 0; trial < kTrials / 10; ++trial) {
    const D3p1Instance instance = MakeD3p1Instance(rng);
    for (const CamFromLocal& pose : SolveD3p1(instance)) {
      const Vector3d query = -pose.rotation.transpose() * pose.translation;
      const auto world_ray = [&pose](const Vector3d& ray) -> Vector3d {
        return pose.rotation.transpose() * ray;
      };
      // The factor at which the first point is nearest to its ray, times the others.
      const Vector3d first = world_ray(instance.query_rays[0]);
      const Vector3d across = first.cross(instance.points_from_center[0]);
      const double factor =
          -across.dot(first.cross(instance.center - query)) / across.squaredNorm();
      ASSERT_GT(factor, 0);
      double largest = 0;
      for (int k = 0; k < 3; ++k) {
        const Vector3d point = instance.center + factor * instance.points_from_center[k];
        largest = std::max(
            largest, ((point - query).normalized() - world_ray(instance.query_rays[k])).norm());
      }
      // Distances along both rays to where they meet.
      const Vector3d fourth = world_ray(instance.fourth.query_ray);
      Eigen::Matrix<double, 3, 2> rays;
      rays << fourth, -instance.fourth.reference_ray;
      const Vector3d baseline = instance.fourth_center - query;
      const Eigen::Vector2d along = rays.colPivHouseholderQr().solve(baseline);
      EXPECT_GT(along.minCoeff(), 0);
      largest = std::max(largest, (rays * along - baseline).norm() / baseline.norm());
      ++solutions;
      exact += largest < 1e-9 ? 1 : 0;
    }
  }
  EXPECT_GE(solutions, kTrials / 10);
  EXPECT_GE(exact, 0.995 * solutions);
}

TEST(D3p1, AQueryAtTheReferencesCenterHasNoSolution) {
  Rng rng = TestRng();
  for (int trial = 0; trial < 1000; ++trial) {
    D3p1Instance instance = MakeD3p1Instance(rng);
    for (int k = 0; k < 3; ++k) {
      instance.points_from_center[k] =
          instance.truth.rotation.transpose() * instance.query_rays[k] * rng.Uniform(3, 10);
    }
    // P3P's other solutions are elsewhere.
    for (const CamFromLocal& pose : SolveD3p1(instance)) {
      EXPECT_TRUE(pose.translation.allFinite());
      EXPECT_GT((pose.rotation - instance.truth.rotation).norm(), 1e-6);
    }
  }
}

TEST(D3p1, AFourthMatchOfTheSameCenterHasNoSolution) {
  Rng rng = TestRng();
  for (int trial = 0; trial < 1000; ++trial) {
    D3p1Instance instance = MakeD3p1Instance(rng);
    instance.fourth_center = instance.center;
    EXPECT_TRUE(SolveD3p1(instance).empty());
  }
}

TEST(D3p1, AFourthRayAlongTheBaselineHasNoSolution) {
  Rng rng = TestRng();
  for (int trial = 0; trial < 1000; ++trial) {
    D3p1Instance instance = MakeD3p1Instance(rng);
    const RelativePose truth = instance.TrueRelativePose();
    instance.fourth.query_ray = truth.direction;
    EXPECT_FALSE(
        TranslationLength(truth, instance.center, instance.fourth, instance.fourth_center));
    // Nor one whose plane with its reference's ray holds the baseline.
    instance.fourth.query_ray =
        (truth.direction + 0.3 * truth.rotation * instance.fourth.reference_ray).normalized();
    EXPECT_FALSE(
        TranslationLength(truth, instance.center, instance.fourth, instance.fourth_center));
    // Nor parallel rays.
    instance.fourth.query_ray = truth.rotation * instance.fourth.reference_ray;
    EXPECT_FALSE(
        TranslationLength(truth, instance.center, instance.fourth, instance.fourth_center));
  }
}

TEST(D3p1, ANegativeFactorHasNoSolution) {
  Rng rng = TestRng();
  for (int trial = 0; trial < 1000; ++trial) {
    D3p1Instance instance = MakeD3p1Instance(rng);
    const RelativePose truth = instance.TrueRelativePose();
    // A fourth match as a query on the other side of the reference would have it.
    const Vector3d query = -instance.truth.rotation.transpose() * instance.truth.translation;
    const Vector3d opposite = 2 * instance.center - query;
    const Vector3d point = query + instance.truth.rotation.transpose() * RandomPoint(rng, 3, 10);
    instance.fourth = {(instance.truth.rotation * (point - opposite)).normalized(),
                       (point - instance.fourth_center).normalized()};
    EXPECT_FALSE(
        TranslationLength(truth, instance.center, instance.fourth, instance.fourth_center));
  }
}

TEST(D3p1, CollinearAndCoincidingPointsHaveNoSolution) {
  Rng rng = TestRng();
  for (int trial = 0; trial < 1000; ++trial) {
    D3p1Instance instance = MakeD3p1Instance(rng);
    auto& points = instance.points_from_center;
    points[2] = trial % 2 == 0 ? points[1] : Vector3d(2 * points[1] - points[0]);
    EXPECT_TRUE(SolveD3p1(instance).empty());
    points = {Vector3d::Zero(), Vector3d::Zero(), Vector3d::Zero()};
    EXPECT_TRUE(SolveD3p1(instance).empty());
  }
}

}  // namespace
}  // namespace raylift
