#include "estimation/solvers/d3p1.h"

#include <algorithm>

#include "estimation/solvers/p3p.h"

namespace raylift {

int SolveRelativePoseByDepth(const std::array<Eigen::Vector3d, 3>& query_rays,
                             const std::array<Eigen::Vector3d, 3>& points_from_center,
                             std::span<RelativePose, 4> poses) {
  // A shorter translation than this, beside the points' distances, is rounding.
  constexpr double kLeastTranslation = 1e-9;
  std::array<SolverPose, 4> solutions;
  const int num_solutions = SolveP3p(query_rays, points_from_center, solutions);
  double farthest2 = 0;
  for (const Eigen::Vector3d& point : points_from_center) {
    farthest2 = std::max(farthest2, point.squaredNorm());
  }
  int count = 0;
  for (int i = 0; i < num_solutions; ++i) {
    const double length = solutions[i].translation.norm();
    if (!(length * length > kLeastTranslation * kLeastTranslation * farthest2)) continue;
    poses[count++] = {solutions[i].rotation, solutions[i].translation / length};
  }
  return count;
}

}  // namespace raylift
