// Nanoseconds per call of the minimal solvers on clean samples.

#include <array>
#include <vector>

#include "estimation/solvers/minimal_solvers.h"
#include "support/matchers.h"
#include <benchmark/benchmark.h>

namespace raylift {
namespace {

using Eigen::Vector3d;

constexpr int kInstances = 1000;

Vector3d RandomPoint(Rng& rng) {
  const Vector3d ray{rng.Uniform(-0.55, 0.55), rng.Uniform(-0.41, 0.41), 1};
  return ray * rng.Uniform(5, 15);
}
Vector3d RandomCenter(Rng& rng) {
  return {rng.Uniform(-2, 2), rng.Uniform(-2, 2), rng.Uniform(-2, 2)};
}

void P3p(benchmark::State& state) {
  struct Instance {
    std::array<Vector3d, 3> rays;
    std::array<Vector3d, 3> points;
  };
  Rng rng(1);
  std::vector<Instance> instances(kInstances);
  for (Instance& instance : instances) {
    const Rigid3 world_from_cam = RandomRigid3(rng, 5);
    for (int i = 0; i < 3; ++i) {
      const Vector3d point = RandomPoint(rng);
      instance.rays[i] = point.normalized();
      instance.points[i] = world_from_cam * point;
    }
  }
  std::array<CamFromLocal, 4> poses;
  size_t next = 0;
  for (auto _ : state) {
    const Instance& instance = instances[next++ % kInstances];
    benchmark::DoNotOptimize(SolveP3p(instance.rays, instance.points, poses));
  }
}
BENCHMARK(P3p);

struct FiveMatches {
  std::array<Vector3d, 5> query_rays;
  std::array<Vector3d, 5> reference_rays;
  Vector3d center;
  RayPair sixth;
  Vector3d sixth_center;
};

std::vector<FiveMatches> MakeFiveMatches() {
  Rng rng(1);
  std::vector<FiveMatches> instances(kInstances);
  for (FiveMatches& instance : instances) {
    instance.center = RandomCenter(rng);
    instance.sixth_center = RandomCenter(rng);
    for (int i = 0; i < 6; ++i) {
      const Vector3d point = RandomPoint(rng);
      const Vector3d& center = i < 5 ? instance.center : instance.sixth_center;
      (i < 5 ? instance.query_rays[i] : instance.sixth.query_ray) = point.normalized();
      (i < 5 ? instance.reference_rays[i] : instance.sixth.reference_ray) =
          (point - center).normalized();
    }
  }
  return instances;
}

void FivePointEssential(benchmark::State& state) {
  const auto instances = MakeFiveMatches();
  std::array<Eigen::Matrix3d, kMaxFivePointSolutions> essentials;
  size_t next = 0;
  for (auto _ : state) {
    const FiveMatches& instance = instances[next++ % kInstances];
    benchmark::DoNotOptimize(
        SolveEssential(instance.query_rays, instance.reference_rays, essentials));
  }
}
BENCHMARK(FivePointEssential);

void FivePointPoses(benchmark::State& state) {
  const auto instances = MakeFiveMatches();
  std::array<RelativePose, kMaxFivePointSolutions> poses;
  size_t next = 0;
  for (auto _ : state) {
    const FiveMatches& instance = instances[next++ % kInstances];
    benchmark::DoNotOptimize(
        SolveRelativePose(instance.query_rays, instance.reference_rays, poses));
  }
}
BENCHMARK(FivePointPoses);

void E5p1(benchmark::State& state) {
  const auto instances = MakeFiveMatches();
  std::array<RelativePose, kMaxFivePointSolutions> poses;
  size_t next = 0;
  for (auto _ : state) {
    const FiveMatches& instance = instances[next++ % kInstances];
    const int count = SolveRelativePose(instance.query_rays, instance.reference_rays, poses);
    for (int i = 0; i < count; ++i) {
      benchmark::DoNotOptimize(
          TranslationLength(poses[i], instance.center, instance.sixth, instance.sixth_center));
    }
  }
}
BENCHMARK(E5p1);

}  // namespace
}  // namespace raylift
